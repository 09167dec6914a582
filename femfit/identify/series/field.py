"""The model without effects at every sample of a record, and the noise that each sensor shows beside it."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.identify.series.noise import SensorNoise, converter_step, white_noise
from femfit.identify.series.samples import Samples
from femfit.model.actuator_model import ActuatorModel


@dataclass(frozen=True, eq=False)
class SampleField:
    """Magnetics at the samples, each array of length N and zero where they cannot be used.

    Parameters
    ----------
    force, force_d, force_i : array
        F and its derivatives in distance and current; -force_i is the flux linkage's derivative in distance.
    hall, hall_d, hall_i : array
        Output of the Hall element in V and its derivatives; zeros without one.
    """

    force: FloatArray
    force_d: FloatArray
    force_i: FloatArray
    flux: FloatArray
    inductance: FloatArray
    hall: FloatArray
    hall_d: FloatArray
    hall_i: FloatArray


def sample_field(base: ActuatorModel, samples: Samples) -> SampleField:
    """Evaluate a model at the samples of a record."""
    here = samples.usable
    d, i = samples.columns["distance_m"][here], samples.columns["current_A"][here]

    def everywhere(values: FloatArray) -> FloatArray:
        result = np.zeros(len(here))
        result[here] = values
        return result

    d_w, dd_w, di_w, i_w, ii_w = base.magnetics.coenergy_derivatives(d, i, ((1, 0), (2, 0), (1, 1), (0, 1), (0, 2)))
    hall = [np.zeros_like(d)] * 3
    if base.sensor is not None:
        hall = [base.sensor.sensitivity_V_per_T * part for part in base.sensor.field.derivatives(d, i)]
        hall[0] = hall[0] + base.sensor.quiescent_V
    return SampleField(*(everywhere(values) for values in (-d_w, -dd_w, -di_w, i_w, ii_w, *hall)))


def sensor_noise(
    base: ActuatorModel, samples: Samples, field: SampleField, declared: Mapping[str, float]
) -> dict[str, SensorNoise]:
    """Noise of every sensor.

    Returns
    -------
    dict of str to SensorNoise
        White noise as declared, else from third differences of neighbours beside what the model says of them (of the
        current: what the driving voltage makes of it), at least the converter's step over the square root of twelve.
    """
    known = np.where(samples.usable, 0.0, np.nan)
    explained = {
        "distance_m": known,
        "current_A": known + _driven(base, samples, field),
        "hall_V": known + field.hall,
        "force_N": known + field.force,
    }
    result = {}
    for name, model in explained.items():
        values = samples.columns[name]
        step = converter_step(values)
        seen = max(white_noise(values - model, samples.segment), step / np.sqrt(12.0))
        result[name] = SensorNoise(float(declared.get(name, seen)), step, values)
    return result


def _driven(base: ActuatorModel, samples: Samples, field: SampleField) -> FloatArray:
    """The current that commanded voltage and motion give, up to what is smooth; zeros without circuit or voltage."""
    volts, distance = samples.columns["voltage_V"], samples.columns["distance_m"]
    if base.circuit is None or not np.isfinite(volts).any():
        return np.zeros_like(volts)
    step = np.diff(samples.time, prepend=samples.time[:1])
    inductance = np.where(field.inductance > 0.0, field.inductance, np.inf)
    held = np.append(volts[:1], volts[:-1])
    motional = field.force_i * np.diff(distance, prepend=distance[:1])
    drop = base.circuit.resistance_ohm * samples.columns["current_A"]
    change = np.where(samples.usable, ((held - drop) * step + motional) / inductance, 0.0)
    return np.cumsum(np.nan_to_num(change))
