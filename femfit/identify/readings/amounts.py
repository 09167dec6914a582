"""Numbers of a bench as people say them: ``18 mm``, ``0.42 mN``, ``27 °C``."""

import math

_PREFIXES = {-9: "n", -6: "µ", -3: "m", 0: "", 3: "k"}
_UNITS = {"m": "m", "A": "A", "N": "N", "Wb": "Wb", "V": "V", "T": "T", "ohm": "ohm", "H": "H", "kg": "kg"}

CHANNEL_WORDS = {
    "force_N": "force",
    "flux_linkage_Wb": "flux linkage",
    "hall_V": "Hall output",
    "voltage_V": "coil voltage",
    "force_balance_N": "force that the motion shows",
    "voltage_balance_V": "commanded voltage",
}
"""Channels as they are called in sentences."""


def amount(value: float, name: str, digits: int = 2) -> str:
    """A value of a column with a prefixed unit.

    Parameters
    ----------
    value : float
        In the unit that the name ends in.

    Returns
    -------
    str
        Currents in A and distances in mm, everything else with the prefix that fits.
    """
    unit = name.rpartition("_")[2]
    if unit == "C":
        return f"{value:.{max(digits, 3)}g} °C"
    if unit not in _UNITS:
        return f"{value:.{max(digits, 3)}g}"
    if not math.isfinite(value) or value == 0.0:
        return f"{value:g} {_UNITS[unit]}"
    rounded = float(f"{value:.{digits - 1}e}")
    power = min(max(3 * math.floor(math.log10(abs(rounded)) / 3.0), min(_PREFIXES)), max(_PREFIXES))
    if unit == "A":
        power = 0 if abs(rounded) >= 0.01 else power
    elif name.startswith("distance") and 1e-4 <= abs(rounded) < 1.0:
        power = -3
    return f"{rounded / 10.0**power:.6g} {_PREFIXES[power]}{_UNITS[unit]}"


def chance(p_value: float) -> str:
    """A p-value in words.

    Returns
    -------
    str
        ``p = 0.03``, or ``p < 1e-12`` for all below.
    """
    return f"p = {p_value:.2g}" if p_value > 1e-12 else "p < 1e-12"


def times(ratio: float) -> str:
    """A ratio as one says it."""
    if ratio < 100.0:
        return f"{ratio:.2f}"
    return f"{ratio:.0f}" if ratio < 1e6 else f"{ratio:.1e}"
