"""Numbers with their unit and formulas, as text."""

import math
import re

from markupsafe import Markup, escape

from femfit.core.amount import amount, probability, rounded

NO_BREAK = "\u00a0"

NOTHING = "–"
"""In place of a number that there is none of."""

_EXPONENT = re.compile(r"\^(?:\((-?[\d/]+)\)|(-?\d+))")

_POWER = re.compile(r"e([+-]?\d+)")
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def quantity(value: float | None, unit: str, digits: int = 3) -> str:
    """An amount as it is set on a page."""
    number, _, unit = amount(value, unit.replace("Ω", "ohm"), digits).partition(" ")
    return f"{_set(number)}{NO_BREAK}{unit}".rstrip().replace("ohm", "Ω")


def percent(fraction: float | None, digits: int = 2) -> str:
    """A fraction in per cent."""
    return quantity(fraction, "", digits)


def significant(value: float, digits: int = 3) -> str:
    """A number with so many significant digits, in powers of ten where it is very large or small."""
    return _set(rounded(value, digits)) if math.isfinite(value) else NOTHING


def p_value(value: float) -> str:
    """A probability as it is set on a page."""
    return _set(probability(value))


def _set(number: str) -> str:
    return _POWER.sub(lambda m: f"·10{str(int(m[1])).translate(_RAISED)}", number).replace("-", "−")


def plain(value: float, digits: int = 6) -> str:
    """A number that was typed in, with no digit more than it had."""
    return f"{value:.{digits}g}".replace("-", "−") if math.isfinite(value) else NOTHING


def formula_markup(formula: str) -> Markup:
    """A formula for the page, from plain text with exponents as ``^-4`` or ``^(-3/2)``."""
    raised = _EXPONENT.sub(lambda m: f"<sup>{m[1] or m[2]}</sup>".replace("-", "−"), str(escape(formula)))
    return Markup(raised)  # noqa: S704 - escaped before
