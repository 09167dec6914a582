"""One co-energy W'(d, i) fitted to force, flux linkage and inductance together.

W' is a tensor B-spline in a coordinate u(d) and i; F = -dW'/dd, flux linkage = dW'/di and inductance = d^2W'/di^2 are
linear in its coefficients, so all columns of the sweep enter one bounded QP, and reciprocity holds exactly.

How far the co-energy of iron that saturates may be off between the points of its sweep, without solving any more.

A bend of the steel that is narrower than a step of the sweep leaves much open: splines of as many pieces, in other
coordinates of the distance and with their breaks in the current moved, meet the points alike and part between them. By
how much they part from the model is the estimate. It is the median over these splines for force and flux linkage; the
inductance is a broken line in the current for all of them, and what they share does not show, hence two thirds.

Calibrated on 29 grids, thinned out of sweeps of a conical solenoid, a holding magnet, a thin flange, two flat
solenoids, a relay and a valve: of what the points that were taken out are missed by (rms), the estimate is 0.27 to 3.2
for the force, 0.27 to 2.4 for the flux linkage and 0.31 to 6 for the inductance; within a factor of two on 21, 24 and
25 grids, of three on 26, 28 and 27. Points left out in turn give 0.1 to 2 for the force: they never leave out the least
distance, where it is missed most.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from femfit.core.numerics import BoolArray, FloatArray
from femfit.fit.basis import CoenergyBasis, CurrentSplines
from femfit.fit.bounded_qp import Inequalities, QPSolution, solve_bounded_qp
from femfit.fit.coenergy_choice import choose_basis, distance_trials
from femfit.fit.coenergy_system import coenergy_system, determined
from femfit.fit.constants import (
    ALLOWED_VIOLATION,
    COARSE,
    COARSE_INDUCTANCE,
    MOVED_BREAKS,
    PARTED,
    SHAPE_POINTS,
    U_DEGREE,
)
from femfit.fit.rows import FitRows, rms
from femfit.model.bspline import TensorSpline, basis_matrix
from femfit.model.magnetics import CoenergySpline

SHAPES: dict[str, str] = {
    "inductance": "inductance >= 0 (co-energy convex in the current)",
    "decreasing": "force does not grow with distance",
    "attracting": "force does not fall as the current grows",
}
"""Shape constraints by name."""

_SHAPE_DERIVATIVES = {
    "inductance": (0, (0, 0), 1.0),
    "decreasing": (2, (), 1.0),
    "attracting": (1, (0,), -1.0),
}
"""Of each shape the derivatives of W' that must not be negative: order in the distance, circuits, sign."""


@dataclass(frozen=True, eq=False)
class CoenergyFit:
    """A fitted co-energy."""

    magnetics: CoenergySpline
    basis: CoenergyBasis
    # Rms error by which the basis was chosen, the larger of force (relative to itself) and flux linkage (relative to
    # its change over the distance): on held-out rows, or on all rows where that is larger
    held_out: float
    # Error of the force at each row with inner rows predicted by the others, at least that of the fit; shape (rows,)
    left_out_N: FloatArray
    # What a finer sweep must lower: the same where the iron saturates, for a spline may meet its own table and swing
    # between, and else the error of the fit; shape (rows,)
    missed_N: FloatArray
    constraints: tuple[str, ...]
    active: tuple[str, ...]
    qp: QPSolution


def fit_coenergy(rows: FitRows, open_inductance_H: float = 0.0) -> CoenergyFit:
    """Fit the co-energy with those constraints of :data:`SHAPES` that the raw data obey everywhere.

    The force leaves the inductance at the largest distance open: a sweep without flux linkage takes
    ``open_inductance_H`` for it.
    """
    names = tuple(obeyed_shapes(rows))
    system = coenergy_system(rows)
    basis, held_out = choose_basis(system)
    matrix, value, sigma = system.equations(basis)
    keep = determined(basis, rows)
    shape = _shape_inequalities(basis, rows, names, open_inductance_H)
    imposed = Inequalities(shape.matrix[:, keep], shape.right, shape.labels)
    qp, active = _solve_with_shapes(matrix[:, keep], value, sigma, imposed, len(names))
    coefficients = np.zeros(basis.size)
    coefficients[keep] = qp.x
    coefficients = coefficients.reshape(basis.shape)
    if rows.flux_linkage is None and open_inductance_H:
        # i^2 in the current's B-splines, exact since their degree is at least 2
        ((knots,), (degree,)) = splines_of_current(basis).knots, splines_of_current(basis).degrees
        points = np.linspace(knots[0], knots[-1], 4 * basis.shape[1])
        square = np.linalg.lstsq(basis_matrix(points, knots, degree), points**2, rcond=None)[0]
        coefficients = coefficients + 0.5 * open_inductance_H * square[None, :]
    magnetics = spline_of(basis, coefficients, rows)
    missed = np.abs(magnetics.force(rows.distance, rows.circuit_currents) - rows.force)
    left_out = np.maximum(missed, system.left_out_force_errors(basis))
    return CoenergyFit(
        magnetics=magnetics,
        basis=basis,
        held_out=held_out,
        left_out_N=left_out,
        missed_N=left_out if rows.saturates else missed,
        constraints=names,
        active=active,
        qp=qp,
    )


def _solve_with_shapes(
    matrix: FloatArray, y: FloatArray, sigma: FloatArray, shapes: Inequalities, kinds: int
) -> tuple[QPSolution, tuple[str, ...]]:
    """Solve, adding the inequalities that are violated until none is; and where those that were added act.

    Most shapes hold without being asked for. Leaving them out keeps the QP small, and spares it the many inequalities
    that hold with equality by symmetry (a plunger without a magnet has no force without current).
    """
    chosen = np.zeros(len(shapes.right), dtype=np.bool_)
    while True:
        which = np.flatnonzero(chosen)
        labels = tuple(shapes.labels[n] for n in which)
        imposed = Inequalities(shapes.matrix[which], shapes.right[which], labels) if len(which) else None
        qp = solve_bounded_qp(matrix, y, sigma, inequalities=imposed)
        if kinds == 0:
            return qp, ()
        value = shapes.matrix @ qp.x
        largest = np.repeat(np.max(np.abs(value.reshape(kinds, -1)), axis=1), len(value) // kinds)
        violated = (value - shapes.right < -ALLOWED_VIOLATION * largest) & ~chosen
        if not np.any(violated):
            return qp, tuple(label for label, hit in zip(labels, qp.active_inequalities, strict=True) if hit)
        chosen |= violated


def obeyed_shapes(rows: FitRows) -> list[str]:
    """The shape constraints that the raw data obey between all neighbouring rows.

    ``inductance`` always, since a passive winding's co-energy is convex.
    """
    names = ["inductance"] if rows.flux_linkage is not None else []
    if all(np.all(np.diff(_along(rows, rows.current == i, rows.distance)) <= 0) for i in rows.currents):
        names.append("decreasing")
    attracting = all(np.all(np.diff(_along(rows, rows.distance == d, rows.current)) >= 0) for d in rows.distances)
    if attracting and not rows.without_current:
        names.append("attracting")
    return names


def _along(rows: FitRows, which: BoolArray, axis: FloatArray) -> FloatArray:
    return np.asarray(rows.force[which][np.argsort(axis[which])])


def _shape_inequalities(
    basis: CoenergyBasis, rows: FitRows, names: Sequence[str], open_inductance: float
) -> Inequalities:
    """The shapes on a grid of points."""
    (knots,), (degree,) = splines_of_current(basis).knots, splines_of_current(basis).degrees
    fraction = np.linspace(0.0, basis.u_cells, max(SHAPE_POINTS, 6 * basis.u_cells) + 1)
    u = np.interp(fraction, np.arange(basis.u_cells + 1), np.unique(basis.u_knots))
    points = {0: 0, 2: 2}.get(degree, 4 * splines_of_current(basis).cells[0])
    i = np.linspace(knots[0], knots[-1], points + 1)
    grid_u, grid_i = (axis.ravel() for axis in np.meshgrid(u, i, indexing="ij"))
    d = basis.coordinate.distance(grid_u)
    blocks, right, labels = [np.zeros((0, basis.size))], [np.zeros(0)], []
    for name in names:
        along, circuits, sign = _SHAPE_DERIVATIVES[name]
        blocks.append(sign * basis.columns(d, grid_i[:, None], along, circuits))
        offset = open_inductance if name == "inductance" and rows.flux_linkage is None else 0.0
        right.append(np.full(len(d), -offset))
        labels += [f"{SHAPES[name]} at {1e3 * a:.4g} mm, {b:.4g} A" for a, b in zip(d, grid_i, strict=True)]
    return Inequalities(np.concatenate(blocks), np.concatenate(right), tuple(labels))


def splines_of_current(basis: CoenergyBasis) -> CurrentSplines:
    """The functions of the current of a fitted co-energy."""
    assert isinstance(basis.functions, CurrentSplines)  # noqa: S101  of one circuit, or where the iron saturates
    return basis.functions


def spline_of(basis: CoenergyBasis, coefficients: FloatArray, rows: FitRows) -> CoenergySpline:
    """The spline of coefficients, W' counted from the largest distance without current."""
    (knots,), (degree,) = splines_of_current(basis).knots, splines_of_current(basis).degrees

    def spline(table: FloatArray) -> CoenergySpline:
        return CoenergySpline(basis.coordinate, TensorSpline(basis.u_knots, knots, U_DEGREE, degree, table))

    origin = np.clip(0.0, rows.currents[0], rows.currents[-1])
    return spline(coefficients - spline(coefficients).coenergy(rows.distances[-1:], np.array([[origin]])))


@dataclass(frozen=True, eq=False)
class Between:
    """Estimated errors between the points, as parts of the rms over the table."""

    # Rms over the points halfway
    force: float
    flux_linkage: float
    inductance: float
    finer: dict[str, list[float]]  # The ``distance_m`` and ``current_A`` to add where it is missed most

    @property
    def poor(self) -> bool:
        """Whether the user is told to sweep more finely."""
        return self.force > COARSE or self.inductance > COARSE_INDUCTANCE


def missed_between(fit: CoenergyFit, rows: FitRows) -> Between | None:
    """The estimate; None for a table without inductances, whose model is judged by points left out."""
    if rows.inductance is None or rows.flux_linkage is None:
        return None
    distance, current = halfway(rows)
    splines = fit.magnetics, *_others(fit.basis, rows)
    states = [spline.state(distance, current[:, None]) for spline in splines]
    linked = [spline.flux_linkage(distance, current[:, None])[:, 0] for spline in splines]
    values = np.array([[at.force, flux, at.inductance[:, 0, 0]] for at, flux in zip(states, linked, strict=True)])
    table = (rows.force, rows.flux_linkage[:, 0], rows.inductance[np.isfinite(rows.inductance)])
    off = np.abs(values[1:] - values[0]) / np.array([[rms(column)] for column in table])
    parted = np.array([np.quantile(off[:, k], share, axis=0) for k, share in enumerate(PARTED)])
    force, flux_linkage, inductance = (rms(departure) for departure in parted)
    chosen = parted[0] if force > COARSE else parted[2]
    most = 2.0 * chosen >= chosen.max()
    finer = {
        "distance_m": np.setdiff1d(distance[most], rows.distances).tolist(),
        "current_A": np.setdiff1d(current[most], rows.currents).tolist(),
    }
    return Between(force, flux_linkage, inductance, finer)


def halfway(rows: FitRows) -> tuple[FloatArray, FloatArray]:
    """Distances and currents in the middles of the grid's cells and of their sides, shape (n,) each."""
    axes = [np.sort(np.append(axis, 0.5 * (axis[1:] + axis[:-1]))) for axis in (rows.distances, rows.currents)]
    distance, current = (grid.ravel() for grid in np.meshgrid(*axes, indexing="ij"))
    new = ~(np.isin(distance, rows.distances) & np.isin(current, rows.currents))
    return distance[new], current[new]


def _others(basis: CoenergyBasis, rows: FitRows) -> Iterator[CoenergySpline]:
    """The other splines: with each of the distance's trials the inner breaks in the current go up or down.

    They go without the shape constraints, which hold at the points and hardly act between them.
    """
    system = coenergy_system(rows)
    columns = np.array([rows.force, rows.linked[:, 0], rows.inductance[:, 0, 0]])[..., None]  # type: ignore[index]
    functions = splines_of_current(basis)
    (knots,) = functions.knots
    step = MOVED_BREAKS * np.diff(np.unique(knots)).min() * ((knots > knots[0]) & (knots < knots[-1]))
    alike = [replace(basis, **trial) for trial in distance_trials(rows)]
    for n, trial_basis in enumerate(trial for trial in alike if trial.u_cells == basis.u_cells):
        moved = replace(trial_basis, functions=replace(functions, knots=(knots + (-1) ** (n + 1) * step,)))
        yield spline_of(moved, system.without_constraints(moved, columns).reshape(moved.shape), rows)
