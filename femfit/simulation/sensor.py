"""The Hall sensor as the controller sees it: field, offset, drift, noise, clipping, converter, faults.

V = quiescent + S B(d, i) + offset + drift t + noise, clipped to the output's range and rounded to the converter's
steps of (V_max - V_min) / 2^bits.

References
----------
Allegro MicroSystems, A1321/A1322/A1323 datasheet: 5 mV/G, ratiometric quiescent output of half the supply.
B. Widrow and I. Kollar, Quantization Noise (Cambridge University Press, 2008): error variance LSB^2/12.
"""

from dataclasses import dataclass

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.model.hall_sensor import HallSensor


@dataclass(frozen=True, eq=False)
class SensorErrors:
    """What is wrong with the sensor; every entry is one number or one a run."""

    noise_V: FloatArray | float = 0.0  # Standard deviation of white noise on a sample; shape (runs,)
    offset_V: FloatArray | float = 0.0  # Constant offset that the model does not know
    drift_V_per_s: FloatArray | float = 0.0
    stuck_after_s: FloatArray | float = np.inf  # From then on the last reading is repeated; infinite for never
    dropout_probability: FloatArray | float = 0.0  # Probability that a sample reads the lower end of the range
    # The runs are this many equal blocks in a row that share their random numbers, so that what differs between the
    # blocks is not hidden by the noise (common random numbers)
    blocks: int = 1


def read_sensor(
    sensor: HallSensor,
    errors: SensorErrors,
    last: FloatArray,
    voltage: FloatArray,
    time: float,
    random: np.random.Generator,
) -> FloatArray:
    """Take one reading.

    Parameters
    ----------
    last : array, shape (runs,)
        The reading before.
    voltage : array, shape (runs,)
        The element's output without these errors, in V.
    """
    drawn = len(voltage) // errors.blocks
    # Always both, so that switching one error on leaves the other's random numbers as they were
    white, lost = random.standard_normal(drawn), random.random(drawn)
    if errors.blocks > 1:
        white, lost = np.tile(white, errors.blocks), np.tile(lost, errors.blocks)
    voltage = voltage + errors.offset_V + errors.drift_V_per_s * time + errors.noise_V * white
    reading = np.where(lost < errors.dropout_probability, sensor.output_min_V, convert(sensor, voltage))
    return np.where(time >= errors.stuck_after_s, last, reading)


def convert(sensor: HallSensor, voltage: FloatArray) -> FloatArray:
    """Clip to the output's range and round to the converter's steps."""
    low, high = sensor.output_min_V, sensor.output_max_V
    clipped = np.clip(voltage, low, high)
    if sensor.adc_bits == 0:
        return clipped
    step = sensor.quantisation_step
    codes = np.minimum(np.round((clipped - low) / step), 2.0**sensor.adc_bits - 1.0)
    return low + step * codes
