"""A field at a sensor, or a pickup coil's flux linkage, of a sweep: fitted over the distance and all currents.

In a device that does not saturate the value is a line in each current at every distance, S_0(d) + sum i_k S_k(d), which
needs no grid. Else each current takes a spline with as many functions as there are swept currents.

The Hall characteristic: magnet part and coil part of the field at the Hall element, fitted like the force.

B(d, i) = MH(d) + CH(d) i (+ CH_2(d) i^2 where a held-out current asks for it), each a spline in a coordinate u(d).

The flux linkages of a sweep's pickup coils, fitted one by one.

References
----------
A. Chowdhury and A. Sarjas, Sensors 16 (2016) 1504, eqs. (14) to (16) and Figure 11.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from femfit.core.errors import FitError
from femfit.core.numerics import BoolArray, FloatArray, first_best
from femfit.core.sweep_columns import PICKUP_COLUMN
from femfit.core.text import amount
from femfit.fit.basis import CoenergyBasis, CurrentSplines, clamped_knots, misfit_by_currents, row_products
from femfit.fit.bounded_qp import solve_bounded_qp
from femfit.fit.coenergy import splines_of_current
from femfit.fit.coenergy_choice import Along, choose_along_distance, distance_coordinates
from femfit.fit.constants import COARSE, CURRENT_DEGREE, DISTANCE_FOLDS, HALL_TARGET, HELD_OUT_TARGET, U_DEGREE
from femfit.fit.rows import FitRows, rms
from femfit.model.bspline import DistanceCoordinate, TensorSpline, basis_matrix
from femfit.model.hall import CurrentAxis, HallSpline, SensedField
from femfit.tables.sweep_table import SweepTable, current_names


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
    lines = CurrentSplines(tuple(np.repeat(axis[[0, -1]], 2) for axis in axes), (1,) * len(axes))
    each = np.column_stack([np.ones(len(rows.values)), rows.currents])  # lines in each current by itself
    missed = rms(misfit_by_currents(each, rows.values, rows.distance)) / scale
    # Noisy rows off a grid determine no splines; lines that miss little are then what they tell
    tried = [lines] if missed <= HELD_OUT_TARGET else [_splines(axes), *([lines] if missed < COARSE else [])]
    for functions in tried:
        columns = each if functions is lines else functions.columns(rows.currents)
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
    coefficients = solution.reshape(-1, columns.shape[1])
    table = _of_lines(coefficients, lines) if functions is lines else functions.table(coefficients)
    field = SensedField(coordinate, knots, U_DEGREE, tuple(map(CurrentAxis, functions.knots, functions.degrees)), table)
    errors = field.field(rows.distance, rows.currents) - rows.values
    return SensedFit(field, error, rms(errors))


def _of_lines(coefficients: FloatArray, lines: CurrentSplines) -> FloatArray:
    """Coefficients of 1 and each current (functions of u, 1 + n) as those of the products of lines (.., 2, .., 2)."""
    ends = np.meshgrid(*(knots[[0, -1]] for knots in lines.knots), indexing="ij")  # a line's coefficients
    return np.asarray(np.tensordot(coefficients, np.stack([np.ones(lines.shape), *ends]), axes=1))


def _splines(axes: list[FloatArray]) -> CurrentSplines:
    """Interpolating splines, whose knots lie at currents but the outermost ones."""
    degrees = tuple(min(CURRENT_DEGREE, len(axis) - 1) for axis in axes)
    knots = []
    for axis, degree in zip(axes, degrees, strict=True):
        inner = axis[2:-2] if degree == CURRENT_DEGREE else axis[:0]
        knots.append(np.concatenate([np.repeat(axis[0], degree + 1), inner, np.repeat(axis[-1], degree + 1)]))
    return CurrentSplines(tuple(knots), degrees)


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


@dataclass(frozen=True, eq=False)
class HallFit:
    """A fitted Hall characteristic."""

    field: HallSpline
    rms_T: float
    max_T: float
    held_out: float  # Rms error on held-out rows over the field's range
    # Least and largest dB/di over the sweep; their difference is the magnet's own permeability
    coil_slope_T_per_A: tuple[float, float]
    magnet_field_T: tuple[float, float]  # B without current at the largest and the least distance

    def to_dict(self) -> dict[str, Any]:
        """As JSON-ready data, without the field."""
        numbers = {name: value for name, value in vars(self).items() if name not in {"field", "held_out"}}
        coefficients = int(self.field.spline.coefficients.size)
        return {**numbers, "held_out_of_range": self.held_out, "coefficients": coefficients}


def fit_hall(rows: FitRows, hall: FloatArray) -> HallFit:
    """Fit the field B_z (n,) in T at the Hall element; FitError if there is only one current."""
    scale = float(np.ptp(hall)) or 1.0
    basis, held_out = _choose(rows, hall, scale)
    qp = solve_bounded_qp(basis.columns(rows.distance, rows.circuit_currents), hall, np.full_like(hall, 1e-4 * scale))
    (knots,), (degree,) = splines_of_current(basis).knots, splines_of_current(basis).degrees
    spline = TensorSpline(basis.u_knots, knots, basis.u_degree, degree, qp.x.reshape(basis.shape))
    field = HallSpline(basis.coordinate, spline)
    _, _, slope = field.derivatives(rows.distance, rows.circuit_currents)
    ends = np.array([rows.distances[-1], rows.distances[0]])
    magnet = field.field(ends, np.zeros((2, 1)))
    return HallFit(
        field=field,
        rms_T=rms(qp.residual),
        max_T=float(np.max(np.abs(qp.residual))),
        held_out=held_out,
        coil_slope_T_per_A=(float(slope.min()), float(slope.max())),
        magnet_field_T=(float(magnet[0]), float(magnet[1])),
    )


def _choose(rows: FitRows, hall: FloatArray, scale: float) -> tuple[CoenergyBasis, float]:
    if len(rows.currents) < 2 and not rows.without_current:
        raise FitError(
            "The Hall field needs at least two currents, to separate its two parts, coil and magnet; instead "
            f"received {len(rows.currents)}. Sweep more currents."
        )
    ends = [0.0, 1.0] if rows.without_current else [float(rows.currents[0]), float(rows.currents[-1])]
    coordinates = distance_coordinates(rows.distances)
    chosen, least = _basis(rows, coordinates[0], 1, np.repeat(ends, 1 if rows.without_current else 2)), np.inf
    for degree in (0,) if rows.without_current else range(1, min(3, len(rows.currents) - 1) + 1):
        for cells in (1, 2, 3, 4, 6, 8, 12):
            if cells > 1 and U_DEGREE + cells + 2 > len(rows.distances):
                break
            alike = [_basis(rows, coordinate, cells, np.repeat(ends, degree + 1)) for coordinate in coordinates]
            errors = [_held_out(basis, rows, hall) / scale for basis in alike]
            best = first_best([-error for error in errors])
            basis, error = alike[best], errors[best]
            if error < HALL_TARGET:
                return basis, error
            if error < 0.9 * least:
                chosen, least = basis, error
    return chosen, least


def _basis(rows: FitRows, coordinate: DistanceCoordinate, cells: int, knots_i: FloatArray) -> CoenergyBasis:
    d = rows.distances
    ends = np.sort(coordinate.of(d[[0, -1]]))
    breaks = (np.geomspace if coordinate.inverse else np.linspace)(ends[0], ends[1], cells + 1)
    u_degree = min(U_DEGREE, len(d) - 2)  # one distance left out must leave as many as there are functions
    functions = CurrentSplines((knots_i,), (len(knots_i) // 2 - 1,))
    return CoenergyBasis(coordinate, clamped_knots(breaks, u_degree), functions, u_degree)


def _held_out(basis: CoenergyBasis, rows: FitRows, hall: FloatArray) -> float:
    errors = []
    inner = rows.distances[1:-1]
    columns = basis.columns(rows.distance, rows.circuit_currents)
    for fold in range(min(4, len(inner))):
        out = np.isin(rows.distance, inner[fold::4])
        fitted = np.linalg.lstsq(columns[~out], hall[~out], rcond=1e-12)[0]
        errors.append(columns[out] @ fitted - hall[out])
    return rms(np.concatenate(errors))


def fit_pickups(table: SweepTable) -> dict[str, SensedFit | str]:
    """The flux linkage of each pickup coil of a table by the coil's name, or why it could not be fitted."""
    rows, fits = table.valid_rows(), dict[str, SensedFit | str]()
    currents = rows[current_names(rows)].to_numpy(dtype=float)
    if not currents.any():  # a pair of magnets, or one current of zero: nothing to fit along
        currents = currents[:, :0]
    distance = rows["distance_m"].to_numpy(dtype=float)
    for column in map(str, rows.columns):
        match = PICKUP_COLUMN.fullmatch(column)
        if match is None:
            continue
        values = rows[column].to_numpy(dtype=float)
        try:
            fits[match[1]] = fit_sensed(SensedRows(distance, currents, values), f"Pickup coil {match[1]!r}")
        except FitError as error:
            fits[match[1]] = str(error)
    return fits
