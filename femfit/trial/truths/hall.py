"""A Hall element whose output falls behind in large fields."""

from typing import Literal

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.trial.device import Conditions, Device, HiddenError, Readings
from femfit.trial.truths.truth import Truth, no_hall


def hall_saturation(law: Literal["tanh", "power", "knee"]) -> Truth:
    """An output that bends towards a limit 1 / size: soon, late, or from two thirds of it on."""

    def bent(x: FloatArray) -> FloatArray:
        if law == "tanh":
            return np.tanh(x)
        if law == "power":
            return np.asarray(x / (1.0 + np.abs(x) ** 3) ** (1.0 / 3.0))
        beyond = np.maximum(np.abs(x) - 2.0 / 3.0, 0.0)
        return np.asarray(np.sign(x) * (np.minimum(np.abs(x), 2.0 / 3.0) + np.tanh(3.0 * beyond) / 3.0))

    def reading(device: Device, size: float, at: Conditions, values: Readings) -> Readings:
        zero = device.actuator.hall.quiescent_V if device.actuator.hall else 0.0
        room = 1.0 / max(abs(size), 1e-9)
        return {"hall_V": zero + room * bent((values["hall_V"] - zero) / room)}

    error = HiddenError(lambda _: 1.5, ("hall_V",), reading=reading, names=("hall_saturation",))
    return Truth(lambda _, rng: error, lacks=no_hall)
