"""From a record to what a filter is fed with: sensors and their noise, inputs, readings, and what is said first."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from femfit.core.errors import TableError
from femfit.core.numerics import BoolArray, FloatArray, IntArray
from femfit.core.results import Finding
from femfit.core.sweep_columns import circuit_currents, voltage_columns
from femfit.core.text import amount, counted
from femfit.device.electrics import CurrentSensor, PositionSensor
from femfit.estimate.constants import BLOCK, STILL
from femfit.estimate.noise import operating_distance
from femfit.estimate.record import (
    converter_step,
    on_grid,
    sensor_readings,
    stretches_and_step,
    white_noise,
    with_distance,
)
from femfit.estimate.record_checks import check_record, require_possible_step
from femfit.model.actuator_model import ActuatorModel
from femfit.model.hall import OtherSensor
from femfit.model.sensors import Reading, reading_of, sensor_named, sensors_of
from femfit.tables.findings import finding
from femfit.tables.measurement import TimeSeries

STANDS_STILL = 1e-3
"""Numerical: random walk of a held body's distance in a sample, over the noise of its reading: Q is definite."""


@dataclass(frozen=True, eq=False)
class Prepared:
    """A record as a filter takes it."""

    model: ActuatorModel  # With the record's step as its sample time, and the record's sensors
    sensors: tuple[Reading, ...]  # That the filter reads
    time_s: FloatArray
    inputs: FloatArray  # Held from the sample before; (samples, circuits)
    readings: FloatArray  # NaN where missing; (samples, sensors)
    begins: IntArray  # Indices of the first samples of stretches without a gap, ascending from 0
    first: FloatArray  # First estimate of every stretch; (stretches, 2 + circuits)
    held: BoolArray  # Whether the body stands still, whatever the forces say; (samples,)
    recorded: dict[str, FloatArray]  # Every channel of the record, one entry a sample
    findings: tuple[Finding, ...]
    noise: dict[str, float]  # White noise of each sensor
    # To what distance in m and velocity in m/s a body counts as still; None where it nowhere is
    resting: tuple[float, float] | None

    @property
    def names(self) -> tuple[str, ...]:
        """Of the sensors."""
        return tuple(sensor.name for sensor in self.sensors)


def prepare(model: ActuatorModel, series: TimeSeries, sensors: Sequence[str] | None) -> Prepared:
    """Choose sensors, take the record's step, and set aside what no filter should believe."""
    commands = voltage_columns(model.circuit_names)
    model.require_circuits()
    # What was left out of the record, which may be what is missing
    left_out = " ".join(str(remark) for remark in series.findings if remark.code in {"unused-column", "stuck"})
    lacking = [name for name in commands if name not in series.given]
    if lacking:
        remedy = "" if "--column" in left_out else f", or say which column it is with --column HEADER={lacking[0]}"
        raise TableError(
            f"A record must hold the commanded voltage for a filter to follow it; {series.source} holds "
            f"{', '.join(series.given)}. Record {' and '.join(lacking)}{remedy}. {left_out}".rstrip()
        )
    series, added = on_grid(series)
    drawn, rows = tuple(sensors_of(model)), series.rows
    model = with_recorded_sensors(model, series)
    usable = recorded_sensors(model, series)
    # As asked for; else those of the drawing that were recorded, or what was where none of them is
    names = tuple(name for name in usable if name in drawn) or usable if sensors is None else tuple(sensors)
    chosen = tuple(reading_of(model, name) for name in names)
    unread = [name for name in names if name not in usable]
    if unread or not names:
        raise TableError(
            f"A filter needs the readings of its sensors ({', '.join(unread) or 'one at least'}); {series.source} "
            f"holds {', '.join(series.given)}, of which the model's sensors read "
            f"{', '.join(usable) or 'none'}. Name one of those with --sensors, or the column with --column. "
            f"{left_out}".rstrip()
        )
    time = rows["time_s"].to_numpy()
    begins, step = stretches_and_step(time, rows["segment"].to_numpy(), model.sample_time_s)
    require_possible_step(model, step, series.source)
    checked = check_record(model, with_distance(model, series), added)
    findings = [*series.findings, *checked.findings]
    if missing := int(np.isnan(checked.voltage_V).sum()):
        findings.append(finding("held-command", missing=missing))
    held = pd.DataFrame(checked.voltage_V).ffill().fillna(0.0).to_numpy()
    inputs = np.concatenate([held[:1], held[:-1]])
    inputs[begins] = held[begins]
    read = [sensor_readings(series, reading, begins, step) for reading in chosen]
    noises = [_noise(series, values, reading) for (values, _), reading in zip(read, chosen, strict=True)]
    findings += [remark for _, of_channel in [*read, *noises] for remark in of_channel]
    # An estimate that has not seen the distance may be off the stop; the model's stop is what takes it there
    placed_by_sensor = any(isinstance(sensor_named(model, name), PositionSensor) for name in names)
    rests, track, noise_m = checked.rests, checked.track, checked.track.noise_m
    held_rests = tuple(rest for rest in rests.rests if placed_by_sensor or rest.place == "held")
    # Where it begins: as recorded, in the model's domain; else at the far stop, or where the filter is tuned
    box, far = model.validity, model.require_motion().far_stop
    rest = operating_distance(model) if far is None else far.distance_m
    placed = np.clip(
        np.where(np.isfinite(track.distance_m), track.distance_m, rest), box.distance_min_m, box.distance_max_m
    )
    limits = box.current_limits_A[: len(commands)]
    fed = np.clip(np.nan_to_num(track.current_A[:, : len(commands)]), *limits.T)
    return Prepared(
        model=replace(model, sample_time_s=step),
        sensors=chosen,
        time_s=time,
        inputs=inputs,
        readings=np.stack([values for values, _ in read], axis=1),
        begins=begins,
        first=np.column_stack([placed, np.zeros(len(time)), fed])[begins],
        held=replace(rests, rests=held_rests).held,
        recorded={name: rows[name].to_numpy(copy=True) for name in series.given if name not in {"run", "time_s"}},
        findings=tuple(findings),
        noise={name: value for name, (value, _) in zip(names, noises, strict=True)},
        # A held body stays where it is; it may have become so fast before its leaving is seen
        resting=(STANDS_STILL * noise_m, STILL * noise_m / (BLOCK * step)) if rests.rests else None,
    )


def with_recorded_sensors(model: ActuatorModel, series: TimeSeries) -> ActuatorModel:
    """The model with a sensor for each recorded current or distance that none of its own reads."""
    drawn, circuits = sensors_of(model), model.circuit_names
    read = {reading_of(model, name).column for name in drawn}
    sensors: dict[str, OtherSensor] = {
        column: CurrentSensor(name=column.rpartition("_")[0], circuit=circuit)
        for column, circuit in zip(circuit_currents(circuits), circuits, strict=True)
    }
    sensors["distance_m"] = PositionSensor(name="distance", distances_m=(0.0, 1.0), readings=(0.0, 1.0), unit="m")
    wanted = {column: sensor for column, sensor in sensors.items() if column in series.given and column not in read}
    added = [sensor for sensor in wanted.values() if sensor.name not in drawn]
    return replace(model, other_sensors=(*model.other_sensors, *added)) if added else model


def recorded_sensors(model: ActuatorModel, series: TimeSeries, without: Sequence[str] = ()) -> tuple[str, ...]:
    """Names of the sensors that the record has readings of, those of some columns left out."""
    columns = {name: reading_of(model, name).column for name in sensors_of(model)}
    return tuple(name for name, column in columns.items() if column in series.given and column not in without)


def _noise(series: TimeSeries, column: FloatArray, reading: Reading) -> tuple[float, list[Finding]]:
    """Declared with the record, else the model's, else guessed from third differences, and no less than a rounding."""
    name = str(reading.column)
    if declared := float(series.declared_noise.get(name) or reading.white):
        return declared, []
    read = np.isfinite(column)  # where a sensor is read more slowly than the record, what is between is missing
    spread = white_noise(column[read], series.rows["segment"].to_numpy()[read], least=1)
    guess = float(np.fmax(spread, converter_step(column) / 12.0**0.5))
    if not guess > 0.0:
        few = f"the record has {counted(int(read.sum()), 'reading')} of it"
        fault = "its readings do not vary" if read.sum() > 2 else few
        raise TableError(f"The noise of {name} must be known; {fault}. Give --noise {name}=STANDARD DEVIATION.")
    return guess, [finding("guessed-noise", name=reading.name, guess=amount(guess, reading.unit), column=name)]
