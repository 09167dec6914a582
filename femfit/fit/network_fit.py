"""The law of a plunger that saturates, fitted to force and flux linkage: least squares over its ten numbers."""

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np
from casadi import SX
from scipy.optimize import least_squares

from femfit.core.errors import FitError
from femfit.core.graph import Expression, GraphFunction, building
from femfit.core.numerics import BoolArray, FloatArray
from femfit.core.text import amount
from femfit.fit.constants import (
    NETWORK_CURRENTS,
    NETWORK_DISTANCES,
    NETWORK_IDLE,
    NETWORK_NUMBERS,
    NETWORK_OFF,
    NETWORK_STARTS,
)
from femfit.fit.ranking import Ranking, ranking_folds
from femfit.fit.rows import FitRows, rms
from femfit.model.network_magnetics import NETWORK, NetworkMagnetics


@dataclass(frozen=True, eq=False)
class NetworkFit:
    """A fitted network."""

    magnetics: NetworkMagnetics
    # Rms error of the force over its rms: on all rows, and on blocks of distances and single currents left out
    fitted: float
    left_out: float


def fit_network(rows: FitRows) -> NetworkFit:
    """Fit the network.

    Raises
    ------
    FitError
        If the table has no flux linkage, too few settings, or a force without current, which the law cannot have; or if
        no start comes to a minimum.
    """
    _require_plunger(rows)
    every = np.ones(len(rows.force), dtype=np.bool_)
    numbers = _best(rows, every, _starts(rows))
    magnetics = _magnetics(numbers.tolist(), rows)
    errors = []
    for out in ranking_folds(rows):
        refit = _magnetics(_best(rows, ~out, [numbers]).tolist(), rows)
        errors.append(refit.force(rows.distance[out], rows.current[out, None]) - rows.force[out])
    fitted = rms(magnetics.force(rows.distance, rows.current[:, None]) - rows.force) / rows.rms_force
    left_out = rms(np.concatenate(errors)) / rows.rms_force if errors else np.inf
    return NetworkFit(magnetics, fitted, max(fitted, left_out))


def better_network(rows: FitRows, ranking: Ranking) -> NetworkFit | None:
    """The network where it suits the table and its error, on points left out, is below that of the best law."""
    try:
        fit = fit_network(rows)
    except FitError:
        return None
    return fit if fit.left_out * rows.rms_force < ranking.recommended.error * rows.error_scale[0] else None


def _require_plunger(rows: FitRows) -> None:
    if rows.flux_linkage is None:
        raise FitError(
            f"Law {NETWORK} must have flux_linkage_Wb beside the force, to tell the iron from the gap; the table has "
            "none. Sweep or import it, or take another law."
        )
    currents = np.unique(np.abs(rows.current[rows.current != 0.0]))
    if len(currents) < NETWORK_CURRENTS or len(rows.distances) < NETWORK_DISTANCES:
        raise FitError(
            f"Law {NETWORK} must have at least {NETWORK_CURRENTS} currents beside zero and {NETWORK_DISTANCES} "
            f"distances; instead received {len(currents)} and {len(rows.distances)}. Sweep more."
        )
    idle = np.abs(rows.force[rows.current == 0.0])
    if np.max(idle, initial=0.0) > NETWORK_IDLE * rows.rms_force:
        raise FitError(
            f"Law {NETWORK} is of plungers without a magnet; the table has {amount(float(idle.max()), 'N', 3)} without "
            "current. Take another law, or the co-energy."
        )


def _starts(rows: FitRows) -> list[FloatArray]:
    """Numbers of a gap whose reluctance grows with a power of the distance, and of iron a little above the largest."""
    flux = rows.linked[:, 0]
    carries = rows.current != 0.0
    inductance = float(np.median(flux[carries] / rows.current[carries]))
    largest, current = float(np.max(np.abs(flux))), float(np.max(np.abs(rows.current)))
    return [
        np.array(
            [np.log(a), -np.log(inductance), 0.6, 0, 0, 1.3 * largest, 0, np.log(c * current), 0.05 * inductance, 0]
        )
        for a, c in NETWORK_STARTS
    ]


def _magnetics(numbers: Expression, rows: FitRows) -> NetworkMagnetics:
    """The law of numbers, or of an expression's."""
    a, r0, r1, r2, r3, s0, s1, c, l0, l1 = (numbers[k] for k in range(NETWORK_NUMBERS))
    reference = float(np.median(rows.distances - min(rows.distances[0], 0.0)))
    shift = reference * np.exp(a) - min(float(rows.distances[0]), 0.0)
    return NetworkMagnetics(reference, shift, (r0, r1, r2, r3), (s0, s1), np.exp(c), (l0, l1))


def _best(rows: FitRows, fitted: BoolArray, starts: list[FloatArray]) -> FloatArray:
    """The numbers with the least sum of squares on the rows kept, from several starts; scaled to order one."""
    first = starts[0]
    scale = np.array([1.0] * 5 + [abs(first[5])] * 2 + [1.0] + [float(np.exp(-first[1]))] * 2)
    residual = _residual(rows, fitted)

    def errors(numbers: FloatArray) -> FloatArray:
        return residual(numbers * scale)[0]

    def slopes(numbers: FloatArray) -> FloatArray:
        return residual(numbers * scale)[1] * scale

    minima = [least_squares(errors, start / scale, slopes, max_nfev=300) for start in starts]
    best = min(minima, key=lambda minimum: float(minimum.cost))
    if not np.isfinite(best.cost) or best.cost >= NETWORK_OFF:
        raise FitError(f"Law {NETWORK} comes to no minimum on this table. Take another law, or the co-energy.")
    return np.asarray(best.x * scale)


def _residual(rows: FitRows, fitted: BoolArray) -> Callable[[FloatArray], tuple[FloatArray, FloatArray]]:
    """Errors of force and flux linkage of numbers, and their Jacobian."""
    points = np.stack([rows.distance[fitted], rows.current[fitted]])
    measured = np.concatenate([rows.force[fitted], rows.linked[fitted, 0]])
    scale = np.repeat([rows.rms_force, rms(rows.linked)], points.shape[1])
    with building():
        at, numbers = SX.sym("at", 2), SX.sym("numbers", NETWORK_NUMBERS)
        coenergy = _magnetics(numbers, rows).expression(at[0], at[1])
        seen = ca.vertcat(-ca.gradient(coenergy, at[0]), ca.gradient(coenergy, at[1]))
        function = GraphFunction([at, numbers], ca.vertcat(seen, ca.vec(ca.jacobian(seen, numbers))))

    def residual(numbers: FloatArray) -> tuple[FloatArray, FloatArray]:
        values = function(points, numbers)
        errors = np.nan_to_num((values[:2].ravel() - measured) / scale, nan=NETWORK_OFF)
        slopes = np.nan_to_num(values[2:].reshape(NETWORK_NUMBERS, -1).T / scale[:, None], posinf=0.0, neginf=0.0)
        return errors.clip(-NETWORK_OFF, NETWORK_OFF), np.where(np.abs(errors) < NETWORK_OFF, slopes.T, 0.0).T

    return residual
