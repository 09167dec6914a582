"""The part of a FEMM material's B-H curve that a magnetisation curve can be."""

from femfit.core.constants import MU_0

TOLERANCE = 0.01
"""dB/dH below mu_0 by more than this is no rounding; actuator files have the same limit."""

FEWEST = 3
"""Points that a curve keeps."""

Curve = tuple[tuple[float, float], ...]


def rising_part(curve: Curve) -> Curve:
    """The curve without its last points as long as it ends with a slope below mu_0.

    Library curves are extrapolated by hand far into saturation, and there some rise more slowly than vacuum. FEMM
    smooths such a curve; here it is cut, for beyond its last point the field solver goes on with mu_0 anyway.

    Parameters
    ----------
    curve : tuple of (float, float)
        B in T and H in A/m.

    Returns
    -------
    tuple of (float, float)
        Three points at least, or the curve as it was if it has fewer.
    """
    kept = curve
    while len(kept) > FEWEST:
        (flux, field), (last_flux, last_field) = kept[-2:]
        if last_flux - flux >= (1.0 - TOLERANCE) * MU_0 * (last_field - field):
            break
        kept = kept[:-1]
    return kept
