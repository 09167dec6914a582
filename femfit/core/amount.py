"""A quantity as people say it: ``0.20 mm``, ``12 mN``, ``4.2 %``."""

import math

_PREFIXES = {-9: "n", -6: "µ", -3: "m", 0: "", 3: "k"}
_PREFIXED = {"m", "s", "A", "N", "Wb", "V", "T", "H", "ohm", "V s"}


def amount(value: float, unit: str, digits: int = 2) -> str:
    """A value with its unit, rounded to so many digits.

    Parameters
    ----------
    unit : str
        SI; with a prefix in the result where that is usual. Empty for a share, which is given in per cent, as is
        a share per kelvin (``1/K``).
    """
    if unit in {"", "1/K", "1/K^2"}:
        return f"{rounded(100.0 * value, digits)} %{unit[1:].replace('/', ' per ').replace('^2', ' squared')}"
    if unit not in _PREFIXED or value == 0.0 or not math.isfinite(value):
        return f"{rounded(value, digits)} {unit}".rstrip()
    power = 3 * math.floor(math.log10(abs(float(f"{value:.{digits - 1}e}"))) / 3.0)
    power = min(max(power, min(_PREFIXES)), max(_PREFIXES))
    if unit == "m":
        power = -3 if abs(value) >= 1e-5 else power  # hundredths of a millimetre are what a workshop measures
    if unit == "A" and abs(value) >= 0.1:
        power = 0
    return f"{rounded(value / 10.0**power, digits)} {_PREFIXES[power]}{unit}"


def rounded(value: float, digits: int) -> str:
    """A number to so many digits, without an exponent and with its trailing zeros."""
    if value == 0.0 or not math.isfinite(value):
        return f"{value:.0f}" if value == 0.0 else str(value)
    exponent = math.floor(math.log10(abs(float(f"{value:.{digits - 1}e}"))))
    decimals = digits - 1 - exponent
    return f"{value:.{decimals}f}" if decimals > 0 else f"{round(value, decimals):.0f}"
