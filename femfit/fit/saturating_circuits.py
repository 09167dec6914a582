"""Several circuits whose iron saturates: one spline in the distance and all currents, fitted to a grid of points.

In each current the spline has a cell for every step between the swept currents, for every second, or for every third,
whichever misses least at points left out. Without a magnet it goes from the largest current to its negative, and
W'(d, -i) = W'(d, i), with W'(d, 0) = 0, hold in every one of its functions, so that there is neither a force nor a flux
linkage without current.
What currents of signs that were not swept together leave open takes the smoothest: in each two currents a sum of what
each does alone and of what one does in proportion to the other.
"""

from dataclasses import replace

import numpy as np

from femfit.core.errors import FitError
from femfit.core.numerics import BoolArray, FloatArray
from femfit.core.text import amount
from femfit.fit.basis import CoenergyBasis, CurrentSplines, clamped_knots
from femfit.fit.coenergy_choice import best_along_distance
from femfit.fit.coenergy_system import CoenergySystem, Projection
from femfit.fit.constants import (
    FEWEST_CURRENTS,
    FINER_CURRENTS,
    LEAST_OF_GRID,
    LEFT_OUT_EVERY,
    MOST_UNKNOWNS,
    U_DEGREE,
)
from femfit.fit.rows import FitRows, rms
from femfit.model.several_magnetics import CircuitAxis, CoenergyTensor


def fit_saturating(system: CoenergySystem) -> tuple[CoenergyTensor, Projection]:
    """The spline, and how it was found.

    Raises
    ------
    FitError
        If a circuit has fewer than three currents, the rows are no grid or do not determine the spline, or the
        inductances are not positive definite everywhere.
    """
    rows, axes = system.rows, system.rows.axes
    _require_grid(rows)
    signed = axes if rows.magnet else [np.unique(np.concatenate([axis, -axis])) for axis in axes]
    degrees = (U_DEGREE,) * len(axes)
    trials = [
        CurrentSplines(tuple(_knots(axis, share, not rows.magnet) for axis in signed), degrees, not rows.magnet)
        for share in FINER_CURRENTS
    ]
    unknowns = len(rows.distances) * trials[-1].count
    if unknowns > MOST_UNKNOWNS:
        raise FitError(
            f"The spline over the distance and {len(axes)} currents would have {unknowns} coefficients; femfit fits at "
            f"most {MOST_UNKNOWNS}. Sweep fewer currents or distances."
        )

    finest = trials[-1 if rows.inductance is not None else -2]  # a knee that is not met hides what the distances show
    along = best_along_distance(system, finest)
    by_points = replace(system, folds=tuple(points_left_out(rows)))
    bases = [replace(along, functions=trial) for trial in trials]
    tried = [(by_points.held_out_errors(basis).max(), basis, system.projection(basis)) for basis in bases]
    indefinite: list[str] = []
    tightly = ""
    for _, basis, projection in sorted(tried, key=lambda entry: entry[0]):
        if projection is None:
            continue
        magnetics = _tensor(basis, projection, rows)
        if not indefinite:
            tightly = _tightly_coupled(magnetics, rows)
        indefinite.append(_indefinite(magnetics, rows, axes))
        if not indefinite[-1]:
            return magnetics, projection
    if not indefinite:
        raise FitError(
            f"The rows do not determine the co-energy of {', '.join(rows.names)}. Sweep every combination of the "
            "currents at every distance."
        )
    raise FitError(
        f"The inductances of {', '.join(rows.names)} must be positive definite; {indefinite[0]}. "
        f"{tightly or 'Sweep more currents, where the iron begins to saturate above all.'}"
    )


def _tightly_coupled(magnetics: CoenergyTensor, rows: FitRows) -> str:
    """Why no finer sweep helps windings that share a core; empty where the swept inductances do not say so.

    Divided by sqrt(L_jj L_kk) the inductances have 1 on the diagonal, and the couplings k beside it. Their least
    eigenvalue, 1 - k of two windings, is the leakage: an error below it leaves them positive definite (Weyl), one above
    may not. Of windings apart that is 1, so that an error of 1 needs no coupling to be too large.
    """
    if rows.inductance is None:
        return ""
    self_inductance = np.diagonal(rows.inductance, axis1=1, axis2=2)
    scale = np.sqrt(self_inductance[:, :, None] * self_inductance[:, None, :])
    off = magnetics.inductance(rows.distance, rows.circuit_currents) - rows.inductance
    missed = rms(np.linalg.norm(off / scale, ord=2, axis=(1, 2)))
    leakage = float(np.linalg.eigvalsh(rows.inductance / scale).min())
    if not leakage <= missed < 1.0:
        return ""
    coupling = float(np.abs(np.triu(rows.inductance / scale, 1)).max())
    return (
        f"The windings share one core: they couple by up to {coupling:.2f}, which leaves a leakage of "
        f"{amount(leakage, '')} of their inductances, less than the {amount(missed, '')} (rms) by which the fit misses "
        "these. More points seldom mend that. Sweep and fit one winding at a time, or connect them in one circuit."
    )


def require_currents(rows: FitRows, why: str) -> None:
    """Refuse two currents of a circuit whose iron bends: a quadratic form would meet both, however it bends."""
    few = [name for name, axis in zip(rows.names, rows.axes, strict=True) if len(axis) < FEWEST_CURRENTS]
    if few:
        raise FitError(
            f"{why}, and each circuit then needs {FEWEST_CURRENTS} currents or more to show how it bends; "
            f"{' and '.join(few)} {'has' if len(few) == 1 else 'have'} fewer. Sweep more of them, together with all of "
            "the others'."
        )


def _require_grid(rows: FitRows) -> None:
    require_currents(rows, "The iron saturates")
    points = rows.grid_points
    if len(rows.distance) < LEAST_OF_GRID * points:
        raise FitError(
            f"The iron saturates, and the rows are {len(rows.distance)} of the {points} points of their grid. Sweep "
            "every combination of the currents at every distance."
        )


def points_left_out(rows: FitRows) -> list[BoolArray]:
    """The inner points with a current, in folds of every so many-th; the signs of all currents are one."""
    inner = (
        (rows.distance > rows.distances[0]) & (rows.distance < rows.distances[-1]) & rows.circuit_currents.any(axis=1)
    )
    for column in rows.circuit_currents.T:
        low, high = column.min(), column.max()
        inner &= ((column > low) | (not rows.magnet and low == 0.0)) & (column < high)
    places = np.flatnonzero(inner)
    turns = np.arange(len(rows.distance))
    return [np.isin(turns, places[k::LEFT_OUT_EVERY]) for k in range(min(LEFT_OUT_EVERY, len(places)))]


def _knots(currents: FloatArray, share: float, even: bool) -> FloatArray:
    """Clamped knots of so many cells a step; between the steps they follow the currents."""
    steps = len(currents) - 1
    cells = max(1, round(share * steps))
    breaks = np.interp(np.linspace(0, steps, cells + 1), np.arange(steps + 1), currents)
    if even:  # to rounding
        breaks = 0.5 * (breaks - breaks[::-1])
    return clamped_knots(breaks, U_DEGREE)


def _tensor(basis: CoenergyBasis, projection: Projection, rows: FitRows) -> CoenergyTensor:
    """The model's magnetics; with a magnet W' is counted from zero current at the farthest distance."""
    functions = basis.functions
    assert isinstance(functions, CurrentSplines)  # noqa: S101  of iron that saturates

    def tensor(table: FloatArray) -> CoenergyTensor:
        axes = tuple(map(CircuitAxis, rows.names, functions.knots, functions.degrees))
        return CoenergyTensor(basis.coordinate, basis.u_knots, U_DEGREE, axes, table)

    table = functions.table(projection.coefficients.reshape(basis.shape))
    if functions.even:
        return tensor(table)
    origin = np.clip(np.zeros(len(rows.names)), rows.circuit_currents.min(axis=0), rows.circuit_currents.max(axis=0))
    return tensor(table - tensor(table).coenergy(rows.distances[-1], origin))


def _indefinite(magnetics: CoenergyTensor, rows: FitRows, axes: list[FloatArray]) -> str:
    """Where at or between the rows the inductances are not positive definite; empty where they are everywhere."""
    fine = [np.unique(np.concatenate([axis, 0.5 * (axis[1:] + axis[:-1])])) for axis in (rows.distances, *axes)]
    distance, *along = (point.ravel() for point in np.meshgrid(*fine, indexing="ij"))
    currents = np.stack(along, axis=-1)
    swept = {tuple(point) for point in np.column_stack([rows.distance, rows.circuit_currents])}
    grid = np.isin(distance, rows.distances) & np.all(
        [np.isin(i, axis) for i, axis in zip(along, axes, strict=True)], 0
    )
    judged = [
        not on or tuple(point) in swept for on, point in zip(grid, np.column_stack([distance, currents]), strict=True)
    ]
    distance, currents = distance[judged], currents[judged]
    least = np.linalg.eigvalsh(magnetics.inductance(distance, currents))[:, 0]
    worst = int(np.argmin(least))
    if least[worst] > 0.0:
        return ""
    where = ", ".join(f"{i:.4g} A" for i in currents[worst])
    value = amount(float(least[worst]), "H", 3)
    return f"at {1e3 * distance[worst]:.4g} mm and {where} their least eigenvalue is {value}"
