"""Where a body is at rest before the command: without current, under weight, springs, load and magnets alone.

What the drawn sensors read of a motion in open loop, as a record has it, without noise and rounding.
"""

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq

from femfit.core.numerics import FloatArray
from femfit.model.actuator_model import ActuatorModel
from femfit.model.hall import PickupSensor
from femfit.model.sensors import predict_sensor, reading_of, sensors_of

PLACES = 401
"""Conventional: places of the travel between which a change of sign of the force is looked for."""

ROUNDING = 1e-9
"""Numerical: part of the largest force by which forces that balance may miss zero."""


def rest_distance(model: ActuatorModel) -> float:
    """The far stop if the body is pressed to it, else a stable equilibrium, else the near stop.

    Of several equilibria the one that is farthest away. Where there is neither a stop nor an equilibrium, the model's
    first reference distance, or the middle of its validity domain.
    """
    motion, box = model.require_motion(), model.validity
    near, far = motion.near_stop, motion.far_stop
    low = box.distance_min_m if near is None else near.distance_m
    high = box.distance_max_m if far is None else far.distance_m

    def acting(distance: ArrayLike) -> tuple[FloatArray, FloatArray]:
        places_m = np.asarray(distance, dtype=np.float64)
        idle = np.zeros((*places_m.shape, len(model.circuits)))
        return motion.static_force(places_m), -model.magnetics.state(places_m, idle).force

    places = np.linspace(low, high, PLACES)
    static, magnetic = acting(places)
    forces = static + magnetic
    rounding = ROUNDING * float((np.abs(static) + np.abs(magnetic)).max())
    if far is not None and forces[-1] >= -motion.coulomb_N - rounding:
        return far.distance_m
    stable = np.flatnonzero((forces[:-1] > 0.0) & (forces[1:] <= 0.0))
    if len(stable):
        return float(brentq(lambda place: float(sum(acting(place))), places[stable[-1]], places[stable[-1] + 1]))
    if near is not None:
        return near.distance_m
    if far is not None:
        return far.distance_m
    if model.reference_distances_m:
        return model.reference_distances_m[0]
    return 0.5 * (box.distance_min_m + box.distance_max_m)


def sensor_columns(model: ActuatorModel, time: FloatArray, states: FloatArray) -> dict[str, FloatArray]:
    """Readings by their columns, cut to their range and as late as drawn; before the first of them, that one.

    A pickup coil reads the mean over the step before. A sensor without a column of a record is left out, such as one of
    two position sensors in volts.

    Parameters
    ----------
    time : array, shape (steps,)
        In s.
    states : array, shape (steps, n)
        As in :mod:`femfit.model.dynamics`.
    """
    columns = {}
    for name, sensor in sensors_of(model).items():
        reading = reading_of(model, name)
        if reading.column is None:
            continue
        if isinstance(sensor, PickupSensor):
            flux = sensor.flux.field(states[:, 0], model.currents_of(states))
            steps = np.diff(time)
            values = np.concatenate([[0.0], np.diff(flux) / np.where(steps > 0.0, steps, np.inf)])
        else:
            values = predict_sensor(model, sensor, states, time)
        late = np.interp(time - reading.delay_s, time, values)
        columns[reading.column] = np.clip(late, reading.low, reading.high)
    return columns
