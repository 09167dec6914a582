"""A quantity as people say it: ``0.20 mm``, ``12 mN``, ``4.2 %``.

All that femfit prints or writes for readers is rounded and prefixed here; foreign text loses its control characters,
and is cut short.
"""

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from femfit.core.numerics import FloatArray

_PREFIXES = {-12: "p", -9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M"}
_PREFIXED = {*("m", "s", "A", "N", "Wb", "V", "T", "H", "Hz", "W", "J", "ohm", "g"), "V s"}
_PREFIXED |= {"T/A", "V/A", "V/T", "N/A", "N/m"}
_MOST_DIGITS = 5  # Of the larger end of an interval
_SAME = 1e-9  # Relative width of an interval below which its ends are one number
_SHARES = {"", "1/K", "1/K^2"}


def weighed_amount(value: float, name: str, magnitude: float | None, digits: int = 2) -> str:
    """As :func:`amount`; of an impedance that is given at a magnitude |Z|, as a share of it."""
    return f"{amount(value / magnitude, '', digits)} of |Z|" if magnitude else amount(value, name, digits)


def amount(value: float | None, unit: str, digits: int = 2) -> str:
    """A value with its unit, rounded to so many digits; a value that is not finite is ``unknown``.

    The unit is in SI, or a column's name that ends in one (``force_N``); empty for a share, which is given in per cent,
    as is a share per kelvin (``1/K``). The prefix is what a workshop says: mm from 0.1 mm to 1 m, A from 0.1 A.
    """
    unit = _unit_of(unit)
    if value is None or not math.isfinite(value):
        return "unknown"
    factor, shown = _shown(abs(float(f"{value:.{digits - 1}e}")), unit)
    return f"{f'{value:.{max(digits, 3)}g}' if unit == 'C' else rounded(factor * value, digits)} {shown}"


def _shown(size: float, unit: str) -> tuple[float, str]:
    """Factor and words of a unit, after the size of what is said in it."""
    if unit in _SHARES:
        return 100.0, f"%{unit[1:].replace('/', ' per ').replace('^2', ' squared')}"
    return (1.0, "°C") if unit == "C" else _scale(size, unit)


def _unit_of(name: str) -> str:
    """The unit at the end of a name: ``N`` of ``force_N``, ``N/m`` of ``stiffness_N_per_m``."""
    front, per, below = name.rpartition("_per_")
    return f"{front.rpartition('_')[2]}/{below}" if per else name.rpartition("_")[2]


def amount_range(low: float, high: float, unit: str, digits: int = 2) -> str:
    """An interval in one unit, ``0.098 to 0.104 mm``, with the digits that tell its ends apart; equal ends once.

    ``digits`` are those of the end that is larger in magnitude.
    """
    if low == high or abs(high - low) <= _SAME * max(abs(low), abs(high)) < math.inf:
        return amount(low if abs(low) > abs(high) else high, unit, digits)
    common = _in_common(low, high, unit, digits)
    if common is None:
        return f"{amount(low, unit, digits)} to {amount(high, unit, digits)}"
    factor, places, shown = common
    texts = [f"{factor * end:z.{places}f}" for end in (low, high)]
    return f"{' to '.join(dict.fromkeys(texts))} {shown}"


def amount_in(value: float, low: float, high: float, unit: str) -> str:
    """A value as its interval is written, which then contains it: ``0.204 mm`` of 0.202 to 0.205 mm.

    Equal decimals keep the order of what they round.
    """
    common = None if abs(high - low) <= _SAME * max(abs(low), abs(high)) else _in_common(low, high, unit)
    if common is None:
        return amount(value, unit)
    factor, places, shown = common
    return f"{factor * value:z.{places}f} {shown}"


def _in_common(low: float, high: float, unit: str, digits: int = 2) -> tuple[float, int, str] | None:
    """Factor, decimals and prefixed unit that both ends of an interval have; None of ends that cannot share them."""
    largest, width = max(abs(low), abs(high)), abs(high - low)
    if not math.isfinite(low) or not math.isfinite(high) or largest == 0.0:
        return None
    factor, shown = _shown(float(f"{largest:.{digits - 1}e}"), _unit_of(unit))
    if not 1e-5 <= factor * largest < 1e6:
        return None
    # A digit of the width where the ends are near each other, and one of an end that is far smaller
    wanted = [(factor * largest, digits), (factor * width, 1), *((factor * abs(end), 1) for end in (low, high) if end)]
    places = max(0, -max(min(_place(*place) for place in wanted), _place(factor * largest, _MOST_DIGITS)))
    return factor, places, shown


def _place(value: float, digits: int) -> int:
    """Power of ten of the last of so many digits."""
    return math.floor(math.log10(value) + 1e-12) - digits + 1


def axis_scale(values: "FloatArray", unit: str) -> tuple[float, str]:
    """Factor and prefixed unit in which values of one axis are drawn, after the largest of them."""
    import numpy as np  # noqa: PLC0415  the command line's help needs none

    sizes = np.abs(np.asarray(values, dtype=float))
    return _scale(float(np.max(sizes[np.isfinite(sizes)], initial=0.0)), _unit_of(unit))


def _scale(size: float, unit: str) -> tuple[float, str]:
    if unit == "kg":
        factor, prefixed = _scale(1e3 * size, "g")
        return 1e3 * factor, prefixed
    if unit not in _PREFIXED or size < 1e-15:
        return 1.0, unit
    power = min(max(3 * math.floor(math.log10(size) / 3.0 + 1e-12), min(_PREFIXES)), max(_PREFIXES))
    if unit == "m" and 1e-4 <= size < 1.0:
        power = -3
    if unit == "A" and 0.1 <= size < 1e3:
        power = 0
    return 10.0**-power, _PREFIXES[power] + unit


def rounded(value: float, digits: int = 3) -> str:
    """A number to so many digits with its trailing zeros, in powers of ten where it is very large or small."""
    if value == 0.0 or not math.isfinite(value):
        return "0" if value == 0.0 else "unknown"
    written = f"{value:.{digits - 1}e}"
    exponent = int(written.partition("e")[2])
    if not -5 <= exponent < max(digits, 6):
        return written
    return f"{float(written):.{max(digits - 1 - exponent, 0)}f}"


def counted(number: int, singular: str, many: str = "") -> str:
    """A number with its noun, and its verb where one is given: ``1 reading lies``, ``1,200 readings lie``.

    Parameters
    ----------
    many : str
        What stands behind other numbers than one; the word for one and an s where empty.

    Examples
    --------
    >>> counted(1, "reading lies", "readings lie"), counted(1200, "reading")
    ('1 reading lies', '1,200 readings')
    """
    return f"{number:,} {singular if number == 1 else many or singular + 's'}"


def probability(value: float) -> str:
    """A probability as ``p = 0.03``, or ``p < 1e-06`` for all below."""
    return f"p = {rounded(value, 2)}" if value >= 1e-6 else "p < 1e-06"


_LONGEST = 80


def quoted(text: object, longest: int = _LONGEST) -> str:
    r"""Make a name or a cell of somebody's file fit for a terminal and a log.

    Examples
    --------
    >>> quoted("Kraft\x1b[31m [g]")
    'Kraft\\x1b[31m [g]'
    >>> quoted(1000 * "x", longest=5)
    'xxxxx...'
    """
    characters = str(text)
    start = "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in characters[:longest])
    return start if len(characters) <= longest else f"{start}..."
