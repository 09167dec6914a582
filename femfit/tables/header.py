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
from enum import IntEnum
from functools import lru_cache

from femfit.core.results import listing
from femfit.core.text import quoted
from femfit.tables.findings import refused
from femfit.tables.raw_table import looks_numeric
from femfit.tables.units import CAPITALS, CHANNELS, NEEDS_UNIT, Channel, column_unit, is_unit, unit_factor

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


class Likeness(IntEnum):
    """How surely a header names a column; below ``MAYBE`` it is only asked about."""

    UNIT = 1  # Its unit alone is of the kind
    WORD = 2  # A word of it is a name
    WORD_IN_UNIT = 3  # Beside a unit of the kind
    MAYBE = 4
    SYMBOL = 5  # It is the column's letter, in the case that tells it from another's
    SURE = 6  # It is the column's name


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
    brackets = [(match, match[1].strip()) for match in reversed(list(_BRACKETS.finditer(stripped)))]
    units = [match for match, inner in brackets if is_unit(inner)]
    units += [  # or what is more likely a unit that is none of ours than a part of the name
        match
        for match, inner in brackets
        if " " not in inner and (len(inner) <= 6 or match[0][0] == "[") and not looks_numeric(inner)
    ]
    name, unit = stripped, None
    if units:
        unit, name = units[0][1].strip(), f"{stripped[: units[0].start()]} {stripped[units[0].end() :]}"
    for trailing in (pattern.search(stripped) for pattern in _TRAILING if unit is None):
        if trailing and trailing.start() > 0 and is_unit(trailing[1].replace("_", "/")):
            unit, name = trailing[1].replace("_", "/"), stripped[: trailing.start()]
            break
    words = tuple(word.casefold() for word in _WORD.findall(plain(name)))
    return Header(stripped, words, unit)


def with_unit(name: str, unit: object) -> str:
    """Return a column's name with its unit in brackets, where it does not say one itself."""
    text = unit.decode("utf-8", "replace") if isinstance(unit, bytes) else unit
    missing = isinstance(text, str) and text.strip() and parse_header(name).unit is None
    return f"{name} [{str(text).strip()}]" if missing else name


def matching_headers(key: str, headers: Sequence[str]) -> list[str]:
    """The headers that a user means: as they are written, or but for case, or without their units."""
    exact, key = [header for header in headers if header.strip() == key.strip()], key.strip().casefold()
    return exact or [
        header for header in headers if key in {header.strip().casefold(), " ".join(parse_header(header).words)}
    ]


def find_header(key: str, headers: Sequence[str], source: str, option: str) -> str:
    """Find the header that a user means."""
    matches = matching_headers(key, headers)
    if len(matches) != 1:
        named = listing((header for header in headers if header.strip()), 20) or "without names (give --columns)"
        raise refused("no-such-column", source=source, key=quoted(key), option=option, headers=named)
    return matches[0]


def score(header: Header, column: str) -> int:
    """Tell how surely a header names a column; a unit of another kind makes it 0.

    It may be the column as a name of one letter, or one that means several things beside a unit of the right kind, or
    where it is made of the column's names as in ``Spannung U [mV]``.
    """
    stem, si_unit = column_unit(column)
    fits = bool(si_unit) and unit_factor(header.unit or "", si_unit) is not None
    if header.unit is not None and not fits:
        return 0
    names = {re.sub("[_-]", "", stem).casefold(), *CHANNELS.get(column, Channel()).names}
    named = names.intersection(header.words)
    if header.name in names and header.name not in NEEDS_UNIT:
        capital = header.name.upper() in header.text
        symbol = header.name in CAPITALS and capital == (CAPITALS[header.name] == column)
        return Likeness.SURE if fits or len(header.name) > 1 else Likeness.SYMBOL if symbol else Likeness.MAYBE
    if fits and (header.name in names or (named and named.issuperset(header.words))):
        return Likeness.MAYBE
    return (Likeness.WORD_IN_UNIT if fits else Likeness.WORD) if named or header.name in names else int(fits)


OF_CIRCUITS = frozenset(name for name, channel in CHANNELS.items() if channel.circuits)
"""Columns that may carry a circuit's name."""

_QUANTITIES = dict(map(column_unit, sorted(OF_CIRCUITS, key=len, reverse=True)))
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
    for name in map(str.strip, names):
        plain = _UNIT_BRACKETS.sub(r"_\1", name)
        parts = _OF_CIRCUIT.fullmatch(plain)
        if parts is None or parse_header(name).name in _OTHER_NAMES:
            continue
        quantity, circuit, unit = parts.groups()
        if unit_factor(unit, _QUANTITIES[quantity]) is not None:
            column, of_kind = f"{quantity}_{_QUANTITIES[quantity]}", circuit_of if plain == name else in_brackets
            of_kind[column_of(column, circuit)] = circuit
            several |= CHANNELS[column].circuits == "impedance"
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
    of_circuit = parts is not None and _QUANTITIES[parts[1]] == parts[3]
    return (f"{parts[1]}_{parts[3]}", parts[2]) if parts and of_circuit else (column, "")


def column_of(column: str, circuit: str) -> str:
    """A column as that of a circuit, or of none where its name is empty: :func:`parts_of` undone.

    Examples
    --------
    >>> column_of("flux_linkage_Wb", "bias")
    'flux_linkage_bias_Wb'
    """
    stem, _, unit = column.rpartition("_")
    return f"{stem}_{circuit}_{unit}" if circuit else column
