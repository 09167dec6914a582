"""From a column's header to its words and its unit."""

import re
import unicodedata
from dataclasses import dataclass

from femfit.tables.units import is_unit

_BRACKETS = re.compile(r"[\[({<]([^\[\](){}<>]*)[\])}>]")
_TRAILING = re.compile(r"(?:\s*/\s*|\s*,\s*|\s+in\s+|\s+en\s+|\s+v\s+|[_\s]+)([^\s_/,]+)$")
_WORD = re.compile(r"[A-ZΑ-Ω]?[a-zα-ω]+|[A-ZΑ-Ω]+(?![a-z])|\d+")


@dataclass(frozen=True)
class Header:
    """A header taken apart.

    Parameters
    ----------
    text : str
        As it stands in the file.
    words : tuple of str
        Lower case, without accents, without the unit.
    unit_known : bool
        False if something in brackets looks like a unit but is none that we know.
    """

    text: str
    words: tuple[str, ...]
    unit: str | None
    unit_known: bool = True


def plain(text: str) -> str:
    """Without accents and ligatures, so that ``Induktivität`` and ``entrefer`` are spelled as in the catalogue."""
    replaced = text.replace("ß", "ss").replace("ø", "o").replace("Ø", "O").replace("æ", "ae")
    decomposed = unicodedata.normalize("NFKD", replaced)
    return "".join(character for character in decomposed if not unicodedata.combining(character))


def parse_header(text: str) -> Header:
    """Take a header apart: ``Z(inch)``, ``Distance [mm]``, ``Current_A``, ``I / A``, ``Kraft in mN``."""
    stripped = text.strip().strip('"').strip()
    name, unit, known = stripped, None, True
    for match in reversed(list(_BRACKETS.finditer(stripped))):
        inner = match.group(1).strip()
        if is_unit(inner):
            unit, name, known = inner, stripped[: match.start()] + " " + stripped[match.end() :], True
            break
        if inner and unit is None and len(inner) <= 6 and " " not in inner and inner != "-":
            unit, name, known = inner, stripped[: match.start()] + " " + stripped[match.end() :], False
    if unit is None:
        trailing = _TRAILING.search(stripped)
        if trailing and trailing.start() > 0 and is_unit(trailing.group(1)):
            unit, name = trailing.group(1), stripped[: trailing.start()]
    words = tuple(word.casefold() for word in _WORD.findall(plain(name)))
    return Header(stripped, words, unit, known)
