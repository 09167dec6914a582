"""Several circuits: force, flux linkages and inductances of a sweep fitted with one co-energy.

Without saturation it is a quadratic form in the currents, whose entries are splines in a coordinate of the distance.
How many cells the splines take, and in which coordinate, is what distances left out ask for.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from femfit.core.errors import FitError
from femfit.core.numerics import BoolArray, FloatArray
from femfit.core.results import listing
from femfit.core.text import amount
from femfit.fit.basis import (
    CoenergyBasis,
    CurrentSplines,
    clamped_knots,
    even_splines,
    misfit_by_currents,
    quadratic_form,
)
from femfit.fit.coenergy_choice import best_along_distance
from femfit.fit.coenergy_system import CoenergySystem, Projection, coenergy_system, flux_scale
from femfit.fit.constants import (
    BETWEEN_LEFT_OUT,
    FEWEST_CURRENTS,
    FINER_CURRENTS,
    LEFT_OUT_EVERY,
    MOST_UNKNOWNS,
    NOT_QUADRATIC,
    POOR_BETWEEN,
    POOR_CIRCUIT,
    POOR_POINT,
    U_DEGREE,
)
from femfit.fit.ranking import middles
from femfit.fit.rows import FitRows, rms, rms_share
from femfit.fit.words import note
from femfit.model.several_magnetics import CircuitAxis, CoenergyMatrix, CoenergyTensor


def fit_saturating(system: CoenergySystem) -> tuple[CoenergyTensor, Projection]:
    """The spline, and how it was found.

    Raises
    ------
    FitError
        If a circuit has fewer than three currents, the rows are no grid or do not determine the spline, or the
        inductances are not positive definite everywhere.
    """
    rows, axes = system.rows, system.rows.axes
    require_currents(rows, "The iron saturates")
    signed = axes if rows.magnet else [np.unique(np.concatenate([axis, -axis])) for axis in axes]
    degrees = (U_DEGREE,) * len(axes)
    knots = [tuple(_knots(axis, share, not rows.magnet) for axis in signed) for share in FINER_CURRENTS]
    products = int(np.prod([len(of_axis) - U_DEGREE - 1 for of_axis in knots[-1]]))
    unknowns = len(rows.distances) * (products if rows.magnet else (products - 1) // 2)
    if unknowns > MOST_UNKNOWNS:
        raise FitError(
            f"The spline over the distance and {len(axes)} currents would have {unknowns} coefficients; femfit fits at "
            f"most {MOST_UNKNOWNS}. Sweep fewer currents or distances."
        )
    trials = [(CurrentSplines if rows.magnet else even_splines)(trial, degrees) for trial in knots]
    finest = trials[-1 if rows.inductance is not None else -2]  # a knee that is not met hides what the distances show
    along = best_along_distance(system, finest)
    by_points = replace(system, folds=tuple(points_left_out(rows)))
    bases = [replace(along, functions=trial) for trial in trials]
    tried = [(by_points.held_out_errors(basis).max(), basis, system.projection(basis)) for basis in bases]
    indefinite: list[str] = []
    for _, basis, projection in sorted(tried, key=lambda entry: entry[0]):
        if projection is None:
            continue
        magnetics = _tensor(basis, projection, rows)
        indefinite.append(_indefinite(magnetics, *_between_rows(rows, axes)))
        if not indefinite[-1]:
            return magnetics, projection
    if not indefinite:
        raise FitError(
            f"The rows do not determine the co-energy of {', '.join(rows.names)}. Sweep every combination of the "
            "currents at every distance."
        )
    raise FitError(
        f"{indefinite[0]} Sweep more currents, where the iron begins to saturate above all, in every combination; "
        "windings on one core may have to be fitted one at a time."
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

    def tensor(table: FloatArray) -> CoenergyTensor:
        axes = tuple(map(CircuitAxis, rows.names, functions.knots, functions.degrees))
        return CoenergyTensor(basis.coordinate, basis.u_knots, U_DEGREE, axes, table)

    table = functions.table(projection.coefficients.reshape(basis.shape))
    if not functions.constant:
        return tensor(table)
    origin = np.clip(np.zeros(len(rows.names)), rows.circuit_currents.min(axis=0), rows.circuit_currents.max(axis=0))
    return tensor(table - tensor(table).coenergy(rows.distances[-1], origin))


def _between_rows(rows: FitRows, axes: list[FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Distances and currents of the rows, and of the middles between them."""
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
    return distance[judged], currents[judged]


def _indefinite(magnetics: CoenergyMatrix | CoenergyTensor, distance: FloatArray, currents: FloatArray) -> str:
    """Why the model cannot be: inductances that are not positive definite somewhere; empty where they all are."""
    least = np.linalg.eigvalsh(magnetics.inductance(distance, currents))[:, 0]
    worst = int(np.argmin(least))
    if least[worst] > 0.0:
        return ""
    at_currents = f" and {', '.join(f'{i:.4g} A' for i in currents[worst])}" if currents.any() else ""
    return (
        f"The inductances of {', '.join(magnetics.names)} must be positive definite; at {1e3 * distance[worst]:.4g} mm"
        f"{at_currents} their least eigenvalue is {amount(float(least[worst]), 'H', 3)}."
    )


@dataclass(frozen=True, eq=False)
class CircuitsFit:
    """A fitted co-energy and its errors; those of the force are parts of :attr:`FitRows.force_scale`."""

    magnetics: CoenergyMatrix | CoenergyTensor
    worst: float  # Of the force at any point of the table
    share: float  # Rms error over the rms, of the force or the flux linkage that is met worst
    # The largest of the force with a whole distance left out and, where the iron saturates, with a whole current;
    # infinite where the others do not determine the fit
    distance_left_out: float
    current_left_out: float
    finer: tuple[str, tuple[float, ...]]  # The axis of the sweep that is too coarse first, and what to add to it

    @property
    def saturates(self) -> bool:
        """Whether it is a spline in the currents, not a quadratic form."""
        return isinstance(self.magnetics, CoenergyTensor)

    def notes(self) -> list[str]:
        """Where the sweep is too coarse, why, and what to add to it."""
        between = BETWEEN_LEFT_OUT * max(self.distance_left_out, self.current_left_out)
        if self.worst <= POOR_POINT and (between <= POOR_BETWEEN or not np.isfinite(between)):
            return []
        return [note("coarse_circuits", self, between)]

    def to_be_added(self) -> str:
        """The values of the axis that is too coarse first."""
        axis, values = self.finer
        if axis == "distance":
            return f"the distances {listing(f'{1e3 * x:.4g}' for x in values)} mm"
        return f"the currents {listing(f'{x:.4g}' for x in values)} A of {axis}"


def fit_circuits(rows: FitRows) -> CircuitsFit:
    """Fit M(d), or where the iron saturates a spline in the distance and all currents.

    Raises
    ------
    FitError
        If the rows do not determine the co-energy, if force and flux linkages contradict each other, or if the
        inductances are not positive definite everywhere.
    """
    largest = np.abs(rows.circuit_currents).max(axis=0)
    functions, system = quadratic_form(np.where(largest > 0.0, largest, 1.0), rows.magnet), coenergy_system(rows)
    if _not_quadratic(rows, functions) > NOT_QUADRATIC:
        return _judged(*fit_saturating(system), system)
    basis = best_along_distance(system, functions)
    projection = system.projection(basis)
    if projection is None:
        raise FitError(
            f"The rows do not determine the inductances of {', '.join(rows.names)}. Sweep each circuit's current by "
            "itself and at least one point with each two together."
        )
    beside_magnet = np.triu_indices(len(rows.names) + 1)[0] > 0
    coefficients = np.zeros((basis.shape[0], len(beside_magnet)))
    coefficients[:, beside_magnet | rows.magnet] = projection.coefficients.reshape(basis.shape)
    magnetics = CoenergyMatrix(rows.names, basis.coordinate, basis.u_knots, U_DEGREE, coefficients)
    distances = np.concatenate([np.linspace(low, high, 8) for low, high in pairwise(rows.distances)])
    if indefinite := _indefinite(magnetics, distances, np.zeros((len(distances), len(rows.names)))):
        raise FitError(f"{indefinite} Sweep more distances, or check the signs of the flux linkages.")
    return _judged(magnetics, projection, system)


def _left_out(
    projection: Projection, system: CoenergySystem, name: str, column: FloatArray
) -> tuple[float, float, tuple[str, tuple[float, ...]]]:
    """With each inner value of an axis left out: the force's largest rms, -1 for none, and error, and what to add.

    That is the middles beside all values that are missed at least half as much (rms) as the most missed one.
    """
    values, sizes, worst = np.unique(column), list[float](), 0.0
    for value in values[1:-1]:
        out = column == value
        errors = projection.left_out(system.places(out))
        of_force = np.array([np.inf]) if errors is None else errors[: int(out.sum())]
        sizes.append(rms(of_force))
        worst = max(worst, float(np.max(np.abs(of_force))))
    if not sizes:
        return -1.0, 0.0, (name, ())
    most = values[1:-1][2.0 * np.array(sizes) >= max(sizes)]
    finer = np.unique(np.concatenate([middles(values, value) for value in most]))
    return max(sizes), worst, (name, tuple(finer.tolist()))


def _judged(magnetics: CoenergyMatrix | CoenergyTensor, projection: Projection, system: CoenergySystem) -> CircuitsFit:
    """The fit with its errors, unless no one co-energy has the force and the flux linkages."""
    rows = system.rows
    force = magnetics.force(rows.distance, rows.circuit_currents) - rows.force
    flux = magnetics.flux_linkage(rows.distance, rows.circuit_currents) - rows.linked
    axes = [("distance", rows.distance)]
    if isinstance(magnetics, CoenergyTensor):
        axes += list(zip(rows.names, rows.circuit_currents.T, strict=True))
    left_out = [_left_out(projection, system, name, column) for name, column in axes]
    fit = CircuitsFit(
        magnetics,
        float(np.max(np.abs(force) / rows.force_scale)),
        max(rms_share(force, rows.force) or 0.0, rms_share(flux, rows.linked) or 0.0),
        left_out[0][1],
        max((worst for _, worst, _ in left_out[1:]), default=0.0),
        max(left_out, key=lambda axis: axis[0])[2],
    )
    if fit.share > POOR_CIRCUIT and fit.saturates:
        raise FitError(
            f"The iron saturates, and the co-energy misses force or flux linkages by {amount(fit.share, '')} of their "
            "rms: the grid is too coarse. Sweep more currents where the iron begins to saturate, then more distances; "
            f"first of all add {fit.to_be_added()}."
        )
    if fit.share > POOR_CIRCUIT:
        raise FitError(
            f"No co-energy meets force and flux linkages together: the best one misses them by {amount(fit.share, '')} "
            "of their rms. Sweep more distances; if it stays, a sign or a unit of these columns is wrong."
        )
    return fit


def _not_quadratic(rows: FitRows, functions: CurrentSplines) -> float:
    """What the best quadratic form in the currents misses at each distance by itself, over the scale, at most."""
    flux = [((k,), column, flux_scale(column)) for k, column in enumerate(rows.linked.T)]
    readings = [((), rows.force, rows.force_scale), *flux]
    residuals = [
        misfit_by_currents(functions.columns(rows.circuit_currents, *k) / scale[:, None], values / scale, rows.distance)
        for k, values, scale in readings
    ]
    return float(np.max(np.abs(residuals)))
