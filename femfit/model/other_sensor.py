"""The sensors of a model beside the Hall element."""

from typing import TypeAlias

from femfit.device.sensors import AccelerationSensor, CurrentSensor, ForceSensor, PositionSensor
from femfit.model.pickup import PickupSensor

OtherSensor: TypeAlias = CurrentSensor | PositionSensor | PickupSensor | AccelerationSensor | ForceSensor
