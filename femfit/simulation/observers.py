"""Where the controller's state comes from: a Kalman filter, or the direct measurement.

An observer steps as :class:`femfit.estimate.filter.Filter` does, from one of its states to the next.

The distance straight from the first sensor's reading, where it tells one.

The distance straight from the Hall voltage: invert the magnet's field once the coil's part is removed.

The paper's (14), d = MH(CH(v_hall)), with the fitted field in place of its polynomials: find the d at which
quiescent + sensitivity B(d, i) equals the reading.

References
----------
A. Chowdhury and A. Sarjas, Sensors 16 (2016) 1504, eqs. (14) to (16) and Figure 11.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import product
from typing import TypeAlias

import numpy as np

from femfit.core.errors import FilterError
from femfit.core.numerics import FloatArray
from femfit.device.electrics import PositionSensor
from femfit.estimate.filter import Filter
from femfit.estimate.filter_state import FilterState
from femfit.estimate.record import distance_of
from femfit.model.actuator_model import ActuatorModel
from femfit.model.hall import HallSensor
from femfit.model.sensors import sensor_named

NEWTON_STEPS = 60
TABLE_POINTS = 513


Inverse = Callable[[FloatArray, FloatArray], FloatArray]
"""From readings of shape (runs,), and currents in A of shape (runs, circuits), to distances in m of shape (runs,)."""


def distance_inverse(model: ActuatorModel, name: str) -> Inverse:
    """The inversion of the characteristic of a sensor of this name, prepared once a model.

    A distance is at the nearer edge of the validity domain where the reading lies outside of what it reads there, and
    NaN where the reading, or the current that it depends on, is no number.

    Raises
    ------
    FilterError
        If it reads something that many distances give.
    """
    sensor, box = sensor_named(model, name), model.validity
    if isinstance(sensor, PositionSensor):  # the current does not matter
        return lambda reading, _: np.clip(distance_of(sensor, reading), box.distance_min_m, box.distance_max_m)
    if not isinstance(sensor, HallSensor):
        raise FilterError(
            f"A distance must follow from the reading of one sensor for a loop without a filter; {name} reads "
            f"{sensor.kind}. Use a filter, which needs no inversion, or name a position or Hall sensor first."
        )
    distances = np.linspace(box.distance_min_m, box.distance_max_m, TABLE_POINTS)
    for corner in product(*box.current_limits_A):
        slope = sensor.field.derivatives(distances, np.array(corner))[1]
        turns = np.flatnonzero(np.sign(slope) != (np.sign(slope[0]) or 1.0))
        if len(turns):
            amperes = " and ".join(f"{current_A:g} A" for current_A in corner)
            raise FilterError(
                f"The Hall voltage must change monotonically with the distance to be inverted; at {amperes} it turns "
                f"at {1e3 * distances[turns[0]]:.3g} mm. Move the Hall element, or use the filter, which needs no "
                "inversion."
            )
    volts = sensor.output(distances, box.current_limits_A.mean(axis=1))
    order = np.argsort(volts)
    return partial(_of_hall_voltage, model, sensor, distances[order], volts[order])


def _of_hall_voltage(
    model: ActuatorModel,
    sensor: HallSensor,
    distances: FloatArray,
    table: FloatArray,
    volts: FloatArray,
    current: FloatArray,
) -> FloatArray:
    """Solve quiescent + sensitivity B(d, i) = v for d by Newton's steps within a bracket that narrows.

    The first guess is that of ascending readings in V at the middle current, ``table``, of so many distances in m.
    """
    box, middle = model.validity, model.validity.current_limits_A.mean(axis=1)
    ends, centre = (box.distance_min_m, box.distance_max_m), 0.5 * (box.distance_min_m + box.distance_max_m)
    near, far = (sensor.output(np.asarray(end), current) for end in ends)
    finite = np.isfinite(volts) & np.all(np.isfinite(current), axis=-1)
    with np.errstate(invalid="ignore"):
        inside = finite & (volts >= np.minimum(near, far)) & (volts <= np.maximum(near, far))
        edge = np.where((volts > np.maximum(near, far)) == (near > far), *ends)
    # What cannot be solved is taken at the middle current, where it can
    wanted, amps = np.where(inside, volts, table[len(table) // 2]), np.where(inside[..., None], current, middle)
    falling = np.where(inside, near > far, distances[0] > distances[-1])
    coil = sensor.output(np.asarray(centre), amps) - sensor.output(np.asarray(centre), middle)
    distance = np.interp(wanted - coil, table, distances)
    low, high = (np.full_like(distance, end) for end in ends)
    span = table[-1] - table[0]
    for _ in range(NEWTON_STEPS):
        field, slope, _ = sensor.field.derivatives(distance, amps)
        excess = sensor.quiescent_V + sensor.sensitivity_V_per_T * field - wanted
        if np.all(np.abs(excess) <= 1e-13 * span + 1e-15 * abs(sensor.quiescent_V)):
            break
        beyond = (excess > 0.0) == falling  # the solution lies at a larger distance
        low, high = np.where(beyond, distance, low), np.where(beyond, high, distance)
        with np.errstate(divide="ignore", invalid="ignore"):
            step = distance - excess / (sensor.sensitivity_V_per_T * slope)
        distance = np.where((step >= low) & (step <= high), step, 0.5 * (low + high))
    if np.any(np.abs(excess) > 1e-9 * span):
        raise FilterError(
            "The Hall voltage could not be inverted to a distance: the fitted field is too uneven within the "
            "validity box. Fit the Hall field with fewer knots."
        )
    return np.where(inside, distance, np.where(finite, edge, np.nan))


@dataclass(frozen=True, eq=False)
class DirectObserver:
    """The direct measurement, which the paper compares its filter with.

    Distance by inverting the first sensor's characteristic, velocity by the difference quotient, currents from the
    coils' own L i' = U - R i + k_m v, which is kinder than the static U/R of (15) because the paper's coil takes 6 ms.

    References
    ----------
    A. Chowdhury and A. Sarjas, Sensors 16 (2016) 1504, eqs. (14) to (16) and Figure 14.
    """

    model: ActuatorModel
    sensor: str  # Name of the first

    @cached_property
    def inverse(self) -> Inverse:
        """Distance from its reading."""
        return distance_inverse(self.model, self.sensor)

    def start(self, mean: FloatArray) -> FilterState:
        """The belief itself, without a covariance and innovations."""
        runs, mean = len(mean), np.array(mean)
        unknown, none, quiet = np.full(runs, np.nan), np.empty((runs, 0, 0)), np.zeros(runs, dtype=np.intp)
        return FilterState(mean, mean, none, none, unknown, unknown, np.zeros(runs), quiet)

    def update(self, state: FilterState, measurement: FloatArray) -> FilterState:
        """The distance alone, from readings of shape (runs, sensors)."""
        mean, first = state.mean.copy(), measurement[:, 0]
        mean[:, 0] = np.where(np.isnan(first), mean[:, 0], self.inverse(first, self.model.currents_of(mean)))
        return replace(state, mean=mean)

    def step(self, state: FilterState, voltage: FloatArray, measurement: FloatArray) -> FilterState:
        """Coil equations, inversion, difference quotient; a sample that is missing leaves distance and velocity."""
        before, first = state.mean, measurement[:, 0]
        currents = self._coil_currents(before, voltage)
        distance = self.inverse(first, currents)
        velocity = (distance - before[:, 0]) / self.model.sample_time_s
        mean = np.column_stack([distance, velocity, currents])
        mean[np.isnan(first), :2] = before[np.isnan(first), :2]
        return replace(state, mean=mean)

    def _coil_currents(self, mean: FloatArray, command: FloatArray) -> FloatArray:
        """Currents (runs, n) one sample later as if nothing else conducted, of bodies that go on within the domain."""
        model, n = self.model.without_eddies, command.shape[1]
        box, count, time = model.validity, model.sample_step.count, model.sample_time_s
        state = np.zeros((model.order, len(mean)))
        state[: 2 + n] = mean[:, : 2 + n].T
        state[0] = np.clip(state[0], box.distance_min_m, box.distance_max_m)
        state[1] = np.clip(state[1], (box.distance_min_m - state[0]) / time, (box.distance_max_m - state[0]) / time)
        step = model.sample_step.function(time / count, free=False)
        for _ in range(count):
            state = step(state, command.T)[:-1]
        return state[2 : 2 + n].T


Observer: TypeAlias = Filter | DirectObserver
