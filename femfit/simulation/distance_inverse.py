"""The distance straight from the first sensor's reading, where it tells one."""

from dataclasses import dataclass

import numpy as np

from femfit.core.arrays import BoolArray, FloatArray
from femfit.core.errors import FilterError
from femfit.device.sensors import PositionSensor
from femfit.filters.direct import HallInverse, hall_inverse
from femfit.model.actuator_model import ActuatorModel
from femfit.model.hall_sensor import HallSensor
from femfit.model.sensors import characteristic, sensor_named


@dataclass(frozen=True, eq=False)
class PositionInverse:
    """Distance from a position sensor's reading, by interpolation; the current does not matter."""

    model: ActuatorModel
    sensor: PositionSensor

    def distance(self, reading: FloatArray, current: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Distances in m, and which readings lie beyond the characteristic within the validity domain."""
        box = self.model.validity
        ends = np.array([box.distance_min_m, box.distance_max_m])
        places = np.unique(np.concatenate([np.asarray(self.sensor.distances_m).clip(*ends), ends]))
        read = characteristic(self.sensor, places)
        order = np.argsort(read)
        several = len(self.model.circuits) > 1
        reading = np.broadcast_to(reading, np.shape(current)[:-1] if several else np.shape(current))
        outside = ~((reading >= read.min()) & (reading <= read.max()))
        return np.interp(reading, read[order], places[order]), outside

    def reading(self, distance: FloatArray, current: FloatArray) -> FloatArray:  # noqa: ARG002  as of a Hall element
        """What it reads at a distance in m."""
        return characteristic(self.sensor, distance)


def distance_inverse(model: ActuatorModel, name: str) -> HallInverse | PositionInverse:
    """The inversion of a sensor of this name.

    Raises
    ------
    FilterError
        If it reads something that many distances give.
    """
    sensor = sensor_named(model, name)
    if isinstance(sensor, HallSensor):
        return hall_inverse(model)
    if isinstance(sensor, PositionSensor):
        return PositionInverse(model, sensor)
    raise FilterError(
        f"A distance must follow from the reading of one sensor for a loop without a filter; {name} reads "
        f"{sensor.kind}. Use a filter, which needs no inversion, or name a position or Hall sensor first."
    )
