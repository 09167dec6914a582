r"""Points of the circuits' currents, and from what was solved at a distance to its rows of the table.

A linear actuator's distance is a form in the sources s = (1, i_1 .. i_n): F = s . F s, flux linkage = A s,
W' = W_0 + flux_0 . i + i . L i / 2, B = b . s. A saturating one's is solved point by point.

The error of a force is estimated by its change from one polynomial order lower, with a factor.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from femfit.core.numerics import BIAS_SHARE, BoolArray, FloatArray
from femfit.core.sweep_columns import flux_columns, inductance_columns
from femfit.device.parts import Actuator, SweepAxes

if TYPE_CHECKING:
    import pandas as pd

CurrentsLike: TypeAlias = float | Sequence[float] | FloatArray
"""Currents in A: of shape (points, circuits), or one number a point where there is one circuit at most."""


def current_points(currents: CurrentsLike, circuits: int) -> FloatArray:
    """Currents in A of shape (points, circuits); without a circuit the zeros that stand for it are left out."""
    values = np.atleast_1d(np.asarray(currents, dtype=np.float64))
    return np.zeros((len(values), 0)) if circuits == 0 else values.reshape(-1, circuits)


def swept_currents(axes: SweepAxes) -> FloatArray:
    """All combinations of a sweep's currents in A, the last circuit's fastest; a column of zeros without one."""
    return np.array(list(product(axes.currents_A, *axes.further_A)))


def weakest(points: FloatArray) -> int:
    """The place of the point with the smallest currents."""
    return int(np.argmin(np.linalg.norm(points, axis=1))) if points.size else 0


def between(points: FloatArray, start: FloatArray, end: FloatArray) -> BoolArray:
    """Which points lie between two others, each current between theirs; shape (points,)."""
    low, high = np.minimum(start, end), np.maximum(start, end)
    return np.asarray(np.all((low <= points) & (points <= high), axis=-1))


def bias_currents(actuator: Actuator, rows: "pd.DataFrame") -> dict[float, tuple[float, ...]]:
    """The currents in A by distance about which the fields of a saturating actuator's eddy currents are small.

    Those that the drawing gives; else the middle of the swept ones, beside magnets and of several circuits. A single
    circuit without a magnet gets those of BIAS_SHARE of its largest flux linkage in rows of the sweep: the iron is then
    about the same all along the stroke, and so are its eddy currents. Nothing where nothing saturates.
    """
    swept = actuator.sweep.distances_m
    if not actuator.saturates:
        return {}
    if actuator.eddy_bias_A:
        return dict.fromkeys(swept, actuator.eddy_bias_A)
    axes = (actuator.sweep.currents_A, *actuator.sweep.further_A)[: len(actuator.circuits)]
    bias = dict.fromkeys(swept, tuple(0.5 * (min(axis) + max(axis)) for axis in axes))
    magnet = any(region.material.remanence_T for region in actuator.regions)
    if magnet or len(axes) != 1:
        return bias
    current, linked = rows["current_A"].to_numpy(), np.abs(rows["flux_linkage_Wb"].to_numpy())
    for distance in swept:
        here = np.flatnonzero((rows["distance_m"] == distance) & (rows["status"] == "ok"))
        here = here[np.argsort(linked[here])]
        if len(here):
            bias[distance] = (float(np.interp(BIAS_SHARE * np.nanmax(linked), linked[here], current[here])),)
    return bias


ERROR_SAFETY = 3.0
"""Factor on the force's change between two polynomial orders. At re-entrant corners the error falls algebraically with
the order, by a factor q = 0.5..0.75 each time, so the true error is q / (1 - q) = 1..3 times the last change."""

BEYOND_CURVE, COARSE_FORCE = "beyond_bh_curve", "coarse_force_N"
"""No columns of the table: the sweep's manifest counts the first, and an error follows from the force one order lower.
"""

NO_CONVERGENCE = "failed: Newton's iteration did not converge"
"""The status of points that a saturating part made fail; the table's Newton columns say how near they came."""

UNSOLVED = "failed: the field's equations could not be solved on this mesh"
"""The status of points whose linear equations were left with an error."""

NOT_FINITE = "the solution is not finite. Look for extreme dimensions or materials in the actuator file."


@dataclass(frozen=True, eq=False, kw_only=True)
class Coefficients:
    """Forms in the m sources, of a linear field or of small currents about a bias; in N, Wb, T, J and A."""

    force: FloatArray  # Symmetric; shape (m, m)
    flux_linkage: FloatArray  # Of the circuits, without current and of each source's ampere; shape (m - 1, m)
    coenergy: float  # W_0
    hall: FloatArray | None  # Shape (m,)
    rest: FloatArray | None = None  # Flux linkages without any current, where the others are about a bias
    # Change of the force from one polynomial order lower, where that was solved; shape (m, m)
    force_change: FloatArray | None = None
    pickup: Mapping[str, FloatArray] = field(default_factory=dict)  # Flux linkages by their columns; shape (m,) each


def superpose(currents: FloatArray, solution: Coefficients, circuits: Sequence[str]) -> dict[str, FloatArray]:
    """Table columns at currents of shape (points, circuits).

    The terms of the change between the orders add in magnitude, so that no cancellation flatters the error, which is
    absent where the change is unknown.
    """
    flux, count = solution.flux_linkage, len(currents)
    sources = np.insert(currents, 0, 1.0, axis=1)
    linked = sources @ flux.T
    columns = {
        "force_N": _form(sources, solution.force),
        **dict(zip(flux_columns(circuits), linked.T, strict=True)),
        **{name: np.full(count, flux[j, 1 + k]) for name, (j, k) in inductance_columns(circuits).items()},
        "coenergy_J": solution.coenergy + 0.5 * np.sum(currents * (flux[:, 0] + linked), axis=1),
    }
    if solution.force_change is not None:
        columns["force_error_N"] = ERROR_SAFETY * _form(np.abs(sources), np.abs(solution.force_change))
    if solution.hall is not None:
        columns["hall_T"] = sources @ solution.hall
    return columns | {name: sources @ linked for name, linked in solution.pickup.items()}


def _form(sources: FloatArray, matrix: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("pj,jk,pk->p", sources, matrix, sources))


def table_rows(rows: Sequence[Mapping[str, Any]], currents: FloatArray) -> dict[str, Any]:
    """Columns of the sweep table, one value a point, of what each point has; without convergence it has no field.

    The force's error is absent where its change from one order lower is unknown. At single currents that change passes
    through zero, so it counts at least with its mean relative to the force; and where the coil cancels the magnet's
    force, relative to that of the weakest current.
    """
    names = dict.fromkeys(name for row in rows for name in row)
    columns = {name: [row.get(name, False if name == BEYOND_CURVE else np.nan) for row in rows] for name in names}
    if COARSE_FORCE in columns:
        force = np.array(columns["force_N"])
        change, size = np.abs(force - columns.pop(COARSE_FORCE)), np.abs(force)
        share = np.nansum(change) / (np.nansum(size) or np.inf)
        least = share * np.fmax(size, size[weakest(currents)])
        columns["force_error_N"] = (ERROR_SAFETY * np.fmax(change, least)).tolist()
    return columns
