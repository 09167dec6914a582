"""The Hall characteristic: magnet part and coil part of the field at the Hall element, fitted like the force.

B(d, i) = MH(d) + CH(d) i (+ CH_2(d) i^2 where a held-out current asks for it), each a spline in u = d_0 / d.

References
----------
A. Chowdhury and A. Sarjas, Sensors 16 (2016) 1504, eqs. (14) to (16) and Figure 11.
"""

from dataclasses import dataclass

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.core.errors import FitError
from femfit.fit.bounded_qp import QPSolution, solve_bounded_qp
from femfit.fit.rows import FitRows
from femfit.model.bspline import TensorSpline, basis_matrix
from femfit.model.hall import HallField

U_DEGREE = 4
HELD_OUT_TARGET = 2e-5
"""The fewest cells are taken whose held-out error is below this part of the field's range: far from the magnet, where
the field is a twentieth of its range, a thousandth of it is still tens of micrometres."""


@dataclass(frozen=True, eq=False)
class HallFit:
    """A fitted Hall characteristic.

    Parameters
    ----------
    field : HallField
        B(d, i).
    rms_T, max_T : float
        Misfit on the sweep.
    held_out : float
        Rms error on held-out rows over the field's range.
    coil_slope_T_per_A : (float, float)
        Least and largest dB/di over the sweep: the paper's CH; their difference is the magnet's own permeability.
    magnet_field_T : (float, float)
        B without current at the largest and the least distance: the paper's MH.
    qp : QPSolution
        The solved programme.
    """

    field: HallField
    rms_T: float
    max_T: float
    held_out: float
    coil_slope_T_per_A: tuple[float, float]
    magnet_field_T: tuple[float, float]
    qp: QPSolution


def fit_hall(rows: FitRows, hall: FloatArray) -> HallFit:
    """Fit the field at the Hall element.

    Parameters
    ----------
    rows : FitRows
        Of the sweep; at least two currents.
    hall : array, shape (n,)
        B_z in T.

    Returns
    -------
    HallFit
        The characteristic.

    Raises
    ------
    FitError
        If there is only one current.
    """
    scale = float(np.ptp(hall)) or 1.0
    knots_u, knots_i, held_out = _choose(rows, hall, scale)
    degree = int(np.sum(knots_i == knots_i[0])) - 1
    sigma = np.full_like(hall, 1e-4 * scale)
    qp = solve_bounded_qp(_columns(rows.distance, rows.current, rows, knots_u, knots_i), hall, sigma)
    shape = (len(knots_u) - U_DEGREE - 1, len(knots_i) - degree - 1)
    field = HallField(float(rows.distances[0]), TensorSpline(knots_u, knots_i, U_DEGREE, degree, qp.x.reshape(shape)))
    _, _, slope = field.derivatives(rows.distance, rows.current)
    ends = np.array([rows.distances[-1], rows.distances[0]])
    magnet = field.field(ends, np.zeros(2))
    return HallFit(
        field=field,
        rms_T=float(np.sqrt(np.mean(qp.residual**2))),
        max_T=float(np.max(np.abs(qp.residual))),
        held_out=held_out,
        coil_slope_T_per_A=(float(slope.min()), float(slope.max())),
        magnet_field_T=(float(magnet[0]), float(magnet[1])),
        qp=qp,
    )


def _choose(rows: FitRows, hall: FloatArray, scale: float) -> tuple[FloatArray, FloatArray, float]:
    low, high = float(rows.currents[0]), float(rows.currents[-1])
    u_min = float(rows.distances[0] / rows.distances[-1])
    if len(rows.currents) < 2:
        raise FitError(
            "The Hall field needs at least two currents, to tell the coil's part from the magnet's; instead received "
            f"{len(rows.currents)}. Sweep more currents."
        )
    best = (np.inf, np.zeros(0), np.zeros(0))
    for degree in range(1, min(3, len(rows.currents) - 1) + 1):
        knots_i = np.repeat([low, high], degree + 1)
        for cells in (1, 2, 3, 4, 6, 8, 12):
            if cells > 1 and U_DEGREE + cells + 2 > len(rows.distances):
                break
            breaks = np.geomspace(u_min, 1.0, cells + 1)
            knots_u = np.concatenate([np.repeat(breaks[0], U_DEGREE), breaks, np.repeat(breaks[-1], U_DEGREE)])
            error = _held_out(rows, hall, knots_u, knots_i) / scale
            if error < HELD_OUT_TARGET:
                return knots_u, knots_i, error
            if error < 0.9 * best[0]:
                best = (error, knots_u, knots_i)
    return best[1], best[2], best[0]


def _held_out(rows: FitRows, hall: FloatArray, knots_u: FloatArray, knots_i: FloatArray) -> float:
    squares = []
    inner = rows.distances[1:-1]
    for fold in range(min(4, len(inner))):
        out = np.isin(rows.distance, inner[fold::4])
        fitted = np.linalg.lstsq(
            _columns(rows.distance[~out], rows.current[~out], rows, knots_u, knots_i), hall[~out], rcond=1e-12
        )[0]
        predicted = _columns(rows.distance[out], rows.current[out], rows, knots_u, knots_i) @ fitted
        squares.append((predicted - hall[out]) ** 2)
    return float(np.sqrt(np.mean(np.concatenate(squares))))


def _columns(
    distance: FloatArray, current: FloatArray, rows: FitRows, knots_u: FloatArray, knots_i: FloatArray
) -> FloatArray:
    degree = int(np.sum(knots_i == knots_i[0])) - 1
    in_u = basis_matrix(rows.distances[0] / distance, knots_u, U_DEGREE)
    in_i = basis_matrix(current, knots_i, degree)
    return np.asarray((in_u[:, :, None] * in_i[:, None, :]).reshape(len(distance), -1))
