"""The commands that a controller may give: the drivers' range, as far as the currents stay where the model was fitted.

A driver of 24 V on a winding of 1.4 ohm may need its voltage to change the current, and would leave the swept currents
at once if it were held. So the voltage is kept between those that bring the current within a sample to the ends of the
covered range,

    U = R i + L (i_end - i)/t - k_m v.
"""

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.core.remembered import remembered
from femfit.model.actuator_model import ActuatorModel
from femfit.model.drive import circuit_terms, command_limits, commands_currents
from femfit.simulation.constants import COVERED_PART


@remembered
def limits_of(model: ActuatorModel) -> FloatArray:
    """Least and largest command of each circuit, of shape (2, n)."""
    return np.array([command_limits(circuit) for circuit in model.circuits]).T


@remembered
def covered_currents(model: ActuatorModel) -> FloatArray:
    """Currents that a controller may ask for, of shape (2, n); infinite where the driver gives none beyond anyway."""
    widths = model.validity.current_limits_A[: len(model.circuits)].T
    margin = (1.0 - COVERED_PART) * np.abs(widths).max(axis=0)
    low, high = widths[0] + margin, widths[1] - margin
    one_sided = [(circuit.voltage_min_V >= 0.0, circuit.voltage_max_V <= 0.0) for circuit in model.circuits]
    kept_low, kept_high = np.array(one_sided).T
    # Currents of a driver of one sign cannot pass a sweep that ends at zero
    low = np.where(kept_low & (widths[0] >= 0.0) & (widths[0] <= margin), -np.inf, low)
    high = np.where(kept_high & (widths[1] <= 0.0) & (widths[1] >= -margin), np.inf, high)
    return np.stack([low, high])


def limited(model: ActuatorModel, estimate: FloatArray, command: FloatArray) -> FloatArray:
    """Commands of shape (runs, n) within the drivers' limits and the covered currents, from estimates (runs, 2 + n)."""
    low, high = limits_of(model)
    amplified = commands_currents(model)
    if amplified.all():
        return np.clip(command, low, high)
    box = model.validity
    distance = np.clip(estimate[:, 0], box.distance_min_m, box.distance_max_m)
    currents = np.clip(estimate[:, 2:], *box.current_limits_A[: command.shape[1]].T)
    _, motional, inductance = circuit_terms(model, distance, currents)
    self_inductance_rate = np.einsum("rkk->rk", inductance) / model.sample_time_s
    resting = model.resistances_ohm * currents - motional * estimate[:, 1:2] - self_inductance_rate * currents
    ends = [
        np.where(amplified, limit, resting + self_inductance_rate * end)
        for limit, end in zip((low, high), covered_currents(model), strict=True)
    ]
    return np.clip(np.clip(command, ends[0], ends[1]), low, high)
