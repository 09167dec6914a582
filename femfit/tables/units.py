"""What a column may hold, and in which unit: the registry of channels, units and their factors to SI.

``channels.toml`` and ``units.toml`` say what each field means.
"""

import math
import tomllib
import unicodedata
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib.resources import files
from itertools import product
from typing import Any

from femfit.core.results import Finding
from femfit.core.text import quoted
from femfit.tables.findings import finding, refused


@dataclass(frozen=True)
class Channel:
    """A row of the registry."""

    names: tuple[str, ...] = ()
    noun: str = ""
    bench: str = ""  # setting, reading, or empty for what is no column of a bench table
    absent: float = math.nan
    record: int = 0
    circuits: str = ""
    sensor: bool = False
    usual: float = math.inf
    least: float = -math.inf
    possible: float = math.inf
    units: Sequence[str] = ()


_ENTRIES = tomllib.loads((files("femfit.tables") / "channels.toml").read_text(encoding="utf-8"))

_NAMES = {name: entry.get("names", "").split() for name, entry in _ENTRIES.items()}

CHANNELS: dict[str, Channel] = {
    name: Channel(**entry | {"names": tuple(word.lstrip("?").casefold() for word in _NAMES[name])})
    for name, entry in _ENTRIES.items()
}
"""Channel to its row."""

NEEDS_UNIT = frozenset(word[1:] for words in _NAMES.values() for word in words if word.startswith("?"))
"""Names that mean their channel only beside a unit of its kind."""

CAPITALS = {word.casefold(): name for name, words in _NAMES.items() for word in words if word.isupper()}
"""Letter to the channel whose symbol it is as a capital: F is a force, and f a frequency."""

_FOLDED_PREFIXES = {"": 1.0, "k": 1e3, "c": 1e-2, "m": 1e-3, "u": 1e-6, "n": 1e-9}
_CASED_PREFIXES = {"h": 1e2, "da": 1e1, "d": 1e-1, "p": 1e-12}
"""Prefixes that count only as they are written: ``dB/dt`` is not in decitesla."""

_KINDS = tomllib.loads((files("femfit.tables") / "units.toml").read_text(encoding="utf-8"))


def _spellings(kind: Mapping[str, Any], prefixes: Mapping[str, float]) -> dict[str, float]:
    symbols = product(kind.get("symbols", "").split(), prefixes.items())
    return {prefix + symbol: factor for symbol, (prefix, factor) in symbols}


_FOLDED: dict[str, dict[str, float]] = {
    si_unit: _spellings(kind, _FOLDED_PREFIXES)
    | {word: factor for words, factor in kind["words"].items() for word in words.split()}
    for si_unit, kind in _KINDS.items()
}
UNITS = {si_unit: _FOLDED[si_unit] | _spellings(kind, _CASED_PREFIXES) for si_unit, kind in _KINDS.items()}
"""SI unit to its spellings and their factors."""


_PLAIN = str.maketrans({"μ": "u", **dict.fromkeys(" .-*·⋅_", "")})

SMALLEST_FACTOR = 1e-15
"""Conventional: units of what is measured lie between a femto of SI and as much beyond it."""

POSITION_IN_VOLTS = (
    "Readings in volts belong in the column position_V (--column HEADER=position_V): the gain and offset, or the "
    "table, of the drawing's position sensor make the distance of them."
)


def unit_factor(unit: str, si_unit: str) -> float | None:
    """Return the factor that turns a number in ``unit`` into ``si_unit``; None if it is not a unit of that kind.

    Case is ignored only where no other unit differs by it: mega is not milli.

    Examples
    --------
    >>> unit_factor("mm", "m"), unit_factor("Wb-turns", "Wb"), unit_factor("MN", "N")
    (0.001, 1.0, None)
    """
    text = unicodedata.normalize("NFKC", unit).strip().translate(_PLAIN)
    if text in UNITS.get(si_unit, {}):
        return UNITS[si_unit][text]
    spellings = _FOLDED.get(si_unit, {})
    if len(text) > 1 and text[0] in "MGP":
        return spellings.get(text.lower()) if len(text) > 2 else None
    folded = {factor for name, factor in spellings.items() if name.casefold() == text.casefold()}
    return folded.pop() if len(folded) == 1 else None


def given_factor(unit: str, si_unit: str, header: str, source: str, column: str) -> float:
    """Return the factor to SI of a unit that a user gives by its name, or as the number that multiplies a column."""
    factor = unit_factor(unit, si_unit)
    if factor is None:
        with suppress(ValueError):
            factor = float(unit)
    if factor is None or not SMALLEST_FACTOR <= abs(factor) <= 1.0 / SMALLEST_FACTOR:  # nor is NaN
        examples = f"{', '.join(list(UNITS[si_unit])[:8])}... or " if si_unit else ""
        volts = POSITION_IN_VOLTS if si_unit == "m" and unit_factor(unit, "V") is not None else ""
        facts = {"unit": quoted(unit), "header": quoted(header), "examples": examples, "volts": volts}
        raise refused("no-unit", source=source, to=f" to {si_unit}" if si_unit else "", option=column, **facts)
    return factor


def is_unit(unit: str) -> bool:
    """Tell whether the text is a unit of any kind that a table can hold."""
    return any(unit_factor(unit, si_unit) is not None for si_unit in UNITS)


def column_unit(column: str) -> tuple[str, str]:
    """Split a column's name into its quantity and its SI unit; ``run``, ``mount``, ``order``, ``branch`` have none.

    Examples
    --------
    >>> column_unit("flux_linkage_Wb"), column_unit("run")
    (('flux_linkage', 'Wb'), ('run', ''))
    """
    stem, _, unit = column.rpartition("_")
    if column.endswith("_m_s2"):
        return column.removesuffix("_m_s2"), "m/s2"
    return (stem, "degC" if unit == "C" else unit) if stem else (column, "")


def possible_range(column: str) -> tuple[float, float]:
    """Between which numbers a column of one circuit lies on every bench."""
    channel = CHANNELS.get(column, Channel())
    return max(channel.least, -channel.possible), channel.possible


LEAST_READINGS = 8
"""Assumed: fewer readings are no ground for a suspicion."""

OTHER_SIGN = "of the other sign"


def common_factors(column: str) -> dict[str, float]:
    """Units that a column is often in without saying so, each with the factor to SI; nothing for one without."""
    return {unit: UNITS[column_unit(column)[1]][unit] for unit in CHANNELS.get(column, Channel()).units}


def suspicion(column: str, unit: str, why: str) -> Finding:
    """Say that a column seems to be in another unit than its name says: what a reader must know before any number."""
    return finding("suspected-unit", column=column, unit=unit, why=why)


def other_sign(why: str, name: str = "current_A") -> Finding:
    """Say that a column, the current where none is named, seems to count the other way round."""
    convention = "" if name == "distance_m" else " (positive current attracts)"
    return finding("suspected-sign", column=name, convention=convention, why=why)
