"""A field at a sensor, or a pickup coil's flux linkage, of a sweep: fitted over the distance and all currents.

In a device that does not saturate the value is a line in each current at every distance, S_0(d) + sum i_k S_k(d), which
needs no grid. Else each current takes a spline with as many functions as there are swept currents.
"""

from dataclasses import dataclass

import numpy as np

from femfit.core.amount import amount
from femfit.core.arrays import BoolArray, FloatArray
from femfit.core.errors import FitError
from femfit.fit.circuit_rows import Along, choose_along_distance
from femfit.fit.constants import COARSE, CURRENT_DEGREE, DISTANCE_FOLDS, HELD_OUT_TARGET, U_DEGREE
from femfit.fit.rows import rms
from femfit.fit.splines import row_products
from femfit.model.bspline import basis_matrix
from femfit.model.sensed_field import SensedField


@dataclass(frozen=True, eq=False)
class SensedRows:
    """One quantity at N points, in SI units."""

    distance: FloatArray
    currents: FloatArray  # (N, n)
    values: FloatArray

    @property
    def distances(self) -> FloatArray:
        """Distinct distances, ascending."""
        return np.unique(self.distance)


@dataclass(frozen=True, eq=False)
class SensedFit:
    """A fitted field and its error with distances left out, over the range of the values."""

    field: SensedField
    held_out: float
    rms: float

    def said(self, what: str, unit: str) -> str:
        """Both errors as a sentence, and what to do about a large one."""
        text = f"{what}: misfit {amount(self.rms, unit, 3)} rms, and {amount(self.held_out, '')} of its range at "
        text += "distances left out."
        return text if self.held_out < COARSE else f"{text} The sweep is too coarse for it: sweep more distances."


@dataclass(frozen=True, eq=False)
class _Currents:
    """Functions of all currents together: 1 and each current, or products of splines."""

    knots: tuple[FloatArray, ...]
    degrees: tuple[int, ...]
    linear: bool

    def columns(self, currents: FloatArray) -> FloatArray:
        """Value of each function, (points, functions)."""
        if self.linear:
            return np.column_stack([np.ones(len(currents)), currents])
        axes = zip(currents.T, self.knots, self.degrees, strict=True)
        return row_products(np.ones((len(currents), 1)), *(basis_matrix(*axis) for axis in axes))

    def coefficients(self, solution: FloatArray) -> FloatArray:
        """Of the products of splines, shape (functions of u, functions of i_1, ..)."""
        shape = [len(knots) - degree - 1 for knots, degree in zip(self.knots, self.degrees, strict=True)]
        if not self.linear:
            return solution.reshape(-1, *shape)
        result = solution[:, 0].reshape(-1, *[1] * len(shape)) * np.ones(shape)
        for k, knots in enumerate(self.knots):  # a line's coefficients are its values at both ends
            along = np.array(knots[[0, -1]]).reshape([2 if j == k else 1 for j in range(len(shape))])
            result = result + solution[:, 1 + k].reshape(-1, *[1] * len(shape)) * along
        return result


def fit_sensed(rows: SensedRows, what: str) -> SensedFit:
    """Fit the values; ``what`` names them in an error.

    Raises
    ------
    FitError
        If there are too few distances or currents, or the rows do not determine the fit.
    """
    scale = float(np.ptp(rows.values)) or 1.0
    axes = [np.unique(column) for column in rows.currents.T]
    constant = [name for name, axis in enumerate(axes, 1) if len(axis) < 2]
    if constant:
        raise FitError(
            f"{what} needs two currents or more of each circuit; circuit {constant[0]} has one. Sweep another."
        )
    linear = _Currents(tuple(np.repeat(axis[[0, -1]], 2) for axis in axes), (1,) * len(axes), True)
    missed = _not_linear(rows, linear)
    # Noisy rows off a grid determine no splines; lines that miss little are then what they tell
    tried = [linear] if missed <= HELD_OUT_TARGET else [_splines(axes), *([linear] if missed < COARSE else [])]
    for currents in tried:
        columns = currents.columns(rows.currents)
        (coordinate, knots), error = choose_along_distance(
            rows.distances, lambda *along, of=columns: _left_out(along, rows, of) / scale
        )
        solution = _solved((coordinate, knots), rows, columns, np.ones(len(rows.values), dtype=np.bool_))
        if solution is not None:
            break
    else:
        raise FitError(
            f"{what}: the rows do not determine it. Sweep each circuit's current by itself, or every combination of "
            "them where the iron saturates."
        )
    field = SensedField(
        coordinate,
        knots,
        U_DEGREE,
        currents.knots,
        currents.degrees,
        currents.coefficients(solution.reshape(-1, columns.shape[1])),
    )
    currents_of_rows = rows.currents if len(axes) > 1 else rows.currents[:, 0] if axes else np.zeros_like(rows.distance)
    errors = field.field(rows.distance, currents_of_rows) - rows.values
    return SensedFit(field, error, rms(errors))


def _splines(axes: list[FloatArray]) -> _Currents:
    """Interpolating splines, whose knots lie at currents but the outermost ones."""
    degrees = tuple(min(CURRENT_DEGREE, len(axis) - 1) for axis in axes)
    knots = []
    for axis, degree in zip(axes, degrees, strict=True):
        inner = axis[2:-2] if degree == CURRENT_DEGREE else axis[:0]
        knots.append(np.concatenate([np.repeat(axis[0], degree + 1), inner, np.repeat(axis[-1], degree + 1)]))
    return _Currents(tuple(knots), degrees, False)


def _not_linear(rows: SensedRows, linear: _Currents) -> float:
    """What lines in the currents miss at a distance by itself, rms over the range."""
    columns, errors = linear.columns(rows.currents), np.zeros_like(rows.values)
    for d in rows.distances:
        at_distance = rows.distance == d
        errors[at_distance] = (
            columns[at_distance] @ np.linalg.lstsq(columns[at_distance], rows.values[at_distance], rcond=None)[0]
            - rows.values[at_distance]
        )
    return rms(errors) / (float(np.ptp(rows.values)) or 1.0)


def _left_out(along: Along, rows: SensedRows, columns: FloatArray) -> float:
    """Rms error with inner distances left out in turn."""
    inner, errors = rows.distances[1:-1], []
    for fold in range(min(DISTANCE_FOLDS, len(inner))):
        out = np.isin(rows.distance, inner[fold::DISTANCE_FOLDS])
        solution = _solved(along, rows, columns, ~out)
        if solution is None:
            return np.inf
        errors.append(_products(along, rows.distance[out], columns[out]) @ solution - rows.values[out])
    return rms(np.concatenate(errors))


def _products(along: Along, distance: FloatArray, columns: FloatArray) -> FloatArray:
    coordinate, knots = along
    return row_products(basis_matrix(coordinate.of(distance), knots, U_DEGREE), columns)


def _solved(along: Along, rows: SensedRows, columns: FloatArray, fitted: BoolArray) -> FloatArray | None:
    """Coefficients, flat; None where the rows do not determine them."""
    matrix = _products(along, rows.distance[fitted], columns[fitted])
    scale = np.linalg.norm(matrix, axis=0)
    if len(matrix) < matrix.shape[1] or not np.all(scale > 0.0):
        return None
    solution, _, rank, _ = np.linalg.lstsq(matrix / scale, rows.values[fitted], rcond=1e-11)
    return np.asarray(solution / scale) if rank == matrix.shape[1] else None
