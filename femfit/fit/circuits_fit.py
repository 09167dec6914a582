"""Several circuits: force, flux linkages and inductances of a sweep fitted with one co-energy.

Without saturation it is a quadratic form in the currents, whose entries are splines in a coordinate of the distance.
How many cells the splines take, and in which coordinate, is what distances left out ask for.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from femfit.core.errors import FitError
from femfit.core.numerics import BoolArray, FloatArray
from femfit.core.text import amount
from femfit.fit import constants
from femfit.fit.basis import (
    CoenergyBasis,
    CurrentSplines,
    clamped_knots,
    even_splines,
    misfit_by_currents,
    quadratic_form,
)
from femfit.fit.coenergy_choice import best_along_distance
from femfit.fit.coenergy_system import CoenergySystem, Projection, coenergy_system
from femfit.fit.ranking import middles
from femfit.fit.rows import FitRows, rms, rms_share
from femfit.fit.words import note
from femfit.model.several_magnetics import CircuitAxis, CoenergyMatrix, CoenergyTensor


@dataclass(frozen=True, eq=False)
class CircuitsFit:
    """A fitted co-energy and its errors; those of the force are parts of :attr:`FitRows.force_scale`."""

    magnetics: CoenergyMatrix | CoenergyTensor
    worst: float  # Of the force at any point of the table
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
        between = constants.BETWEEN_LEFT_OUT * max(self.distance_left_out, self.current_left_out)
        if self.worst <= constants.POOR_POINT and (between <= constants.POOR_BETWEEN or not np.isfinite(between)):
            return []
        return [note("coarse_circuits", self, between)]


def fit_circuits(rows: FitRows) -> CircuitsFit:
    """Fit M(d), or where the iron saturates a spline in the distance and all currents.

    Raises
    ------
    FitError
        If the rows do not determine the co-energy, if force and flux linkages contradict each other, if the
        inductances are not positive definite everywhere, or, where the iron saturates, if a circuit has fewer than
        three currents or the spline would have too many coefficients.
    """
    largest = np.abs(rows.circuit_currents).max(axis=0)
    functions, system = quadratic_form(np.where(largest > 0.0, largest, 1.0), rows.magnet), coenergy_system(rows)
    # What the best quadratic form misses at each distance by itself
    missed = [
        misfit_by_currents(
            functions.columns(rows.circuit_currents, *c.circuits) / c.scale[:, None], c.value / c.scale, rows.distance
        )
        for c in system.channels
        if len(c.circuits) < 2
    ]
    saturates = np.max(np.abs(missed)) > constants.NOT_QUADRATIC
    magnetics, projection = _fit_spline(rows, system) if saturates else _fit_form(rows, system, functions)
    force = magnetics.force(rows.distance, rows.circuit_currents) - rows.force
    flux = magnetics.flux_linkage(rows.distance, rows.circuit_currents) - rows.linked
    axes = [("distance", rows.distance), *(zip(rows.names, rows.circuit_currents.T, strict=True) if saturates else ())]
    left_out = [_left_out(projection, system, name, column) for name, column in axes]
    fit = CircuitsFit(
        magnetics,
        float(np.max(np.abs(force) / rows.force_scale)),
        left_out[0][1],
        max((worst for _, worst, _ in left_out[1:]), default=0.0),
        max(left_out, key=lambda axis: axis[0])[2],
    )
    share = max(rms_share(force, rows.force) or 0.0, rms_share(flux, rows.linked) or 0.0)
    if share > constants.POOR_CIRCUIT and saturates:
        raise FitError(
            f"The iron saturates, and the co-energy misses force or flux linkages by {amount(share, '')} of their "
            "rms: the grid is too coarse. Sweep more currents where the iron begins to saturate, then more distances; "
            f"first of all add {note('values_along', *fit.finer, rows.several)}."
        )
    if share > constants.POOR_CIRCUIT:
        raise FitError(
            f"No co-energy meets force and flux linkages together: the best one misses them by {amount(share, '')} "
            "of their rms. Sweep more distances; if it stays, a sign or a unit of these columns is wrong."
        )
    return fit


def _fit_form(rows: FitRows, system: CoenergySystem, functions: CurrentSplines) -> tuple[CoenergyMatrix, Projection]:
    """The quadratic form, and how it was found."""
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
    magnetics = CoenergyMatrix(rows.names, basis.coordinate, basis.u_knots, constants.U_DEGREE, coefficients)
    distances = np.concatenate([np.linspace(low, high, 8) for low, high in pairwise(rows.distances)])
    if indefinite := _indefinite(magnetics, distances, np.zeros((len(distances), len(rows.names)))):
        raise FitError(f"{indefinite} Sweep more distances, or check the signs of the flux linkages.")
    return magnetics, projection


def _fit_spline(rows: FitRows, system: CoenergySystem) -> tuple[CoenergyTensor, Projection]:
    """The spline of iron that saturates, and how it was found."""
    require_currents(rows, "The iron saturates")
    axes, degrees = rows.axes, (constants.U_DEGREE,) * len(rows.axes)
    signed = axes if rows.magnet else [np.unique(np.concatenate([axis, -axis])) for axis in axes]
    knots = [tuple(_knots(axis, share, not rows.magnet) for axis in signed) for share in constants.FINER_CURRENTS]
    products = int(np.prod([len(of_axis) - constants.U_DEGREE - 1 for of_axis in knots[-1]]))
    unknowns = len(rows.distances) * (products if rows.magnet else (products - 1) // 2)
    if unknowns > constants.MOST_UNKNOWNS:
        raise FitError(
            f"The spline over the distance and {len(axes)} currents would have {unknowns} coefficients; femfit fits at "
            f"most {constants.MOST_UNKNOWNS}. Sweep fewer currents or distances."
        )
    trials = [(CurrentSplines if rows.magnet else even_splines)(trial, degrees) for trial in knots]
    finest = trials[-1 if rows.inductance is not None else -2]  # a knee that is not met hides what the distances show
    along = best_along_distance(system, finest)
    by_points = replace(system, folds=points_left_out(rows))
    bases = [replace(along, functions=trial) for trial in trials]
    indefinite = ""
    for basis in sorted(bases, key=lambda basis: by_points.held_out_errors(basis).max()):
        projection = system.projection(basis)
        if projection is not None:
            magnetics = _tensor(basis, projection, rows)
            why = _indefinite(magnetics, *_between_rows(rows))
            if not why:
                return magnetics, projection
            indefinite = indefinite or why
    if not indefinite:
        raise FitError(
            f"The rows do not determine the co-energy of {', '.join(rows.names)}. Sweep every combination of the "
            "currents at every distance."
        )
    raise FitError(
        f"{indefinite} Sweep more currents, where the iron begins to saturate above all, in every combination; "
        "windings on one core may have to be fitted one at a time."
    )


def require_currents(rows: FitRows, why: str) -> None:
    """Refuse two currents of a circuit whose iron bends: a quadratic form would meet both, however it bends."""
    few = [name for name, axis in zip(rows.names, rows.axes, strict=True) if len(axis) < constants.FEWEST_CURRENTS]
    if few:
        raise FitError(
            f"{why}, and each circuit then needs {constants.FEWEST_CURRENTS} currents or more to show how it bends; "
            f"{' and '.join(few)} {'has' if len(few) == 1 else 'have'} fewer. Sweep more of them, together with all of "
            "the others'."
        )


def points_left_out(rows: FitRows) -> list[BoolArray]:
    """The inner points with a current, in folds of every so many-th; the signs of all currents are one."""
    currents = rows.circuit_currents
    low, high = currents.min(axis=0), currents.max(axis=0)
    inner = (rows.distance > rows.distances[0]) & (rows.distance < rows.distances[-1]) & currents.any(axis=1)
    inner &= np.all(((currents > low) | ((low == 0.0) & (not rows.magnet))) & (currents < high), axis=1)
    places, turns = np.flatnonzero(inner), np.arange(len(rows.distance))
    every = constants.LEFT_OUT_EVERY
    return [np.isin(turns, places[k::every]) for k in range(min(every, len(places)))]


def _knots(currents: FloatArray, share: float, even: bool) -> FloatArray:
    """Clamped knots of so many cells a step; between the steps they follow the currents."""
    steps = len(currents) - 1
    cells = max(1, round(share * steps))
    breaks = np.interp(np.linspace(0, steps, cells + 1), np.arange(steps + 1), currents)
    if even:  # to rounding
        breaks = 0.5 * (breaks - breaks[::-1])
    return clamped_knots(breaks, constants.U_DEGREE)


def _tensor(basis: CoenergyBasis, projection: Projection, rows: FitRows) -> CoenergyTensor:
    """The model's magnetics; with a magnet W' is counted from zero current at the farthest distance."""
    functions = basis.functions
    axes = tuple(map(CircuitAxis, rows.names, functions.knots, functions.degrees))
    table = functions.table(projection.coefficients.reshape(basis.shape))
    tensor = CoenergyTensor(basis.coordinate, basis.u_knots, constants.U_DEGREE, axes, table)
    if not functions.constant:
        return tensor
    origin = np.clip(np.zeros(len(rows.names)), rows.circuit_currents.min(axis=0), rows.circuit_currents.max(axis=0))
    return replace(tensor, coefficients=table - tensor.coenergy(rows.distances[-1], origin))


def _between_rows(rows: FitRows) -> tuple[FloatArray, FloatArray]:
    """Distances and currents of the rows, and of the middles between them."""
    axes = [rows.distances, *rows.axes]
    fine = [np.unique(np.concatenate([axis, 0.5 * (axis[1:] + axis[:-1])])) for axis in axes]
    points = np.stack(np.meshgrid(*fine, indexing="ij"), axis=-1).reshape(-1, len(axes))
    swept = {tuple(point) for point in np.column_stack([rows.distance, rows.circuit_currents])}
    grid = np.all([np.isin(column, axis) for column, axis in zip(points.T, axes, strict=True)], axis=0)
    points = points[[not on or tuple(point) in swept for on, point in zip(grid, points, strict=True)]]
    return points[:, 0], points[:, 1:]


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


def _left_out(
    projection: Projection, system: CoenergySystem, name: str, column: FloatArray
) -> tuple[float, float, tuple[str, tuple[float, ...]]]:
    """With each inner value of an axis left out: the force's largest rms and error, and what to add.

    That is the middles beside all values that are missed at least half as much (rms) as the most missed one.
    """
    values = np.unique(column)
    masks = [column == value for value in values[1:-1]]
    errors = [projection.left_out(system.places(out))[: int(out.sum())] for out in masks]
    sizes = np.array([rms(of_force) for of_force in errors])
    finer = np.unique([place for value in values[1:-1][2.0 * sizes >= sizes.max()] for place in middles(values, value)])
    return float(sizes.max()), float(np.abs(np.concatenate(errors)).max()), (name, tuple(finer.tolist()))
