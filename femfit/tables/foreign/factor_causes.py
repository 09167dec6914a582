"""What a factor between flux linkage and force usually means: units, turns, parts of a model."""

import math

# factor = (flux linkage as read / true) (current as read / true) / ((force as read / true) (distance as read / true))
_CAUSES: tuple[tuple[float, str], ...] = (
    (
        1e3,
        "flux linkage in mWb read as Wb, current in mA read as A, or distance in m read as mm (--...-unit)",
    ),
    (1e6, "flux linkage in uWb read as Wb (--flux-linkage-unit uWb)"),
    (1e8, "flux linkage in maxwell read as Wb (--flux-linkage-unit Mx)"),
    (1e-3, "distance in mm read as m (--distance-unit mm), or force in mN read as N (--force-unit mN)"),
    (1e-2, "distance in cm read as m (--distance-unit cm)"),
    (1e-6, "force in uN read as N (--force-unit uN), or force in mN and distance in mm"),
    (0.0254, "distance in inches read as m (--distance-unit inch)"),
    (25.4, "distance in inches read as mm (--distance-unit inch)"),
    (1 / 25.4, "distance in mm read as inches (--distance-unit mm)"),
    (10.0, "distance in cm read as mm (--distance-unit cm)"),
    (0.1, "distance in mm read as cm (--distance-unit mm)"),
    (4.4482216, "force in lbf read as N (--force-unit lbf)"),
    (1 / 4.4482216, "force in N read as lbf (--force-unit N)"),
    (9.80665, "force in kgf read as N (--force-unit kgf)"),
    (9.80665e-3, "force in gf read as N (--force-unit gf)"),
    (0.2780139, "force in ozf read as N (--force-unit ozf)"),
    (2 * math.pi, "force of one radian of an axisymmetric model (give --force-unit 6.283185)"),
    (1 / (2 * math.pi), "flux linkage of one radian of an axisymmetric model (give --flux-linkage-unit 6.283185)"),
    (2.0, "force of one half of a symmetric model (give --force-unit 2)"),
)


def causes_of(factor: float, tolerance: float) -> list[str]:
    """Likely causes of a factor, the known ones first.

    Parameters
    ----------
    factor : float
        Flux side / force side of :mod:`femfit.tables.foreign.reciprocity`, positive.

    Returns
    -------
    list of str
        Empty if nothing usual makes such a factor.
    """
    causes = [cause for value, cause in _CAUSES if abs(math.log(factor / value)) < tolerance]
    turns = 1 / factor
    if turns > 1.5:
        causes.append(
            f"flux of one turn instead of the linkage of about {turns:.4g} turns (give --flux-linkage-unit {turns:.4g} "
            "with the exact number of turns)"
        )
    elif factor > 1.5:
        causes.append(
            f"current in ampere-turns of a coil of about {factor:.4g} turns (give --current-unit {turns:.4g}, one over "
            "the exact number of turns)"
        )
    return causes
