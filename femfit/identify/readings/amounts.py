"""Numbers of a bench as people say them: ``18 mm``, ``0.42 mN``, ``27 °C``."""

import math
from collections.abc import Mapping

from femfit.effects.effect import Effect

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
    name : str
        Of a column: ``distance_m``, ``force_N``, ``coil_temperature_C``.

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
    """A ratio as one says it.

    Returns
    -------
    str
        Two decimals below 100, four digits above, without an exponent below a million.
    """
    if ratio < 100.0:
        return f"{ratio:.2f}"
    return f"{ratio:.0f}" if ratio < 1e6 else f"{ratio:.1e}"


def magnitudes(effect: Effect | None, amplitudes: Mapping[str, float]) -> str:
    """Smallest magnitudes that data show.

    Parameters
    ----------
    effect : Effect or None
        None for one outside the catalogue, of whose units nothing is said.
    amplitudes : mapping of str to float
        Infinite where the amplitude's bounds end before.

    Returns
    -------
    str
        Those within the bounds, with units, or that there is none.
    """
    finite = ((key, value) for key, value in amplitudes.items() if value < float("inf"))
    return ", ".join(f"{key} {value:.2g}{unit_of(effect, key)}" for key, value in finite) or "none within its bounds"


def unit_of(effect: Effect | None, parameter: str) -> str:
    """The unit of an effect's parameter, to be put behind a value.

    Returns
    -------
    str
        `` V``, `` of force_N`` (a part of that quantity's largest value in the model's range), or empty.
    """
    for p in effect.parameters if effect else ():
        if p.name == parameter and (p.unit or p.scale):
            return f" {p.unit}" if p.unit else f" of {p.scale}"
    return ""
