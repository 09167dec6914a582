"""Whether force and flux linkage of a table belong to one co-energy, and if not, the likely reason."""

from collections.abc import Callable

import numpy as np
import pandas as pd
from scipy.interpolate import CubicSpline

from femfit.core.arrays import FloatArray
from femfit.core.finding import Finding
from femfit.tables.foreign.check_grid import complete_grid
from femfit.tables.foreign.factor_causes import causes_of
from femfit.tables.foreign.reciprocity import LoopComparison, compare_loops

_AGREES = 0.02
"""First-order field solutions keep reciprocity within 1 %; coarse grids add as much by integration."""

_WRONG = 0.10
"""No mesh does this: units, turns or another quantity."""

_SAME_SHAPE = 0.10
"""Spread of the factor over the loops below which the two sides have one shape."""

_NO_MAGNET = 0.01
"""Force at zero current over the largest force, up to which there is no magnet but numerical noise."""

FluxOf = Callable[[FloatArray, FloatArray], FloatArray]


def apparent(currents: FloatArray, column: FloatArray) -> FloatArray:
    """Return the flux linkage (Wb) of an apparent inductance, flux linkage / current, shape (n, m) in H."""
    return column * currents


def differential(currents: FloatArray, column: FloatArray) -> FloatArray:
    """Integrate d(flux linkage)/di, shape (n, m) in H, from the first of ascending currents: flux linkage in Wb."""
    integral: FloatArray = CubicSpline(currents, column, axis=1).antiderivative()(currents)
    return integral


def check_reciprocity(points: pd.DataFrame) -> list[Finding]:
    """Compare the force's work with the flux linkage's, and name what a disagreement means.

    Returns
    -------
    list of Finding
        ``reciprocity``: info if it holds or cannot be judged, warning up to 10 %, error beyond; none without a column
        of flux linkages.
    """
    if "flux_linkage" not in points:
        return []
    distances, currents, (force, flux) = complete_grid(points, ["force", "flux_linkage"])
    if len(distances) < 3 or len(currents) < 2:
        text = "Reciprocity was not checked: it needs a complete grid of at least 2 currents and 3 distances."
        return [Finding("reciprocity", "info", text)]
    plain = compare_loops(distances, currents, force, flux)
    if plain.loops == 0:
        text = "Reciprocity cannot be judged: flux linkage or force does not change with distance and current."
        return [Finding("reciprocity", "warning", text, "Check that the right columns were taken.")]
    if plain.spread < _SAME_SHAPE:
        return [_judge_factor(plain)]
    return [_judge_shape(plain, distances, currents, force, flux)]


def _judge_factor(loops: LoopComparison) -> Finding:
    error = abs(loops.factor - 1)
    if error < _WRONG:
        size = f"dF/di and -d(flux linkage)/dd agree within {100 * error:.2g} % over {loops.loops} closed loops"
        if error < max(_AGREES, loops.spread):
            return Finding("reciprocity", "info", f"Reciprocity holds: {size}.", size=error)
        return Finding(
            "reciprocity",
            "warning",
            f"Reciprocity holds roughly: {size}.",
            "Refine the mesh, or leave the flux linkage out if it comes from another model.",
            error,
        )
    magnitude = abs(loops.factor)
    causes = causes_of(magnitude, 0.02 + loops.spread) if abs(magnitude - 1) > _WRONG else []
    if loops.factor < 0:
        causes.insert(0, "the sign of force or flux linkage is reversed (--flip-force, or --flux-linkage-unit -1)")
    return Finding(
        "reciprocity",
        "error",
        f"Flux linkage and force do not belong together: -d(flux linkage)/dd is {loops.factor:.4g} times dF/di "
        f"(the same within {100 * loops.spread:.2g} % over {loops.loops} closed loops). Likely causes: "
        f"{'; '.join(causes) or 'unknown'}.",
        "Correct the unit or column, or leave the flux linkage out with --without flux_linkage.",
        loops.factor,
    )


def _judge_shape(
    plain: LoopComparison, distances: FloatArray, currents: FloatArray, force: FloatArray, flux: FloatArray
) -> Finding:
    """The two sides have different shapes: look whether the column is an inductance."""
    readings: tuple[tuple[str, FluxOf], ...] = (
        ("the flux linkage divided by the current (apparent inductance)", apparent),
        ("the differential inductance d(flux linkage)/di", differential),
    )
    for name, reading in readings:
        loops = _compare_reading(distances, currents, force, flux, reading)
        if loops.spread < min(_SAME_SHAPE, plain.spread / 3):
            scale = "" if abs(loops.factor - 1) < _WRONG else f", up to a factor {loops.factor:.4g}"
            return Finding(
                "reciprocity",
                "error",
                f"The column taken as flux linkage is {name}{scale}: only so it agrees with the force "
                f"(within {100 * loops.spread:.2g} % over {loops.loops} closed loops).",
                "Give it as --inductance-column, or export the flux linkage itself.",
                loops.factor,
            )
    return Finding(
        "reciprocity",
        "error",
        "Flux linkage and force do not belong together: the ratio of -d(flux linkage)/dd to dF/di is "
        f"{plain.factor:.3g} with a spread of {100 * plain.spread:.3g} % over {plain.loops} closed loops.",
        "Check that both columns come from the same model, coil and rows; leave the flux linkage out with "
        "--without flux_linkage.",
        plain.spread,
    )


def _compare_reading(
    distances: FloatArray, currents: FloatArray, force: FloatArray, column: FloatArray, reading: FluxOf
) -> LoopComparison:
    """Loops with a column read as inductance; its value at zero current, 0/0, is left out where that is possible."""
    keep = currents != 0 if reading is apparent and (currents != 0).sum() > 1 else np.ones(len(currents), bool)
    return compare_loops(distances, currents[keep], force[:, keep], reading(currents[keep], column[:, keep]))


def flux_from_inductance(points: pd.DataFrame) -> tuple[pd.DataFrame, list[Finding]]:
    """Take the flux linkage from an inductance column, only where reciprocity with the force proves it.

    lambda = L i (apparent) or the integral of L di (differential) lacks the magnet's flux linkage at zero current; only
    without a magnet, or with L = lambda / i at every current, the flux linkage follows, and then it must be reciprocal.
    """
    if "inductance" not in points or "flux_linkage" in points:
        return points, []
    distances, currents, (force, inductance) = complete_grid(points, ["force", "inductance"])
    kept = "kept as inductance, without flux linkage"
    if len(distances) < 3 or (currents != 0).sum() < 2:
        text = f"The inductance is {kept}: a grid of 3 distances and 2 currents besides zero would be needed to tell."
        return points, [Finding("inductance", "info", text)]
    loops = _compare_reading(distances, currents, force, inductance, apparent)
    zero_rows = points["current"] == 0
    if loops.spread > _SAME_SHAPE or abs(loops.factor - 1) > _AGREES + loops.spread:
        other = _compare_reading(distances, currents, force, inductance, differential)
        text = (
            f"The inductance is {kept}: L i does not agree with the force (factor {loops.factor:.3g}, spread "
            f"{100 * loops.spread:.2g} %), nor does the integral of L di (factor {other.factor:.3g}, spread "
            f"{100 * other.spread:.2g} %) show its part at zero current, a magnet's."
        )
        return points, [Finding("inductance", "warning", text, "Export the flux linkage itself.", loops.factor)]
    passive = float(points.loc[zero_rows, "force"].abs().max()) if zero_rows.any() else 0.0
    if passive > _NO_MAGNET * float(points["force"].abs().max()):
        text = (
            f"The inductance is {kept}: it is flux linkage / current, without a value at zero current beside a magnet."
        )
        return points, [Finding("inductance", "warning", text, "Export the flux linkage itself.")]
    flux = np.where(zero_rows, 0.0, points["inductance"].fillna(0.0) * points["current"])
    text = (
        f"Flux linkage taken as inductance times current: it agrees with the force within "
        f"{100 * abs(loops.factor - 1):.2g} % over {loops.loops} closed loops."
    )
    return points.assign(flux_linkage=flux), [Finding("inductance", "info", text, size=abs(loops.factor - 1))]
