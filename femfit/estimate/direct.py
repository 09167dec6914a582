"""The distance straight from the Hall voltage: invert the magnet's field once the coil's part is removed.

The paper's (14), d = MH(CH(v_hall)), with the fitted field in place of its polynomials: find the d at which
quiescent + sensitivity B(d, i) equals the reading.

References
----------
A. Chowdhury and A. Sarjas, Sensors 16 (2016) 1504, eqs. (14) to (16) and Figure 11.
"""

from dataclasses import dataclass
from itertools import product
from typing import final

import numpy as np

from femfit.core.errors import FilterError
from femfit.core.numerics import BoolArray, FloatArray
from femfit.model.actuator_model import ActuatorModel

NEWTON_STEPS = 60
TABLE_POINTS = 513


@final
@dataclass(frozen=True, eq=False)
class HallInverse:
    """Distance from Hall voltage, prepared once a model; build with :func:`hall_inverse`."""

    model: ActuatorModel
    # Table at the middle current, ascending in volts: the first guess; shape (points,)
    distances_m: FloatArray
    volts: FloatArray

    def distance(self, hall_voltage: FloatArray, current: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Solve quiescent + sensitivity B(d, i) = v for d, at readings v in V of shape (n,).

        Parameters
        ----------
        current : array, shape (n, circuits)
            In A.

        Returns
        -------
        distance : array, shape (n,)
            In m; at the nearer edge of the validity box where the reading is outside of its voltages, NaN where it is
            no number.
        clipped : array of bool, shape (n,)
            Which were outside, or no number.
        """
        box, sensor = self.model.validity, self.model.require_sensor()
        volts, current = np.asarray(hall_voltage, float), np.asarray(current, float)
        shape = np.broadcast_shapes(volts.shape, current.shape[:-1])
        volts, current = np.broadcast_to(volts, shape), np.broadcast_to(current, (*shape, current.shape[-1]))
        near = sensor.output(np.asarray(box.distance_min_m), current)
        far = sensor.output(np.asarray(box.distance_max_m), current)
        finite = np.isfinite(volts) & np.all(np.isfinite(current), axis=-1)
        low, high = np.minimum(near, far), np.maximum(near, far)
        with np.errstate(invalid="ignore"):
            inside = finite & (volts >= low) & (volts <= high)
        # What cannot be solved is taken at the middle current, where it can
        wanted = np.where(inside, volts, self.volts[len(self.volts) // 2])
        amps = np.where(inside[..., None], current, _middle(self.model)[: current.shape[-1]])
        solved = self._solve(wanted, amps)
        with np.errstate(invalid="ignore"):
            edge = np.where((volts > high) == (near > far), box.distance_min_m, box.distance_max_m)
        return np.where(inside, solved, np.where(finite, edge, np.nan)), ~inside

    def reading(self, distance: FloatArray, current: FloatArray) -> FloatArray:
        """What the element reads in V, at distances in m and currents in A."""
        return self.model.require_sensor().output(distance, current)

    def _solve(self, volts: FloatArray, current: FloatArray) -> FloatArray:
        box, sensor = self.model.validity, self.model.require_sensor()
        scale = sensor.sensitivity_V_per_T
        centre = np.asarray(0.5 * (box.distance_min_m + box.distance_max_m))
        coil = sensor.output(centre, current) - sensor.output(centre, _middle(self.model))
        distance = np.interp(volts - coil, self.volts, self.distances_m)
        tolerance = 1e-13 * (self.volts[-1] - self.volts[0]) + 1e-15 * abs(sensor.quiescent_V)
        low = np.full_like(distance, box.distance_min_m)
        high = np.full_like(distance, box.distance_max_m)
        falling = sensor.output(low, current) > sensor.output(high, current)
        for _ in range(NEWTON_STEPS):
            field, slope, _ = sensor.field.derivatives(distance, current)
            excess = sensor.quiescent_V + scale * field - volts
            if np.all(np.abs(excess) <= tolerance):
                return distance
            beyond = (excess > 0.0) == falling  # the solution lies at a larger distance
            low, high = np.where(beyond, distance, low), np.where(beyond, high, distance)
            with np.errstate(divide="ignore", invalid="ignore"):
                step = distance - excess / (scale * slope)
            distance = np.where((step >= low) & (step <= high), step, 0.5 * (low + high))
        field = sensor.output(distance, current)
        if np.any(np.abs(field - volts) > 1e-9 * (self.volts[-1] - self.volts[0])):
            raise FilterError(
                "The Hall voltage could not be inverted to a distance: the fitted field is too uneven within the "
                "validity box. Fit the Hall field with fewer knots."
            )
        return distance


def hall_inverse(model: ActuatorModel) -> HallInverse:
    """Prepare the inversion."""
    box, sensor = model.validity, model.require_sensor()
    distances = np.linspace(box.distance_min_m, box.distance_max_m, TABLE_POINTS)
    for corner in product(*box.current_limits_A):
        slope = sensor.field.derivatives(distances, np.array(corner))[1]
        if not (np.all(slope > 0.0) or np.all(slope < 0.0)):
            turn = distances[np.flatnonzero(np.sign(slope) != np.sign(slope[0]))[0]]
            amperes = " and ".join(f"{current_A:g} A" for current_A in corner)
            raise FilterError(
                f"The Hall voltage must change monotonically with the distance to be inverted; at {amperes} it "
                f"turns at {1e3 * turn:.3g} mm. Move the Hall element, or use the filter, which needs no inversion."
            )
    volts = sensor.output(distances, _middle(model))
    order = np.argsort(volts)
    return HallInverse(model, distances[order], volts[order])


def _middle(model: ActuatorModel) -> FloatArray:
    """The middle of the validity domain's currents, of shape (n,)."""
    return np.asarray(model.validity.current_limits_A.mean(axis=1))
