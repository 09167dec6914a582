"""What the drawn sensors read of a motion in open loop, as a record has it, without noise and rounding."""

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.model.actuator_model import ActuatorModel
from femfit.model.pickup import PickupSensor
from femfit.model.sensors import predict_sensor, reading_of, sensors_of


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
