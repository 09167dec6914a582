"""The distance of a record that a position sensor gives in volts."""

from dataclasses import replace
from math import floor

import numpy as np

from femfit.core.amount import counted
from femfit.core.arrays import FloatArray, IntArray
from femfit.core.finding import Finding
from femfit.device.sensors import PositionSensor
from femfit.model.actuator_model import ActuatorModel
from femfit.model.sampling import WHOLE
from femfit.model.sensors import Reading, piece_slope, reading_of
from femfit.records.grid import stretches_and_step
from femfit.records.readings import at_ends, without_repeats
from femfit.tables.measurement import TimeSeries


def with_distance(model: ActuatorModel, series: TimeSeries) -> TimeSeries:
    """The record with ``distance_m`` where it has none and a position sensor of the model tells it; its noise too."""
    if "distance_m" in series.given:
        return series
    for sensor in model.other_sensors:
        column = reading_of(model, sensor.name).column
        if not isinstance(sensor, PositionSensor) or column not in series.given:
            continue
        distance, passed = _known_distance(sensor, series, reading_of(model, sensor.name))
        slope = np.abs(piece_slope(sensor, distance[np.isfinite(distance)]))
        declared, noise = series.declared_noise.get(str(column)), dict(series.declared_noise)
        if declared and len(slope):
            noise["distance_m"] = declared / float(np.median(slope))
        text = f"distance_m is worked out from {column} by the characteristic of sensor {sensor.name}."
        findings = [Finding("distance", "info", text, column="distance_m"), *passed]
        return replace(
            series,
            rows=series.rows.assign(distance_m=distance),
            given=(*series.given, "distance_m"),
            declared_noise=noise,
            findings=(*series.findings, *findings),
        )
    return series


def _known_distance(sensor: PositionSensor, series: TimeSeries, reading: Reading) -> tuple[FloatArray, list[Finding]]:
    """Distances in m when they were, NaN where none is known: at the ends of the range, and between slow readings.

    A delay that is no whole number of samples is taken back by a line between two; between slow readings there is none,
    and the nearest sample takes its place.
    """
    time, segment = series.rows["time_s"].to_numpy(), series.rows["segment"].to_numpy()
    begins, step = stretches_and_step(time, segment)
    read, passed = without_repeats(series.rows[str(reading.column)].to_numpy(copy=True), begins, reading, step)
    clipped, _ = at_ends(read, reading)
    if clipped.any():
        text = (
            f"{counted(int(clipped.sum()), 'reading')} of {len(read)} of sensor {sensor.name} stand at an end of its "
        )
        passed.append(Finding("clipped", "warning", f"{text}range; they tell no distance.", column="distance_m"))
    distance, late = distance_of(sensor, np.where(clipped, np.nan, read)), reading.delay_s / step
    slow = reading.sample_time_s is not None and reading.sample_time_s > 1.5 * step
    if slow or abs(late - round(late)) < WHOLE:
        return _later(distance, segment, round(late)), passed
    fraction, samples = late - floor(late), floor(late)
    early, later = (_later(distance, segment, shift) for shift in (samples, samples + 1))
    return (1.0 - fraction) * early + fraction * later, passed


def _later(values: FloatArray, segment: IntArray, samples: int) -> FloatArray:
    """The values so many samples later within their segments, NaN beyond the last."""
    result = np.full(len(values), np.nan)
    here = np.arange(max(0, len(values) - samples))
    same = segment[here] == segment[here + samples]
    result[here[same]] = values[here + samples][same]
    return result


def distance_of(sensor: PositionSensor, readings: FloatArray) -> FloatArray:
    """Distances in m that give these readings; beyond the characteristic its last pieces go on."""
    places, read = np.asarray(sensor.distances_m), np.asarray(sensor.readings)
    order = np.argsort(read)
    result = np.interp(readings, read[order], places[order])
    for end in (0, -1):  # np.interp stays at the ends
        beyond = (readings - read[end]) * np.sign(read[-1] - read[0]) * (1 if end else -1) > 0.0
        slope = float(piece_slope(sensor, places[end : end + 1 or None])[0])
        result = np.where(beyond, places[end] + (readings - read[end]) / slope, result)
    return np.asarray(result)
