"""What an estimate says of every recorded channel, read by the filter or not."""

from femfit.core.arrays import FloatArray
from femfit.model.sensors import predict_sensor, reading_of, sensors_of
from femfit.replay.prepare import Prepared
from femfit.replay.run_filter import Replayed


def estimates_beside(prepared: Prepared, replayed: Replayed) -> dict[str, FloatArray]:
    """By column, the reading of a sensor of the model in each estimated state, shape (samples,)."""
    model, estimates = prepared.model, {}
    for name, sensor in sensors_of(model).items():
        column = reading_of(model, name).column
        if column in prepared.recorded and column not in estimates:
            estimates[column] = predict_sensor(model, sensor, replayed.mean[:, : model.order])
    return estimates
