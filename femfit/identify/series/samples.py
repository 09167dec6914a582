"""The samples of a time series at which a model can be evaluated, and what its command was between them.

A controller gives its command at a sample and holds it to the next, and changes it at most samples. A command that
mostly is what it was a sample before is switched, and its edges come anywhere between two samples. In a record slower
than the driver of the drawing one command of several may be seen: any change comes anywhere then, and the unseen
scatter as the seen ones do.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from femfit.core.errors import TableError
from femfit.core.numerics import BoolArray, FloatArray, robust_deviation
from femfit.core.results import Finding
from femfit.core.sweep_columns import current_columns, voltage_columns
from femfit.estimate.constants import SPIKE
from femfit.estimate.record import undelayed_readings
from femfit.estimate.record_checks import check_record
from femfit.estimate.rests import Rest
from femfit.identify.plausible import at_ends_of_range, nothing_in_domain, within_domain
from femfit.identify.series.constants import ANYWHERE, EVEN, ON_STOP
from femfit.identify.settings import currents_in, leading_current
from femfit.identify.words import finding, sentence
from femfit.model.actuator_model import ActuatorModel
from femfit.model.sensors import reading_of, sensors_of
from femfit.tables.measurement import TimeSeries
from femfit.tables.units import POSITION_IN_VOLTS


@dataclass(frozen=True, eq=False)
class Samples:
    """A time series as arrays of length N; usable where distance and current lie in the model's validity domain.

    A stretch is a part of a segment in which the body is free, stands still or touches; what is unbroken, one in which
    all samples are usable or none is.

    The body is ``free`` where nothing but the model's forces acts on it, and ``touches`` a stop where it neither is nor
    stands still: it comes, bounces or goes. Where it stands still its distance is the mean over the rest: a velocity of
    its sensor's noise would look like one that induces less voltage.
    """

    # With the record's columns, of several circuits ``current_A`` as that of the current that varied most; beside them
    # ``since_start_s`` of the run, ``stretch``, ``unbroken``, ``usable``, ``free``, ``touches``, the distance as it was
    # recorded at rest too, ``recorded_m``, and ``stop_m``, the drawn one of the stop that the body rests on, or NaN
    rows: pd.DataFrame
    currents: tuple[str, ...]  # Columns of the model's currents and commands, in its order
    commands: tuple[str, ...]
    findings: tuple[Finding, ...]

    def __getitem__(self, name: str) -> Any:
        """A column, shape (N,)."""
        return self.rows[name].to_numpy()

    def stacked(self, names: Sequence[str]) -> FloatArray:
        """Columns of shape (N, n), zero where unknown; of currents one of zero where there is no winding."""
        return np.nan_to_num(self.rows[[*names]].to_numpy(dtype=np.float64))


def take_samples(model: ActuatorModel, series: TimeSeries) -> Samples:
    """Take the samples that a model can explain: voltages as the clamp passes them, no Hall voltage at its limits."""
    currents, commands = tuple(current_columns(model.current_names)), tuple(voltage_columns(model.circuit_names))
    needed = (*currents, "distance_m") if model.has_winding else ("distance_m",)
    missing = [name for name in needed if name not in series.given]
    if missing:
        volts = any(reading_of(model, name).column == "position_V" for name in sensors_of(model))
        remedy = POSITION_IN_VOLTS if volts and "distance_m" in missing else ""
        raise TableError(sentence("refusals", "no_path", needed, series.source, missing, remedy))
    rows = series.rows.assign(**{name: np.nan for name in commands if name not in series.rows})
    if not model.has_winding:
        rows["current_A"] = 0.0
    distance, current = rows["distance_m"].to_numpy(), currents_in(model, rows)
    recorded = np.isfinite(distance) & np.isfinite(current).reshape(len(rows), -1).all(axis=1)
    usable = recorded & within_domain(model, distance, current)
    if not usable.any():
        raise TableError(nothing_in_domain(model, series.source, distance[recorded], current[recorded]))
    findings = list[Finding]()
    if outside := int((recorded & ~usable).sum()):
        facts: dict[str, Any] = {"samples": outside, "recorded": int(recorded.sum())}
        findings.append(finding("outside-domain", words="samples_outside_domain", **facts))
    checked = check_record(model, series)
    rests, track, smooth = checked.rests, checked.track, distance.copy()
    findings += checked.findings
    for rest in rests.rests:
        here = rest.first + np.flatnonzero(usable[rest.first : rest.last + 1])
        smooth[here] = distance[here].sum() / max(len(here), 1)  # all of it may be out of the domain
    for command, volts, unsure in zip(commands, checked.voltage_V.T, checked.unsure.T, strict=True):
        rows[command] = np.where(unsure, np.nan, volts)
    if model.sensor is not None and (ended := at_ends_of_range(model.sensor, rows["hall_V"].to_numpy())).any():
        findings.append(finding("clipped", "hall_V", words="clipped_samples", samples=int(ended.sum())))
        rows["hall_V"] = rows["hall_V"].mask(ended)
    for reading in (reading_of(model, name) for name in sensors_of(model)):
        if reading.column in ("force_N", "hall_V"):  # beside the settings; as late as the drawing says
            rows[reading.column], passed = undelayed_readings(replace(series, rows=rows), reading)
            findings += passed
    free, touches, new = ~rests.contact, rests.contact & ~rests.held, np.diff(track.segment) != 0
    rows = rows.assign(
        time_s=track.time_s,
        since_start_s=track.time_s
        - pd.Series(track.time_s).groupby(rows["run"].to_numpy()).transform("min").to_numpy(),
        segment=track.segment,
        stretch=np.cumsum(np.append(False, new | np.diff(free) | np.diff(touches))),
        unbroken=np.cumsum(np.append(False, new | np.diff(usable))),
        current_A=rows[leading_current(model, rows)],
        usable=usable,
        free=free,
        touches=touches,
        distance_m=smooth,
        recorded_m=distance,
        stop_m=_stops(model, rests.rests, len(rows)),
    )
    return Samples(rows, currents, commands, tuple(findings))


def _stops(model: ActuatorModel, rests: Sequence[Rest], samples: int) -> FloatArray:
    """Where the drawing has the stop that the body rests on, in the middle half of each rest.

    A body bounces when it comes and creeps when it goes, by less than the noise shows.
    """
    result, box = np.full(samples, np.nan), model.validity
    for rest in rests:
        stop = min(model.without_effects.require_motion().ends, key=lambda end: abs(end - rest.distance_m))
        if abs(stop - rest.distance_m) <= ON_STOP * (box.distance_max_m - box.distance_min_m):
            margin = (rest.last - rest.first) // 4
            result[rest.first + margin : rest.last + 1 - margin] = stop
    return result


def held_from(samples: Samples, k: int) -> BoolArray:
    """Whether the command of a circuit is known from each of usable samples to the next one."""
    step, inside = np.diff(samples["time_s"]), np.diff(samples["segment"]) == 0
    usual = np.median(step[inside]) if inside.any() else 0.0
    uneven = inside.any() and float(np.quantile(step[inside], 0.9)) > EVEN * usual
    held = np.append(inside & (uneven | (step < EVEN * usual)), False)
    return np.asarray(held & np.isfinite(samples[samples.commands[k]]))


def between_samples(
    samples: Samples, k: int, held: BoolArray, driver_step: float, taken: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Mean of a command from each sample to the next one, and its mean squared error.

    An edge by dU that is even between two samples leaves dU^2 / 3 of a command that is taken as held, as it is where
    the edge is at a sample, and dU^2 / 12 of one that runs straight. In a record slower than the driver the voltage
    that the winding takes says which of the two commands that are not switched are: by least squares it goes on by the
    part of dU for which the next command has acted, half of it where edges come anywhere and none at the samples.

    Parameters
    ----------
    held : array, shape (N,)
        From which samples the command is known to the next one.
    driver_step : float
        Time in s from one command of the driver to its next.
    taken : array, shape (N,)
        Mean voltage from each sample to the next one that the model makes of currents and motion.
    """
    volts = samples[samples.commands[k]]
    mean, rise = np.nan_to_num(volts), np.append(np.where(held[:-1], np.nan_to_num(np.diff(volts)), 0.0), 0.0)
    if not held.any():
        return mean, rise
    scatter = float(robust_deviation(rise[held]))
    slow = float(np.median(np.diff(samples["time_s"])[held[:-1]])) > EVEN * driver_step
    if slow and (scatter == 0.0 or rise @ (taken - mean) > ANYWHERE * (rise @ rise)):
        jump = np.where(np.abs(rise) > SPIKE * scatter, rise, 0.0)
        return mean + 0.5 * rise, jump**2 / 12.0 + 0.5 * scatter**2
    return mean, rise**2 / 3.0 if scatter == 0.0 else np.zeros_like(mean)
