"""What an estimate says of every recorded channel, read by the filter or not."""

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.model.sampling import sampled_readings
from femfit.model.sensors import reading_of, sensors_of
from femfit.replay.prepare import Prepared
from femfit.replay.run_filter import Replayed


def estimates_beside(prepared: Prepared, replayed: Replayed) -> dict[str, FloatArray]:
    """By column, the reading of a sensor of the model in each estimated state, shape (samples,)."""
    model, estimates = prepared.model, {}
    for name, sensor in sensors_of(model).items():
        column = reading_of(model, name).column
        if column in prepared.recorded and column not in estimates:
            stretches = np.split(replayed.mean[:, : model.order], prepared.log.begins[1:])
            estimates[column] = np.concatenate([sampled_readings(model, sensor, states) for states in stretches])
    return estimates
