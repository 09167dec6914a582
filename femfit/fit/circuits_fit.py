"""Several circuits: force, flux linkages and inductances of a sweep fitted with one co-energy.

Without saturation it is a quadratic form in the currents, whose entries are splines in a coordinate of the distance.
How many cells the splines take, and in which coordinate, is what distances left out ask for.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from femfit.core.errors import FitError
from femfit.core.numerics import BoolArray, FloatArray
from femfit.core.text import amount
from femfit.fit.basis import CurrentProducts, misfit_by_currents
from femfit.fit.coenergy_choice import best_along_distance
from femfit.fit.coenergy_system import CoenergySystem, Projection, coenergy_system, flux_scale
from femfit.fit.constants import NOT_QUADRATIC, POOR_CIRCUIT, POOR_LEFT_OUT, POOR_POINT, U_DEGREE
from femfit.fit.misfit import middles
from femfit.fit.rows import FitRows, rms, rms_share
from femfit.fit.saturating_circuits import fit_saturating, points_left_out
from femfit.model.several_magnetics import CoenergyMatrix, CoenergyTensor


@dataclass(frozen=True, eq=False)
class CircuitsFit:
    """A fitted co-energy and its errors; those of the force are parts of :attr:`FitRows.force_scale`."""

    magnetics: CoenergyMatrix | CoenergyTensor
    worst: float  # Of the force at any point of the table
    # Of the force at points left out: the largest and the rms; infinite where the sweep has too few points
    left_out_worst: float
    left_out_rms: float
    share: float  # Rms error over the rms, of the force or the flux linkage that is met worst
    # Where the iron saturates: of the force, with a whole distance, and with a whole current, left out; the largest
    whole_distance_worst: float
    whole_current_worst: float
    finer: tuple[str, tuple[float, ...]]  # The axis of the sweep that is too coarse first, and what to add to it

    @property
    def saturates(self) -> bool:
        """Whether it is a spline in the currents, not a quadratic form."""
        return isinstance(self.magnetics, CoenergyTensor)

    @property
    def has_points_left_out(self) -> bool:
        """Whether the sweep has enough points to leave some out."""
        return bool(np.isfinite(self.left_out_worst))

    @property
    def between_distances(self) -> float:
        """Estimate of the largest error between two distances: half of that at a distance left out.

        Assumed of first order, for few cells follow few distances. In the currents, with a cell for every step or two,
        a quartic spline misses a sixteenth when the step is halved, and points left out show that.
        """
        return 0.5 * self.whole_distance_worst

    def notes(self) -> list[str]:
        """Where the sweep is too coarse, why, and what to add to it."""
        left_out = self.left_out_worst if self.has_points_left_out else 0.0
        between = self.between_distances if np.isfinite(self.between_distances) else 0.0
        if self.worst <= POOR_POINT and max(left_out, between) <= POOR_LEFT_OUT:
            return []
        missed = f"a point by {amount(self.worst, '')}"
        if left_out > self.worst:
            missed = f"a point left out by {amount(left_out, '')}"
        if between > max(left_out, self.worst):
            missed = f"a whole distance left out by {amount(self.whole_distance_worst, '')}"
        axis, _ = self.finer
        why = f"the iron saturates between the currents of {axis}"
        if axis == "distance":
            why = "the force changes too much from one distance to the next"
        text = (
            f"The sweep is too coarse for its force, which misses {missed}: {why}. Add {self.to_be_added()}, then fit"
        )
        return [f"{text} again."]

    def to_be_added(self) -> str:
        """The values of the axis that is too coarse first."""
        axis, values = self.finer
        if axis == "distance":
            return f"the distances {_listed([1e3 * x for x in values])} mm"
        return f"the currents {_listed(values)} A of {axis}"


def _listed(values: Sequence[float]) -> str:
    *but_last, last = (f"{x:.4g}" for x in values)
    return f"{', '.join(but_last)} and {last}" if but_last else last


def fit_circuits(rows: FitRows) -> CircuitsFit:
    """Fit M(d), or where the iron saturates a spline in the distance and all currents.

    Raises
    ------
    FitError
        If the rows do not determine the co-energy, if force and flux linkages contradict each other, or if the
        inductances are not positive definite everywhere.
    """
    functions, system = CurrentProducts(len(rows.names), rows.magnet), coenergy_system(rows)
    if _not_quadratic(rows, functions) > NOT_QUADRATIC:
        return _judged(*fit_saturating(system), system)
    basis = best_along_distance(system, functions)
    projection = system.projection(basis)
    if projection is None:
        raise FitError(
            f"The rows do not determine the inductances of {', '.join(rows.names)}. Sweep each circuit's current by "
            "itself and at least one point with each two together."
        )
    every = CurrentProducts(len(rows.names), magnet=True)
    coefficients = np.zeros((basis.shape[0], every.count))
    coefficients[:, (every.places[0] > 0) | rows.magnet] = projection.coefficients.reshape(basis.shape)
    magnetics = CoenergyMatrix(rows.names, basis.coordinate, basis.u_knots, U_DEGREE, coefficients)
    _require_definite(magnetics, rows)
    return _judged(magnetics, projection, system)


def _force_left_out(projection: Projection, system: CoenergySystem, out: BoolArray) -> FloatArray:
    """What a fit to the other rows misses their force by, over its scale; infinite where they do not determine it."""
    errors = projection.left_out(system.places(out))
    return np.full(int(out.sum()), np.inf) if errors is None else errors[: int(out.sum())]


@dataclass(frozen=True)
class _Planes:
    """The inner values of an axis, each left out with all of its points, and the force that is then missed."""

    poorest: float  # The largest rms of a value; below 0 where the axis has no inner value
    worst: float  # The largest of a point
    finer: tuple[str, tuple[float, ...]]

    @classmethod
    def of(cls, projection: Projection, system: CoenergySystem, name: str, column: FloatArray) -> "_Planes":
        """The middles beside all values that are missed at least half as much (rms) as the most missed one."""
        values = np.unique(column)
        missed = [_force_left_out(projection, system, column == value) for value in values[1:-1]]
        if not missed:
            return cls(-1.0, 0.0, (name, ()))
        sizes = np.array([rms(errors) for errors in missed])
        most = values[1:-1][2.0 * sizes >= sizes.max()]
        finer = np.unique(np.concatenate([middles(values, value) for value in most]))
        return cls(
            float(sizes.max()), max(float(np.max(np.abs(errors))) for errors in missed), (name, tuple(finer.tolist()))
        )


def _judged(magnetics: CoenergyMatrix | CoenergyTensor, projection: Projection, system: CoenergySystem) -> CircuitsFit:
    rows = system.rows
    force = magnetics.force(rows.distance, rows.circuit_currents) - rows.force
    flux = magnetics.flux_linkage(rows.distance, rows.circuit_currents) - rows.linked
    folds = points_left_out(rows) if isinstance(magnetics, CoenergyTensor) else system.folds
    errors = [_force_left_out(projection, system, out) for out in folds]
    left_out = np.concatenate(errors) if errors else np.array([np.inf])
    axes = [("distance", rows.distance)]
    if isinstance(magnetics, CoenergyTensor):
        axes += list(zip(rows.names, rows.circuit_currents.T, strict=True))
    planes = [_Planes.of(projection, system, name, column) for name, column in axes]
    fit = CircuitsFit(
        magnetics,
        float(np.max(np.abs(force) / rows.force_scale)),
        float(np.max(np.abs(left_out))),
        rms(left_out),
        max(rms_share(force, rows.force) or 0.0, rms_share(flux, rows.linked) or 0.0),
        planes[0].worst,
        max((plane.worst for plane in planes[1:]), default=0.0),
        max(planes, key=lambda plane: plane.poorest).finer,
    )
    _require_agreement(fit)
    return fit


def _not_quadratic(rows: FitRows, functions: CurrentProducts) -> float:
    """What the best quadratic form in the currents misses at each distance by itself, over the scale, at most."""
    flux = [((k,), column, flux_scale(column)) for k, column in enumerate(rows.linked.T)]
    readings = [((), rows.force, rows.force_scale), *flux]
    residuals = [
        misfit_by_currents(functions.columns(rows.circuit_currents, *k) / scale[:, None], values / scale, rows.distance)
        for k, values, scale in readings
    ]
    return float(np.max(np.abs(residuals)))


def _require_agreement(fit: CircuitsFit) -> None:
    """Refuse a force and flux linkages that no one co-energy has."""
    worst = fit.share
    if worst > POOR_CIRCUIT and isinstance(fit.magnetics, CoenergyTensor):
        raise FitError(
            f"The iron saturates, and the co-energy misses force or flux linkages by {amount(worst, '')} of their rms: "
            "the grid is too coarse. Sweep more currents where the iron begins to saturate, then more distances; first "
            f"of all add {fit.to_be_added()}."
        )
    if worst > POOR_CIRCUIT:
        raise FitError(
            f"No co-energy meets force and flux linkages together: the best one misses them by {amount(worst, '')} of "
            "their rms. Sweep more distances; if it stays, a sign or a unit of these columns is wrong."
        )


def _require_definite(magnetics: CoenergyMatrix, rows: FitRows) -> None:
    """Refuse inductances that would store a negative energy at some distance between the rows."""
    d = np.unique(np.concatenate([np.linspace(low, high, 8) for low, high in pairwise(rows.distances)]))
    least = np.linalg.eigvalsh(magnetics.matrix(d)[:, 1:, 1:])[:, 0]
    if not np.all(least > 0.0):
        raise FitError(
            f"The inductances of {', '.join(magnetics.names)} must be positive definite; at "
            f"{1e3 * d[np.argmin(least)]:.4g} mm their least eigenvalue is {amount(float(least.min()), 'H', 3)}. Sweep "
            "more distances, or check the signs of the flux linkages."
        )
