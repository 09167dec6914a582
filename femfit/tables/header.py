"""From a column's header to its words and its unit, and how surely they name a quantity.

Columns of several circuits carry the circuit's name: ``current_bias_A`` is the current of the circuit bias. A table is
one of several circuits where its headers name two or more; a lone ``current_coil_A`` is more likely a ``current_A`` by
another name. An impedance may be that of one circuit alone, or carry the names of two:
``inductance_bias_control_H``.
"""

import re
import unicodedata
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache

from femfit.core.errors import TableError
from femfit.core.results import listing
from femfit.core.text import quoted
from femfit.tables.number_text import looks_numeric
from femfit.tables.units import CHANNELS, NEEDS_UNIT, column_unit, is_unit, unit_factor

_BRACKETS = re.compile(r"[\[({<]([^\[\](){}<>]*)[\])}>]")
_BEFORE = r"(?:\s*/\s*|\s*,\s*|\s+in\s+|[_\s]+)"
_TRAILING = tuple(re.compile(_BEFORE + unit) for unit in (r"([^\s_/,]+[/_][^\s_/,]+)$", r"([^\s_/,]+)$"))
"""Units at the end of a header, a quotient before its denominator alone."""

_IMPEDANCE = (
    (re.compile(r"\|\s*Z\s*\|"), "Zabs"),
    (re.compile(r"\b(Re|Im|Real|Imag|Abs|Mag|Arg|Phase)\s*[({\[]\s*Z\s*[)}\]]", re.IGNORECASE), r"\1Z"),
    (re.compile(r"\bZ(?:''|\"|″)"), "ImZ"),
    (re.compile(r"\bZ['′]"), "ReZ"),
    (re.compile(r"\b([LR])_s(?![A-Za-z0-9])"), r"\1s"),
)
"""How the parts of an impedance are written, whose marks would be taken for units or for nothing."""

_WORD = re.compile(r"[A-ZΑ-Ω]?[a-zα-ω]+|[A-ZΑ-Ω]+(?![a-z])|\d+")
SURE, MAYBE, WORD_IN_UNIT, WORD, UNIT = 5, 4, 3, 2, 1
"""Scores of a header: it is a column's name; it may be; a word of it is a name beside a unit of the kind, or without
one; its unit alone is of the kind. Below ``MAYBE`` it is only asked about."""

_LONGEST = 200
"""Characters of a header that are looked at."""


@dataclass(frozen=True)
class Header:
    """A header taken apart."""

    text: str
    words: tuple[str, ...]  # Lower case, without accents, without the unit
    unit: str | None  # What looks like a unit where it is none of ours

    @property
    def name(self) -> str:
        """The words without blanks, as in the registry of channels."""
        return "".join(self.words)


def plain(text: str) -> str:
    """Remove accents and ligatures, so that ``Induktivität`` is spelled as in the table of names."""
    decomposed = unicodedata.normalize("NFKD", text.replace("ß", "ss"))
    return "".join(character for character in decomposed if not unicodedata.combining(character))


@lru_cache(maxsize=4096)
def parse_header(text: str) -> Header:
    """Take a header apart: ``Z(inch)``, ``Distance [mm]``, ``Current_A``, ``I / A``, ``Kraft in mN``."""
    stripped = text[:_LONGEST].strip()
    for written, name in _IMPEDANCE:
        stripped = written.sub(name, stripped)
    stripped = stripped.strip('"').strip()
    name, unit = stripped, None
    for match in reversed(list(_BRACKETS.finditer(stripped))):
        inner = match.group(1).strip()
        if is_unit(inner):
            unit, name = inner, stripped[: match.start()] + " " + stripped[match.end() :]
            break
        unknown = " " not in inner and (len(inner) <= 6 or match.group().startswith("["))
        if inner and unit is None and unknown and inner != "-" and not looks_numeric(inner):
            unit, name = inner, stripped[: match.start()] + " " + stripped[match.end() :]
    if unit is None:
        for trailing in (pattern.search(stripped) for pattern in _TRAILING):
            if trailing and trailing.start() > 0 and is_unit(trailing.group(1).replace("_", "/")):
                unit, name = trailing.group(1).replace("_", "/"), stripped[: trailing.start()]
                break
    words = tuple(word.casefold() for word in _WORD.findall(plain(name)))
    return Header(stripped, words, unit)


def with_unit(name: str, unit: object) -> str:
    """Return a column's name with its unit in brackets, where it does not say one itself."""
    text = unit.decode("utf-8", "replace") if isinstance(unit, bytes) else unit
    missing = isinstance(text, str) and text.strip() and parse_header(name).unit is None
    return f"{name} [{str(text).strip()}]" if missing else name


def same_header(key: str, header: str) -> bool:
    """Tell whether a user means a header: as it is written, but for case, or without its unit."""
    return key.strip().casefold() in {header.strip().casefold(), " ".join(parse_header(header).words)}


def find_header(key: str, headers: Sequence[str], source: str, option: str) -> str:
    """Find the header that a user means."""
    matches = [header for header in headers if header.strip() == key.strip()]
    matches = matches or [header for header in headers if same_header(key, header)]
    if len(matches) != 1:
        raise TableError(
            f"{source} has no single column {quoted(key)!r} for {option}; its columns are "
            f"{listing(headers, 20) or 'without names (give --columns)'}."
        )
    return matches[0]


def score(header: Header, column: str) -> int:
    """Tell how surely a header names a column; a unit of another kind makes it 0.

    It may be the column as a name of one letter, or one that means several things beside a unit of the right kind, or
    where it is made of the column's names as in ``Spannung U [mV]``.
    """
    stem, si_unit = column_unit(column)
    fits = header.unit is not None and bool(si_unit) and unit_factor(header.unit, si_unit) is not None
    if header.unit is not None and not fits:
        return 0
    names = {re.sub("[_-]", "", stem).casefold(), *names_of(column)}
    if header.name in names and header.name not in NEEDS_UNIT:
        return SURE if fits or len(header.name) > 1 else MAYBE
    named = names.intersection(header.words)
    if fits and (header.name in names or (named and named.issuperset(header.words))):
        return MAYBE
    return (WORD_IN_UNIT if fits else WORD) if named or header.name in names else int(fits)


def names_of(column: str) -> tuple[str, ...]:
    """What tables call a column; nothing for one that is not in the registry."""
    return CHANNELS[column].names if column in CHANNELS else ()


_OF_IMPEDANCE = {
    "resistance": "ohm",
    "inductance": "H",
    "impedance": "ohm",
    "phase": "deg",
    "reactance": "ohm",
    "parallel_resistance": "ohm",
    "parallel_inductance": "H",
}
_QUANTITIES = {"current": "A", "voltage_balance": "V", "voltage": "V", "flux_linkage": "Wb", **_OF_IMPEDANCE}

OF_CIRCUITS = frozenset(f"{quantity}_{unit}" for quantity, unit in _QUANTITIES.items())
"""Columns that may carry a circuit's name."""

_OF_CIRCUIT = re.compile(rf"({'|'.join(_QUANTITIES)})_([A-Za-z][\w-]*)_([^\W\d_]+|°)")
_UNIT_BRACKETS = re.compile(r"\s*[\[(]([^\[\]()]+)[\])]$")

FEWEST = 2
"""Derived: circuits that are several."""

_OTHER_NAMES = frozenset(name for channel in CHANNELS.values() for name in channel.names)
"""A header ``phase_angle_deg`` is the phase of no circuit named angle."""


def circuit_columns(names: Iterable[str], fewest: int = FEWEST) -> tuple[str, ...]:
    """The columns in SI that headers of several circuits mean.

    There are none where fewer than so many circuits are named, and no impedance has a circuit's name. A unit in
    brackets counts beside such an impedance alone: ``current_coil [A]`` and ``voltage_supply [V]`` are of one circuit.

    Examples
    --------
    >>> circuit_columns(["time_s", "current_bias_mA", "current_diff_A", "voltage_bias_V"])
    ('current_bias_A', 'current_diff_A', 'voltage_bias_V')
    >>> circuit_columns(["frequency_Hz", "inductance_bias [uH]"])
    ('inductance_bias_H',)
    """
    circuit_of: dict[str, str] = {}
    in_brackets: dict[str, str] = {}
    several = False
    for name in names:
        plain = _UNIT_BRACKETS.sub(r"_\1", name.strip())
        parts = _OF_CIRCUIT.fullmatch(plain)
        if parts is None or parse_header(name).name in _OTHER_NAMES:
            continue
        if unit_factor(parts[3], _QUANTITIES[parts[1]]) is not None:
            kind = circuit_of if plain == name.strip() else in_brackets
            kind[f"{parts[1]}_{parts[2]}_{_QUANTITIES[parts[1]]}"] = parts[2]
            several |= parts[1] in _OF_IMPEDANCE
    circuit_of |= in_brackets if several else {}
    return tuple(circuit_of) if several or len(set(circuit_of.values())) >= fewest else ()


def parts_of(column: str) -> tuple[str, str]:
    """A column's name without a circuit's, and that circuit's name, empty where it is of none.

    Examples
    --------
    >>> parts_of("flux_linkage_bias_Wb"), parts_of("current_A")
    (('flux_linkage_Wb', 'bias'), ('current_A', ''))
    """
    parts = _OF_CIRCUIT.fullmatch(column)
    if parts is None or _QUANTITIES[parts[1]] != parts[3]:
        return column, ""
    return f"{parts[1]}_{parts[3]}", parts[2]


def column_of(column: str, circuit: str) -> str:
    """A column as that of a circuit, or of none where its name is empty: :func:`parts_of` undone.

    Examples
    --------
    >>> column_of("flux_linkage_Wb", "bias")
    'flux_linkage_bias_Wb'
    """
    stem, _, unit = column.rpartition("_")
    return f"{stem}_{circuit}_{unit}" if circuit else column
