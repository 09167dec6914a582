"""Impedances of a bench table: an instrument's errors of resistance and reactance go with the magnitude |Z|.

Readings, predictions and slopes are multiplied by a magnitude that is usual over |Z| of each reading, so that a channel
has one noise: by the winding's resistance, and for an inductance by its own over |Z| / w.
"""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from femfit.core.amount import amount, counted
from femfit.core.arrays import FloatArray
from femfit.core.finding import Finding
from femfit.core.sweep_columns import resistance_column
from femfit.effects.conditions import Conditions
from femfit.identify.constants import FREQUENCY_SLACK, LEAST_LINKED, OF_THREE
from femfit.identify.readings.eddy_bias import AwayFromBias
from femfit.model.actuator_model import ActuatorModel
from femfit.model.impedance import SHORTED
from femfit.model.readings import predict_readings
from femfit.tables.circuit_columns import parts_of
from femfit.tables.impedance import SERIES
from femfit.tables.measurement import CHANNEL_WORDS, IMPEDANCE_SHARE


@dataclass(frozen=True, eq=False)
class Weighing:
    """How readings of each channel are weighed; empty where they are no impedances."""

    weight: Mapping[str, FloatArray] = field(default_factory=dict)  # Of every row, shape (N,), by channel
    magnitude: Mapping[str, float] = field(default_factory=dict)  # At which a channel's readings are given, in its unit
    noise: Mapping[str, float] = field(default_factory=dict)  # Declared as a share of |Z|
    tolerance: Mapping[str, FloatArray] = field(default_factory=dict)  # Of the model's eddy currents, of every row
    findings: tuple[Finding, ...] = ()


def weighed_by_magnitude(
    model: ActuatorModel,
    distance: FloatArray,
    current: FloatArray,
    conditions: Conditions,
    channels: Collection[str],
    declared: Mapping[str, float],
    away: AwayFromBias,
) -> Weighing:
    """The weights of impedances, by the model's own magnitude; of a channel with a noise in its unit they are 1."""
    names = [name for name in channels if parts_of(name)[0] in SERIES and name not in declared]
    nominal, w = conditions.nominal, 2.0 * np.pi * np.asarray(conditions.frequency_Hz)
    if not names or not np.isfinite(w).all():
        return Weighing()
    magnitude = _magnitudes(model, distance, current, conditions)
    largest = np.max(list(magnitude.values()), axis=0)
    size, most, turned = {}, {}, {}
    induced = np.minimum(largest, w * away.of_circuits)  # eddy currents make it no larger
    for name, z in magnitude.items():
        read = np.maximum(z, LEAST_LINKED * largest)
        off = largest * (OF_THREE if name.endswith(SHORTED) else 1.0)
        for channel, scale in ((resistance_column(name), 1.0), (name, w)):
            size[channel], most[channel] = read / scale, off / scale
            turned[channel] = away.inductance * induced / scale
    usual = {name: float(getattr(nominal, parts_of(name)[0])) for name in names}
    share, own = declared.get(IMPEDANCE_SHARE), _own_share(model)
    quantities = dict.fromkeys(parts_of(name)[0] for name in names)
    said = " and ".join(f"{amount(float(getattr(nominal, of)), of)} for the {CHANNEL_WORDS[of]}" for of in quantities)
    text = f"An instrument's errors of an impedance go with its magnitude |Z|. Errors in ohm and henry hold for {said}."
    return Weighing(
        {name: usual[name] / size[name] for name in names},
        usual,
        noise={name: share * usual[name] for name in names} if share else {},
        # The eddy currents' misfit is a share of the largest of all impedances
        tolerance={name: np.hypot(own * most[name], turned[name]) for name in names},
        findings=(Finding("weighed", "info", text), *_beyond_the_model(model, np.asarray(conditions.frequency_Hz))),
    )


def _magnitudes(
    model: ActuatorModel, distance: FloatArray, current: FloatArray, conditions: Conditions
) -> dict[str, FloatArray]:
    """|Z| of every row in ohm, by the column of its inductance."""
    w = 2.0 * np.pi * np.asarray(conditions.frequency_Hz)
    read = predict_readings(model, distance, current, conditions, channels=SERIES)
    return {
        name: np.hypot(read.get(resistance_column(name), 0.0), w * values)
        for name, values in read.items()
        if parts_of(name)[0] == "inductance_H"
    }


def _beyond_the_model(model: ActuatorModel, frequency: FloatArray) -> Iterator[Finding]:
    """A warning where the model's eddy currents were not held against the field."""
    error = model.eddy.error if model.eddy is not None else None
    count = 0 if error is None else int((frequency > (1.0 + FREQUENCY_SLACK) * error.frequency_max_Hz).sum())
    if error is not None and count:
        text = (
            f"{counted(count, 'reading lies', 'readings lie')} above {amount(error.frequency_max_Hz, 'frequency_Hz')}, "
            f"up to which the model's eddy currents were held against the field; they go up to "
            f"{amount(float(frequency.max()), 'frequency_Hz')}."
        )
        remedy = "Check the column's unit, leave them out, or sweep and fit with higher [solver] frequency_Hz."
        yield Finding("frequency-range", "warning", text, remedy, size=float(count), column="frequency_Hz")


def _own_share(model: ActuatorModel) -> float:
    """Standard misfit of the model's eddy currents to their field, over |Z|: of errors that are evenly spread."""
    error = model.eddy.error if model.eddy is not None else None
    return (error.impedance or 0.0) / np.sqrt(3.0) if error is not None else 0.0
