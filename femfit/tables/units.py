"""Units as they are written in column headers, and their factors to SI.

References
----------
The international inch (0.0254 m), pound (0.45359237 kg) and standard gravity (9.80665 m/s^2) are exact.
"""

import math
import unicodedata

from femfit.core.constants import GRAVITY
from femfit.core.errors import TableError
from femfit.core.quoted import quoted

_POUND_KG = 0.45359237
_FOLDED_PREFIX = {"": 1.0, "k": 1e3, "c": 1e-2, "m": 1e-3, "u": 1e-6, "n": 1e-9}
_CASED_PREFIX = {"h": 1e2, "da": 1e1, "d": 1e-1, "p": 1e-12}
"""Prefixes that count only as they are written: ``dB/dt`` is not in decitesla. Mega and giga are left out: no actuator
has them, and they would be a mistyped milli."""

_SYMBOLS = {name: name for name in ("m", "A", "N", "H", "T", "J", "V", "s")} | {"Wb": "Wb Vs Wbt Wbturn Wbturns"}
"""SI unit to the symbols that take a prefix."""

_WORDS: dict[str, dict[str, float]] = {
    "m": {
        "meter metre meters metres": 1.0,
        "millimeter millimetre millimeters millimetres": 1e-3,
        "centimeter centimetre centimeters centimetres": 1e-2,
        "micron microns": 1e-6,
        "in inch inches zoll \" ''": 0.0254,
        "mil thou": 2.54e-5,
        "ft": 0.3048,
    },
    "A": {"amp amps ampere amperes": 1.0, "milliamp milliampere": 1e-3},
    "N": {
        "newton newtons": 1.0,
        "lbf lb lbs": _POUND_KG * GRAVITY,
        "ozf oz": _POUND_KG * GRAVITY / 16,
        "kgf kp kg kilogram kilograms kilogramm": GRAVITY,
        "gf pond g gr gram grams gramme grammes gramm": GRAVITY * 1e-3,  # a kitchen scale shows force so
        "mgf mg": GRAVITY * 1e-6,
        "dyn dyne": 1e-5,
    },
    "Wb": {"weber webers": 1.0, "Mx maxwell": 1e-8},
    "H": {"henry henries": 1.0},
    "T": {"tesla": 1.0, "G Gs gauss": 1e-4, "kG": 0.1},
    "J": {"joule joules": 1.0},
    "V": {"volt volts": 1.0},
    "m/s2": {"m/s2 m/s^2 ms2 m/s/s": 1.0, "mm/s2 mm/s^2": 1e-3, "g": GRAVITY, "mg": GRAVITY * 1e-3},
    "degC": {"C degC °C celsius": 1.0},
    "s": {"sec second seconds": 1.0, "min minute minutes": 60.0, "h hr hour hours": 3600.0},
    "Hz": {"Hz hertz": 1.0, "kHz": 1e3, "MHz MHZ": 1e6, "rad/s rads": 0.5 / math.pi},
    "deg": {"deg degs degree degrees ° grad": 1.0, "rad radian radians": 180.0 / math.pi},
    "share": {"share": 1.0, "percent": 1e-2, "%": 1e-2},
    "ohm": {"ohm ohms Ω": 1.0, "mohm mohms mΩ milliohm": 1e-3, "kohm kohms kΩ": 1e3},
}


def _symbols(si_unit: str, prefixes: dict[str, float]) -> dict[str, float]:
    symbols = _SYMBOLS.get(si_unit, "").split()
    return {f"{prefix}{symbol}": factor for symbol in symbols for prefix, factor in prefixes.items()}


_FOLDED = {
    si_unit: _symbols(si_unit, _FOLDED_PREFIX)
    | {word: factor for words, factor in table.items() for word in words.split()}
    for si_unit, table in _WORDS.items()
}
UNITS = {si_unit: spellings | _symbols(si_unit, _CASED_PREFIX) for si_unit, spellings in _FOLDED.items()}
"""SI unit to its spellings and their factors."""


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
    text = unicodedata.normalize("NFKC", unit).strip()
    text = text.replace("μ", "u").replace("µ", "u")
    text = "".join(character for character in text if character not in " .-*·⋅_")
    if text in UNITS.get(si_unit, {}):
        return UNITS[si_unit][text]
    spellings = _FOLDED.get(si_unit, {})
    if len(text) > 1 and text[0] in "MGP":
        return spellings.get(text.lower()) if len(text) > 2 else None
    folded = {factor for name, factor in spellings.items() if name.casefold() == text.casefold()}
    return folded.pop() if len(folded) == 1 else None


def given_factor(unit: str, si_unit: str, header: str, source: str, column: str) -> float:
    """Return the factor to SI of a unit that a user gives by its name, or as the number that multiplies a column."""
    factor = unit_factor(unit, si_unit) if si_unit else None
    if factor is None:
        try:
            factor = float(unit)
        except ValueError:
            factor = math.nan
    if not math.isfinite(factor) or factor == 0.0:
        examples = f"{', '.join(list(UNITS[si_unit])[:8])}... or " if si_unit else ""
        volts = si_unit == "m" and unit_factor(unit, "V") is not None
        raise TableError(
            f"{source}: {quoted(unit)!r} is not a unit of column {quoted(header)!r}. Give {examples}a number that "
            f"multiplies it{' to ' + si_unit if si_unit else ''}, with --unit {column}=UNIT."
            + (f" {POSITION_IN_VOLTS}" if volts else "")
        )
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
