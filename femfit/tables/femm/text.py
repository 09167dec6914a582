"""The text of a ``.fem`` file in its parts: header keys, property blocks, rows of numbers.

FEMM 4.0 file format: ``[Key] = value`` lines; properties as ``<BeginX> ... <EndX>`` blocks of ``<Key> = value``; lists
as ``[NumX] = n`` followed by n rows. Keys are read without regard to case; what follows ``[Solution]`` (an ``.ans``
file) is left alone.
"""

import math
import re
from dataclasses import dataclass, field

from femfit.core.errors import FemFileError

PROPERTIES = ("pointprops", "bdryprops", "blockprops", "circuitprops")
LISTS = ("numpoints", "numsegments", "numarcsegments", "numholes", "numblocklabels")
OTHER_PHYSICS = {
    "heat flow (.feh)": {"kx", "ky", "tkpoints"},
    "current flow (.fec)": {"ox", "oy"},
    "electrostatics (.fee)": {"ex", "ey"},
}
"""FEMM's other solvers, by keys that only their block properties have; the first that fits."""

_KEY = re.compile(r"\[(\w+)\]\s*=?\s*(.*)")
_PROPERTY = re.compile(r"<(\w+)>\s*=?\s*(.*)")
_FIELD = re.compile(r'"[^"]*"?|\S+')


@dataclass(frozen=True)
class FemText:
    """A file's parts, as text."""

    source: str
    header: dict[str, str] = field(default_factory=dict)
    # Section to its blocks, each by lower-case keys; the rows after ``bhpoints`` are under ``curve``
    properties: dict[str, list[dict[str, str]]] = field(default_factory=dict)
    rows: dict[str, list[list[str]]] = field(default_factory=dict)  # List to its rows, each a list of fields
    problems: list[str] = field(default_factory=list)  # What could not be read; appended to by the number readers

    def number(self, text: str, where: str) -> float:
        """A finite number; a problem and 0 if it is none."""
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            self.problems.append(f"{where} must be a number; instead received {text[:40]!r}. Save it again with FEMM.")
            return 0.0
        return value

    def integer(self, text: str, where: str) -> int:
        """A whole number of at most nine digits; a problem and 0 if it is none."""
        value = self.number(text, where)
        if not value.is_integer() or abs(value) > 1e9:
            self.problems.append(f"{where} must be a whole number; instead received {text[:40]!r}.")
            return 0
        return int(value)

    def check_count(self, what: str, value: str, count: int) -> None:
        """Whether as many rows follow as a line says."""
        if value != str(count):
            says = f"{what} says {value[:40] or 'nothing'} but {count} follow"
            self.problems.append(f"{says}; the file is cut or edited wrongly.")


def split_fem(content: bytes, source: str) -> FemText:
    """The parts of a file."""
    if b"\x00" in content:
        raise FemFileError(source, ["it is no text file. Give a .fem file as FEMM's Save writes it."])
    try:
        decoded = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        decoded = content.decode("latin-1")
    lines = [line.strip() for line in decoded.splitlines()]
    text, place = FemText(source), 0
    while place < len(lines):
        match = _KEY.match(lines[place])
        place += 1
        if match is None:
            continue
        key, value = match[1].lower(), match[2].strip()
        if key == "solution":
            break
        if key in PROPERTIES:
            text.properties[key], place = _property_blocks(lines, place, text)
            text.check_count(match[1], value, len(text.properties[key]))
        elif key in LISTS:
            text.rows[key], place = _list_rows(lines, place)
            text.check_count(match[1], value, len(text.rows[key]))
        else:
            text.header[key] = value.strip('"').strip()
    _check_kind(text)
    return text


def unquoted(text: str) -> str:
    """A quoted name without its quotes and without control characters."""
    return "".join(character for character in text.strip().strip('"') if character.isprintable())[:60]


def _property_blocks(lines: list[str], place: int, text: FemText) -> tuple[list[dict[str, str]], int]:
    blocks: list[dict[str, str]] = []
    while place < len(lines) and (not lines[place] or lines[place].startswith("<")):
        match = _PROPERTY.match(lines[place])
        place += 1
        if match is None:
            continue
        key, value = match[1].lower(), match[2].strip()
        if key.startswith("begin"):
            blocks.append({})
        elif blocks and not key.startswith("end"):
            blocks[-1][key] = value
            if key == "bhpoints":
                curve, place = _list_rows(lines, place)
                blocks[-1]["curve"] = "\n".join(" ".join(row) for row in curve)
                text.check_count(f"BHPoints of block {blocks[-1].get('blockname', '')}", value, len(curve))
    return blocks, place


def _list_rows(lines: list[str], place: int) -> tuple[list[list[str]], int]:
    rows = []
    while place < len(lines) and not lines[place].startswith(("[", "<")):
        if lines[place]:
            rows.append(_FIELD.findall(lines[place]))
        place += 1
    return rows, place


def _check_kind(text: FemText) -> None:
    """Refuse a file of FEMM's other solvers by its name, and what is no file of FEMM at all."""
    keys = {key for block in text.properties.get("blockprops", ()) for key in block}
    physics = next((name for name, markers in OTHER_PHYSICS.items() if markers & keys), None)
    if physics is None and "conductorprops" in text.header:
        physics = "electrostatics, heat flow or current flow"
    if physics is not None:
        raise FemFileError(
            text.source, [f"it is FEMM's {physics} file; femfit reads magnetics. Give the magnetics (.fem) file."]
        )
    there = text.header.keys() | text.rows.keys()
    missing = [name for name in ("[Format]", "[NumPoints]", "[NumBlockLabels]") if name[1:-1].lower() not in there]
    if missing:
        what = f"it is no FEMM magnetics file of format 4.0: {', '.join(missing)} missing."
        raise FemFileError(text.source, [f"{what} Give a .fem file as FEMM saves it."])
