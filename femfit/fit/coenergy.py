"""One co-energy W'(d, i) fitted to force, flux linkage and inductance together.

W' is a tensor B-spline in a coordinate u(d) and i; F = -dW'/dd, flux linkage = dW'/di and inductance = d^2W'/di^2 are
linear in its coefficients, so all columns of the sweep enter one bounded QP, and reciprocity holds exactly.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from femfit.core.errors import TableError
from femfit.core.numerics import FloatArray
from femfit.core.results import listing
from femfit.fit.basis import CoenergyBasis
from femfit.fit.bounded_qp import BoundedQP, Inequalities, QPSolution
from femfit.fit.coenergy_choice import choose_basis
from femfit.fit.coenergy_system import CoenergySystem, coenergy_system, held_out_masks
from femfit.fit.constants import ALLOWED_VIOLATION, CONTRADICTION, KEPT_INDUCTANCE, SHAPE_POINTS, U_DEGREE
from femfit.fit.rows import FitRows
from femfit.model.bspline import TensorSpline, basis_matrix
from femfit.model.hall import HallSpline
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
    # Errors of force in N and, where the iron saturates, flux linkage in Wb and inductance in H at each row: as fitted,
    # and with inner rows predicted by the others, at least those of the fit; shape (rows,) each
    fitted: dict[str, FloatArray]
    left_out: dict[str, FloatArray]
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
    basis, held_out = choose_basis(rows, system)
    left_out = replace(system, folds=held_out_masks(rows, ends=True)).left_out_errors(basis)
    _require_one_table(system, left_out)
    matrix, value, sigma = system.equations(basis)
    keep = system.determined(basis)
    shape = _shape_inequalities(basis, rows, names)
    imposed = Inequalities(shape.matrix[:, keep], shape.right, shape.labels)
    qp, active = _solve_with_shapes(matrix[:, keep], value, sigma, imposed, len(names))
    coefficients = np.zeros(basis.size)
    coefficients[keep] = qp.x
    coefficients = coefficients.reshape(basis.shape)
    (knots,), (degree,) = basis.functions.knots, basis.functions.degrees
    if rows.flux_linkage is None and open_inductance_H:
        # i^2 in the current's B-splines, exact since their degree is at least 2
        points = np.linspace(knots[0], knots[-1], 4 * basis.shape[1])
        square = np.linalg.lstsq(basis_matrix(points, knots, degree), points**2, rcond=None)[0]
        coefficients = coefficients + 0.5 * open_inductance_H * square[None, :]
    magnetics = CoenergySpline(basis.coordinate, TensorSpline(basis.u_knots, knots, U_DEGREE, degree, coefficients))
    # W' is counted from the largest distance without current
    origin = np.array([[np.clip(0.0, rows.currents[0], rows.currents[-1])]])
    offset = magnetics.coenergy(rows.distances[-1:], origin)
    magnetics = with_coefficients(magnetics, coefficients - offset)
    errors = _errors(rows, magnetics, left_out)
    return CoenergyFit(
        magnetics=magnetics,
        basis=basis,
        held_out=held_out,
        fitted={name: fitted for name, (fitted, _) in errors.items()},
        left_out={name: np.maximum(*pair) for name, pair in errors.items()},
        constraints=names,
        active=active,
        qp=qp,
    )


def _require_one_table(system: CoenergySystem, left_out: Sequence[FloatArray]) -> None:
    """Refuse a value beside which the rows predict each other far beyond all other values: shapes have no room then."""
    for channel, errors in zip(system.channels, left_out, strict=True):
        worst = int(np.argmax(np.abs(channel.value)))
        value, others = channel.value[worst], float(np.abs(np.delete(channel.value, worst)).max(initial=0.0))
        if errors.max() > CONTRADICTION * others > 0.0:
            distance, currents = (settings[channel.which[worst]] for settings in (system.distance, system.currents))
            column, amperes = ("force_N", "flux_linkage_Wb", "inductance_H")[len(channel.circuits)], listing(currents)
            raise TableError(
                f"{column} at {1e3 * distance:g} mm and {amperes} A is {value:g}, and its neighbours contradict it; "
                f"all others are within {others:g}. Correct the cell, or remove the row."
            )


def _errors(
    rows: FitRows, magnetics: CoenergySpline, left_out: Sequence[FloatArray]
) -> dict[str, tuple[FloatArray, FloatArray]]:
    """Sizes of the errors of force and, where the iron saturates, flux linkage and inductance: as fitted, and left out.

    Where the table has no inductances a flux linkage that is off bends the slopes up to half a step beside it.
    """
    point = rows.distance, rows.circuit_currents
    errors = {"force": (np.abs(magnetics.force(*point) - rows.force), left_out[0])}
    if rows.saturates:
        linked = np.abs(magnetics.flux_linkage(*point) - rows.linked)[:, 0]
        errors["flux linkage"] = linked, left_out[1]
    if rows.saturates and rows.inductance is None:
        half = 0.5 * np.gradient(rows.currents)[np.searchsorted(rows.currents, rows.current)]
        errors["inductance"] = linked / half, left_out[1] / half
    elif rows.inductance is not None:
        fitted = np.nan_to_num(magnetics.inductance(*point) - rows.inductance)[:, 0, 0]
        errors["inductance"] = np.abs(fitted), left_out[2]
    return errors


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
        imposed = Inequalities(shapes.matrix[which], shapes.right[which], labels)
        qp = BoundedQP(matrix, y, sigma, inequalities=imposed).solve()
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
    for name, axis, level, sign in (
        ("decreasing", rows.distance, rows.current, -1.0),
        ("attracting", rows.current, rows.distance, 1.0),
    ):
        order = np.lexsort((axis, level))
        steps = np.diff(rows.force[order])[np.diff(level[order]) == 0.0]
        if np.all(sign * steps >= 0.0) and (axis is rows.distance or not rows.without_current):
            names.append(name)
    return names


def _shape_inequalities(basis: CoenergyBasis, rows: FitRows, names: Sequence[str]) -> Inequalities:
    """The shapes on a grid of points, the inductance with what keeps it from a dip between them."""
    (knots,), (degree,) = basis.functions.knots, basis.functions.degrees
    u = _in_cells(basis.u_knots, max(SHAPE_POINTS, 6 * basis.u_cells))
    i = _in_cells(knots, {0: 0, 2: 2}.get(degree, 4 * basis.functions.cells[0]))
    grid_u, grid_i = (axis.ravel() for axis in np.meshgrid(u, i, indexing="ij"))
    d = basis.coordinate.distance(grid_u)
    blocks, labels, right = [np.zeros((0, basis.size))], list[str](), list[float]()
    for name in names:
        along, circuits, sign = _SHAPE_DERIVATIVES[name]
        blocks.append(sign * basis.columns(d, grid_i[:, None], along, circuits))
        labels += [f"{SHAPES[name]} at {1e3 * a:.4g} mm, {b:.4g} A" for a, b in zip(d, grid_i, strict=True)]
        least = max(min(rows.inductances, default=0.0), 0.0) if name == "inductance" else 0.0
        right += len(d) * [KEPT_INDUCTANCE * least]
    return Inequalities(np.concatenate(blocks), np.array(right), tuple(labels))


def _in_cells(knots: FloatArray, count: int) -> FloatArray:
    """So many steps along an axis, as many in a narrow cell as in a wide one."""
    breaks = np.unique(knots)
    return np.interp(np.linspace(0, len(breaks) - 1, count + 1), np.arange(len(breaks)), breaks)


Spline = TypeVar("Spline", CoenergySpline, HallSpline)


def with_coefficients(like: Spline, coefficients: FloatArray) -> Spline:
    """The same functions with other coefficients, flat or not."""
    spline = replace(like.spline, coefficients=coefficients.reshape(like.spline.coefficients.shape))
    return replace(like, spline=spline)
