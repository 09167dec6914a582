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
_PREFIX = {"": 1.0, "k": 1e3, "c": 1e-2, "m": 1e-3, "u": 1e-6, "n": 1e-9}


def _with_prefixes(symbols: str, prefixes: str, factor: float = 1.0) -> dict[str, float]:
    allowed = ["", *prefixes]
    return {f"{prefix}{symbol}": _PREFIX[prefix] * factor for symbol in symbols.split() for prefix in allowed}


def _words(names: str, factor: float) -> dict[str, float]:
    return dict.fromkeys(names.split(), factor)


UNITS: dict[str, dict[str, float]] = {
    "m": {
        **_with_prefixes("m", "cmun"),
        **_words("meter metre meters metres metri metros", 1.0),
        **_words("millimeter millimetre millimeters millimetres", 1e-3),
        **_words("centimeter centimetre centimeters centimetres", 1e-2),
        **_words("micron microns", 1e-6),
        **_words("in inch inches zoll pouce pouces pulgada pollice \" ''", 0.0254),
        **_words("mil thou", 2.54e-5),
        **_words("ft", 0.3048),
    },
    "A": {
        **_with_prefixes("A", "kmu"),
        **_words("amp amps ampere amperes", 1.0),
        **_words("milliamp milliampere", 1e-3),
    },
    "N": {
        **_with_prefixes("N", "kmun"),
        **_words("newton newtons", 1.0),
        **_words("lbf lb lbs", _POUND_KG * GRAVITY),
        **_words("ozf oz", _POUND_KG * GRAVITY / 16),
        **_words("kgf kp kg kilogram kilograms kilogramm", GRAVITY),
        **_words("gf pond g gr gram grams gramme grammes gramm", GRAVITY * 1e-3),  # a kitchen scale shows force so
        **_words("mgf mg", GRAVITY * 1e-6),
        **_words("dyn dyne", 1e-5),
    },
    "Wb": {
        **_with_prefixes("Wb Vs Wbt Wbturn Wbturns", "mun"),
        **_words("weber webers", 1.0),
        **_words("Mx maxwell", 1e-8),
    },
    "H": {**_with_prefixes("H", "mun"), **_words("henry henries", 1.0)},
    "T": {**_with_prefixes("T", "mun"), **_words("tesla", 1.0), **_words("G Gs gauss", 1e-4), **_words("kG", 0.1)},
    "J": {**_with_prefixes("J", "kmun"), **_words("joule joules", 1.0)},
    "V": {**_with_prefixes("V", "kmu"), **_words("volt volts", 1.0)},
    "degC": {**_words("C degC °C celsius", 1.0)},
    "s": {**_with_prefixes("s", "mun"), **_words("sec second seconds", 1.0)},
}
"""SI unit to its spellings and their factors."""


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
    spellings = UNITS.get(si_unit, {})
    if text in spellings:
        return spellings[text]
    if len(text) > 1 and text[0] in "MGP":
        return spellings.get(text.lower()) if len(text) > 2 else None
    folded = {factor for name, factor in spellings.items() if name.casefold() == text.casefold()}
    return folded.pop() if len(folded) == 1 else None


def given_factor(unit: str, si_unit: str, header: str, source: str) -> float:
    """Return the factor to SI of a unit that a user gives by its name, or as the number that multiplies a column."""
    factor = unit_factor(unit, si_unit) if si_unit else None
    if factor is None:
        try:
            factor = float(unit)
        except ValueError:
            factor = math.nan
    if not math.isfinite(factor) or factor == 0.0:
        known = f"{', '.join(list(UNITS[si_unit])[:8])}... or " if si_unit else ""
        raise TableError(
            f"{source}: {quoted(unit)!r} is not a unit of column {quoted(header)!r}. Give {known}a number that "
            f"multiplies it{' to ' + si_unit if si_unit else ''}."
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
    return (stem, "degC" if unit == "C" else unit) if stem else (column, "")
