"""Columns of a record that contradict the model, a step that it cannot follow, and the voltage that a driver gave.

A passive winding turns what it takes up into heat and motion: the mean of U i is no less than that of R i^2 unless
something drives the body. Where it is clearly negative, voltage and current are counted opposite ways. Where it is
clearly less, and about the heat that there is with the two columns swapped, they are.

White noise makes readings scatter by no less than itself: noise that was declared larger is in another unit.

A driver gives what its supply can. With a freewheel diode the winding sees its drop while the driver is off and a
current flows, and nothing once it has stopped.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from femfit.core.errors import TableError
from femfit.core.numerics import BoolArray, FloatArray, IntArray
from femfit.core.results import Finding
from femfit.core.sweep_columns import circuit_currents, current_columns, voltage_columns
from femfit.core.text import amount, amount_range, counted
from femfit.estimate.constants import LEAST_DIFFERENCES
from femfit.estimate.record import bridged, converter_step, white_noise
from femfit.estimate.rests import Rests, Track, find_rests
from femfit.model.actuator_model import ActuatorModel
from femfit.model.with_effects import true_setting_of
from femfit.tables.checks import Expected, suspected_units
from femfit.tables.findings import finding
from femfit.tables.measurement import TimeSeries
from femfit.tables.units import LEAST_READINGS, column_unit

FLOWS, AGAINST = 0.1, 0.5
"""Conventional: parts of the largest command or current from which one flows, and of the heat in the winding that the
mean power must be negative by before its polarity is suspected, or less by before it is taken for the current: a body
that is driven from outside gives less back."""

SWAPPED = 3.0
"""Assumed: heat of the drawn resistance over the mean power from which columns are swapped; less is a resistance."""

LOUD = 1.5
"""Derived: times the standard deviation of all readings above which a declared noise is not theirs: that of a hundred
readings of white noise alone is uncertain by 7 %, and a slow noise may last as long as the record."""

SLOWEST_STEP, FASTEST_STEP = 100.0, 1e-6
"""Conventional: times of the model's slowest own time above which a step cannot be filtered, and of its fastest below
which rounding is all that a step changes."""

OFF = 3.0
"""Conventional: a current within so many standard deviations of zero has stopped."""

FALLING = 12
"""Conventional: samples before a current is lost in its noise, by whose slope it goes on to zero, so many at most."""


def suspect_settings(
    model: ActuatorModel, distance: FloatArray, current: FloatArray, names: Sequence[str]
) -> list[Finding]:
    """Find units and signs that would bring the distances, or the currents, into the model's validity domain.

    Parameters
    ----------
    distance, current : array
        In m and A; of several circuits all currents, shape (samples, n).
    names : sequence of str
        Columns of the currents.
    """
    box, columns = model.without_effects.validity, ("distance_m", *names)
    ends = (box.distance_min_m, box.distance_max_m), *box.current_limits_A.tolist()  # none of a current beside magnets
    rows = pd.DataFrame(np.column_stack([distance, current.reshape(len(current), -1)]), columns=columns)
    return suspected_units(rows, Expected(limits=dict(zip(columns, ends, strict=False))))


@dataclass(frozen=True, eq=False)
class CheckedRecord:
    """Where the body of a record was and rested, what its drivers gave, and what is said of it."""

    track: Track
    rests: Rests
    voltage_V: FloatArray  # NaN where missing; (samples, circuits)
    unsure: BoolArray  # Where a diode stops conducting in the noise of the current, at a moment that is estimated
    findings: tuple[Finding, ...]


def check_record(model: ActuatorModel, series: TimeSeries, added: BoolArray | None = None) -> CheckedRecord:
    """Check a record against a model: its columns, its rests and its commands.

    Parameters
    ----------
    added : array of bool, shape (samples,), or None
        Rows that were not written, over which the settings are interpolated.
    """
    rows, time, segment = series.rows, series.rows["time_s"].to_numpy(), series.rows["segment"].to_numpy()
    added = np.zeros(len(rows), dtype=bool) if added is None else added
    names = (*current_columns(model.current_names), "distance_m")
    settings = rows.reindex(columns=names).to_numpy(dtype=np.float64, copy=True)
    if not model.has_winding:
        settings[:, 0] = 0.0
    noises = [float(series.declared_noise.get(name, 0.0)) for name in names]
    for k, values in enumerate(settings.T):  # from neighbouring samples, or else from those that were written
        spreads = (white_noise(values[here], segment[here]) for here in (slice(None), ~added))
        noises[k] = noises[k] or next((spread for spread in spreads if np.isfinite(spread)), np.nan)
    distance, current = (bridged(true, added) for true in true_setting_of(model, settings[:, -1], settings[:, :-1]))
    track = Track(time, segment, distance, current, noises[-1], noises[:-1])
    rests = find_rests(model, track)
    volts = rows.reindex(columns=voltage_columns(model.circuit_names)).to_numpy(dtype=np.float64, copy=True)
    unsure, findings = np.zeros(volts.shape, dtype=bool), [*suspect_record(model, series), *rests.findings]
    for k, commands in enumerate(volts.T):
        volts[:, k], unsure[:, k], remarks = given_voltage(model, track, commands, k)
        findings += remarks
    return CheckedRecord(track, rests, volts, unsure, tuple(findings))


def suspect_record(model: ActuatorModel, series: TimeSeries) -> list[Finding]:
    """Find columns of a record whose unit, sign or polarity is another than the model's; each is named once."""
    rows, names = series.rows, circuit_currents(model.circuit_names)
    suspected = {finding.column for finding in series.findings if finding.code == "suspected-unit"}
    settings = rows.reindex(columns=("distance_m", *names)).to_numpy(dtype=np.float64)
    by_range = suspect_settings(model, settings[:, 0], settings[:, 1:], names)
    findings = [finding for finding in by_range if finding.column not in suspected]
    suspected |= {finding.column for finding in findings}
    for k, command in enumerate(voltage_columns(model.circuit_names)):
        polarity = _polarity(model, k, command, rows[command].to_numpy(), names[k], settings[:, 1 + k])
        if polarity is not None and not suspected & {command, names[k]}:
            findings.append(polarity)
    for name in series.declared_noise.keys() & rows.keys():
        noise, scatter, unit = series.declared_noise[name], float(rows[name].std()), column_unit(name)[1]
        loud = noise > LOUD * scatter > 0.0 and rows[name].count() >= LEAST_DIFFERENCES
        if loud and noise > LOUD * converter_step(rows[name].to_numpy()):  # one level may hide any noise
            facts = {"noise": amount(noise, unit), "scatter": amount(scatter, unit)}
            findings.append(finding("suspected-noise", column=name, **facts))
    return findings


def require_possible_step(model: ActuatorModel, step_s: float, source: str) -> None:
    """Refuse a step that is far from the times in which currents settle and the body moves.

    Raises
    ------
    TableError
        If the step is many times longer than both, or a millionth of the shorter one.
    """
    times = _own_times(model)
    if not times or SLOWEST_STEP * max(times) >= step_s >= FASTEST_STEP * min(times):
        return
    shown = amount_range(min(times), max(times), "s")
    ratio = step_s / max(times)
    # A sixth of the time is how finely such motions are usually recorded, to the nearest power of a thousand
    factor = 1000.0 ** abs(round(float(np.log10(60.0 * ratio)) / 3.0))
    kind = "long" if ratio > 1.0 else "short"
    raise TableError(
        f"The step of {source} is {amount(step_s, 's')}, where the model's currents settle and its body moves within "
        f"{shown}: the unit of time_s looks wrong, the times seem about {factor:,.0f} times too {kind}. Give it with "
        "--unit time_s=UNIT (s, ms, us)."
    )


def _polarity(
    model: ActuatorModel, circuit: int, command: str, volts: FloatArray, name: str, current: FloatArray
) -> Finding | None:
    """A command that its supply gives only the other way round, that takes power out of the winding or is a current."""
    fed, commands = model.circuits[circuit], volts[np.isfinite(volts)]
    low, high = fed.voltage_min_V, fed.voltage_max_V
    turned, most = np.sign(high + low), max(abs(low), abs(high))
    if low * high >= 0.0 and np.isfinite(most):
        beyond = turned * commands < -FLOWS * most
        if beyond.sum() >= LEAST_READINGS and not (turned * commands > FLOWS * most).any():
            supply = amount_range(low, high, "V")
            recorded = amount_range(float(commands.min()), float(commands.max()), "V")
            return finding("suspected-sign supply", column=command, supply=supply, recorded=recorded)
    mean = np.append(0.5 * (current[1:] + current[:-1]), np.nan)  # the command is held over the step
    here = np.isfinite(mean) & np.isfinite(volts)
    bounds = np.abs(model.validity.current_limits_A[circuit : circuit + 1])
    if here.sum() < LEAST_READINGS or not bounds.size:
        return None
    volts, mean = volts[here], mean[here]
    power, square, swapped = float(np.mean(volts * mean)), float(np.mean(mean**2)), float(np.mean(volts**2))
    if square < (FLOWS * bounds.max()) ** 2 and power**2 < AGAINST**2 * square * swapped:  # nor follows the voltage
        return None
    heat, swapped = square * fed.resistance_ohm, swapped * fed.resistance_ohm
    facts = {"heat": amount(heat, "W"), "swapped": amount(swapped, "W")}
    if power <= -AGAINST * heat:
        return finding("suspected-sign power", column=command, current=name, power=amount(-power, "W"), **facts)
    if heat > SWAPPED * power and abs(swapped - power) < AGAINST * power:
        return finding("suspected-columns", column=command, current=name, power=amount(power, "W"), **facts)
    return None


def _own_times(model: ActuatorModel) -> list[float]:
    """Shortest and longest L / R of the windings, and the time in which the largest force takes the body its way."""
    distance, current = model.validity.grid(5, 3)
    magnetic, motion, times = model.magnetics.state(distance, current), model.motion, []
    if model.circuits:
        inductance = magnetic.inductance + model.series_inductances_H
        settling = np.diagonal(inductance, axis1=-2, axis2=-1) / model.resistances_ohm
        times += [float(settling.min()), float(settling.max())]
    if motion is not None:
        most = float(np.abs(magnetic.force).max()) + motion.mass_kg * abs(motion.gravity_m_s2)
        way = model.validity.distance_max_m - model.validity.distance_min_m
        times.append(math.sqrt(2.0 * motion.mass_kg * way / most) if most > 0.0 else math.inf)
    return [time for time in times if 0.0 < time < math.inf]


def given_voltage(
    model: ActuatorModel, track: Track, voltage: FloatArray, circuit: int
) -> tuple[FloatArray, BoolArray, list[Finding]]:
    """The voltage at the winding: commands beyond the supply are clamped, as the driver does.

    Parameters
    ----------
    voltage : array, shape (samples,)
        Commands in V; NaN where missing.
    circuit : int
        The place of the circuit whose voltage it is.

    Returns
    -------
    tuple of (array, array of bool, list of Finding)
        The voltage; where a diode stops conducting at a moment that is estimated; and what is said of it.
    """
    fed, noise_A = model.circuits[circuit], track.noise_A[circuit]
    clamped = np.clip(voltage, fed.voltage_min_V, fed.voltage_max_V)
    beyond = (clamped != voltage) & np.isfinite(voltage)
    diode, unsure = fed.drive.diode_V, np.zeros(len(voltage), dtype=bool)
    if diode is not None:
        off, clear = voltage <= 0.0, OFF * noise_A if np.isfinite(noise_A) else 0.0
        flows, unsure = _conducts(track.current_A[:, circuit], track.segment, off, clear)
        voltage, clamped = (np.where(off, np.where(flows, -diode, 0.0), volts) for volts in (voltage, clamped))
        beyond &= ~off
    if not beyond.any():
        return voltage, unsure, []
    reach = amount_range(float(voltage[beyond].min()), float(voltage[beyond].max()), "V")
    of = f" to {fed.name}" if len(model.circuits) > 1 else ""
    commands = f"{counted(int(beyond.sum()), 'command')}{of} of {len(voltage)} ({reach})"
    limits = amount_range(fed.voltage_min_V, fed.voltage_max_V, "V")
    return clamped, unsure, [finding("clamped", commands=commands, limits=limits)]


def _conducts(current: FloatArray, segment: IntArray, off: BoolArray, clear: float) -> tuple[BoolArray, BoolArray]:
    """Where the freewheel diode carries a current, and about when it stops.

    It does where the current is clear of the noise, and on to the end to which the last slope leads.

    Without the last part the drop of the diode would be missing over the time that the current takes from the noise's
    size to nothing.
    """
    flows, unsure = current > clear, np.zeros(len(current), dtype=bool)
    ends = np.flatnonzero(flows[:-1] & ~flows[1:] & off[1:] & (np.diff(segment) == 0))
    for last in ends.tolist():
        first = max(last + 1 - FALLING, int(np.searchsorted(segment, segment[last])))
        if last + 1 - first < FALLING or not flows[first : last + 1].all():
            continue
        fitted = np.polyfit(np.arange(first - last, 1), current[first : last + 1], 1)
        slope, level = float(fitted[0]), float(fitted[1])
        more = min(math.ceil(-level / slope), FALLING) if slope < 0.0 < level else 0
        reach = slice(last + 1, last + 1 + more)
        flows[reach] = off[reach] & (segment[reach] == segment[last])
        unsure[last + 1 : last + 1 + 2 * more] = True
    return np.asarray(flows), unsure
