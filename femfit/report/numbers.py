"""Numbers with their unit and formulas, as text."""

import math
import re

import numpy as np
from markupsafe import Markup, escape

from femfit.core.arrays import FloatArray

NO_BREAK = "\u00a0"

NOTHING = "–"
"""In place of a number that there is none of."""

_EXPONENT = re.compile(r"\^(?:\((-?[\d/]+)\)|(-?\d+))")

_PREFIXES = {-15: "f", -12: "p", -9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M"}


def quantity(value: float | None, unit: str, digits: int = 3) -> str:
    """A number with an SI prefix before its unit.

    Parameters
    ----------
    value : float or None
        In the unit; None becomes ``unknown``.
    """
    if value is None or not math.isfinite(value):
        return "unknown"
    if value == 0.0:
        return f"0{NO_BREAK}{unit}"
    # Rounded first: 999.96 mN is 1.00 N
    rounded = float(f"{value:.{digits - 1}e}")
    power = min(max(3 * math.floor(math.log10(abs(rounded)) / 3.0), min(_PREFIXES)), max(_PREFIXES))
    return f"{significant(rounded / 10.0**power, digits)}{NO_BREAK}{_PREFIXES[power]}{unit}"


def noise_words(noise_V: float) -> str:
    """A sensor's noise as one says it."""
    return f"noise of {quantity(noise_V, 'V')} rms" if noise_V else "its noise not known"


def percent(fraction: float | None, digits: int = 2) -> str:
    """A fraction in per cent."""
    if fraction is None or not math.isfinite(fraction):
        return "unknown"
    return f"{significant(100.0 * fraction, digits)}{NO_BREAK}%"


def significant(value: float, digits: int = 3) -> str:
    """A number with so many significant digits, in powers of ten where it is very large or small."""
    if not math.isfinite(value):
        return NOTHING
    if value == 0.0:
        return "0"
    value = float(f"{value:.{digits - 1}e}")
    exponent = math.floor(math.log10(abs(value)))
    if -4 <= exponent < max(digits, 6):
        return f"{value:.{max(digits - 1 - exponent, 0)}f}".replace("-", "−")
    power = str(exponent).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    return f"{value / 10.0**exponent:.{digits - 1}f}·10{power}".replace("-", "−", 1)


def plain(value: float, digits: int = 6) -> str:
    """A number that was typed in, with no digit more than it had."""
    return f"{value:.{digits}g}".replace("-", "−") if math.isfinite(value) else NOTHING


def force_scale(force: FloatArray) -> tuple[float, str]:
    """Factor and unit in which forces are drawn."""
    return (1.0, "N") if float(np.max(np.abs(force))) > 2.0 else (1e3, "mN")


def p_value(value: float) -> str:
    """A probability as ``= 0.03`` or ``< 10⁻⁶``."""
    return "< 10⁻⁶" if value < 1e-6 else f"= {significant(value, 2)}"


def formula_markup(formula: str) -> Markup:
    """A formula for the page.

    Parameters
    ----------
    formula : str
        In plain text, exponents as ``^-4`` or ``^(-3/2)``.
    """
    raised = _EXPONENT.sub(lambda m: f"<sup>{_minus(m)}</sup>", str(escape(formula)))
    return Markup(raised)  # noqa: S704 - escaped before


def formula_label(formula: str) -> str:
    """A formula for a picture's label."""
    return _EXPONENT.sub(lambda m: f"$^{{{_minus(m)}}}$", formula)


def _minus(match: re.Match[str]) -> str:
    return (match[1] or match[2]).replace("-", "−")
