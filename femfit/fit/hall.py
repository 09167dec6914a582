"""The Hall characteristic: magnet part and coil part of the field at the Hall element, fitted like the force.

B(d, i) = MH(d) + CH(d) i (+ CH_2(d) i^2 where a held-out current asks for it), each a spline in a coordinate u(d).

References
----------
A. Chowdhury and A. Sarjas, Sensors 16 (2016) 1504, eqs. (14) to (16) and Figure 11.
"""

from dataclasses import dataclass

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.core.errors import FitError
from femfit.core.ties import first_best
from femfit.fit.bounded_qp import solve_bounded_qp
from femfit.fit.coenergy_choice import distance_coordinates
from femfit.fit.constants import HALL_TARGET, U_DEGREE
from femfit.fit.rows import FitRows, rms
from femfit.fit.splines import clamped_knots, row_products
from femfit.model.bspline import LINE, TensorSpline, basis_matrix
from femfit.model.coordinate import DistanceCoordinate
from femfit.model.hall import HallSpline


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


def fit_hall(rows: FitRows, hall: FloatArray) -> HallFit:
    """Fit the field B_z (n,) in T at the Hall element; FitError if there is only one current."""
    scale = float(np.ptp(hall)) or 1.0
    basis, held_out = _choose(rows, hall, scale)
    qp = solve_bounded_qp(basis.columns(rows.distance, rows.current), hall, np.full_like(hall, 1e-4 * scale))
    shape = (len(basis.knots_u) - basis.u_degree - 1, basis.degree + 1)
    field = HallSpline(
        basis.coordinate,
        TensorSpline(basis.knots_u, basis.knots_i, basis.u_degree, basis.degree, qp.x.reshape(shape), LINE),
    )
    _, _, slope = field.derivatives(rows.distance, rows.current)
    ends = np.array([rows.distances[-1], rows.distances[0]])
    magnet = field.field(ends, np.zeros(2))
    return HallFit(
        field=field,
        rms_T=rms(qp.residual),
        max_T=float(np.max(np.abs(qp.residual))),
        held_out=held_out,
        coil_slope_T_per_A=(float(slope.min()), float(slope.max())),
        magnet_field_T=(float(magnet[0]), float(magnet[1])),
    )


@dataclass(frozen=True, eq=False)
class _Basis:
    """Splines in u(d), times powers of the current up to a degree."""

    coordinate: DistanceCoordinate
    knots_u: FloatArray
    knots_i: FloatArray
    degree: int

    @property
    def u_degree(self) -> int:
        return int(np.sum(self.knots_u == self.knots_u[0])) - 1

    def columns(self, distance: FloatArray, current: FloatArray) -> FloatArray:
        """Value of each basis function, shape (n, functions)."""
        in_u = basis_matrix(self.coordinate.of(distance), self.knots_u, self.u_degree)
        in_i = basis_matrix(current, self.knots_i, self.degree)
        return row_products(in_u, in_i)


def _choose(rows: FitRows, hall: FloatArray, scale: float) -> tuple[_Basis, float]:
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


def _basis(rows: FitRows, coordinate: DistanceCoordinate, cells: int, knots_i: FloatArray) -> _Basis:
    d = rows.distances
    ends = np.sort(coordinate.of(d[[0, -1]]))
    breaks = (np.geomspace if coordinate.inverse else np.linspace)(ends[0], ends[1], cells + 1)
    u_degree = min(U_DEGREE, len(d) - 2)  # one distance left out must leave as many as there are functions
    return _Basis(coordinate, clamped_knots(breaks, u_degree), knots_i, len(knots_i) // 2 - 1)


def _held_out(basis: _Basis, rows: FitRows, hall: FloatArray) -> float:
    errors = []
    inner = rows.distances[1:-1]
    columns = basis.columns(rows.distance, rows.current)
    for fold in range(min(4, len(inner))):
        out = np.isin(rows.distance, inner[fold::4])
        fitted = np.linalg.lstsq(columns[~out], hall[~out], rcond=1e-12)[0]
        errors.append(columns[out] @ fitted - hall[out])
    return rms(np.concatenate(errors))
