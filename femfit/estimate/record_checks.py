"""Whole columns of a record that contradict the model: units and signs of the settings, polarity, and the time's unit.

A passive winding turns what it takes up into heat and motion: the mean of U i is no less than that of R i^2 unless
something drives the body. Where it is clearly negative, voltage and current are counted opposite ways.

Commands beyond the supply of the drawing: whether the recorded current followed them.

Over a stretch of such commands, with the flux linkage lambda of the model,

    lambda(end) - lambda(begin) = sum of h (U - R i)

holds for the voltage U that the driver gave. The command as recorded and the command as the drawing's supply clamps it
are compared by what they leave of it beside the sensors' noise. With a freewheel diode the winding sees its drop while
the driver is off and a current flows, and nothing once it has stopped.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from femfit.core.errors import TableError
from femfit.core.numerics import BoolArray, FloatArray, IntArray
from femfit.core.results import Finding
from femfit.core.sweep_columns import circuit_currents, voltage_columns
from femfit.core.text import amount, amount_range, counted
from femfit.estimate.constants import AGAINST, FALLING, FASTEST_STEP, FLOWS, NEARER, OFF, SLOWEST_STEP
from femfit.model.actuator_model import ActuatorModel
from femfit.tables.measurement import TimeSeries
from femfit.tables.units import LEAST_READINGS, suspected_by_range


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
    box = model.without_effects.validity
    columns = current.reshape(len(current), -1).T
    limits = zip(names, columns, box.current_limits_A.tolist(), strict=False)  # magnets alone have no current
    suspicions = [suspected_by_range("distance_m", distance, box.distance_min_m, box.distance_max_m)]
    suspicions += [suspected_by_range(name, values, low, high) for name, values, (low, high) in limits]
    return [suspicion for suspicion in suspicions if suspicion is not None]


def suspect_record(model: ActuatorModel, series: TimeSeries) -> list[Finding]:
    """Find columns of a record whose unit, sign or polarity is another than the model's; each is named once."""
    rows, names = series.rows, circuit_currents(model.circuit_names)
    suspected = {finding.column for finding in series.findings if finding.code == "suspected-unit"}
    empty = np.full(len(rows), np.nan)
    distance = rows["distance_m"].to_numpy() if "distance_m" in series.given else empty
    columns = [rows[name].to_numpy() if name in series.given else empty for name in names]
    currents = np.stack(columns, axis=1) if columns else np.zeros((len(rows), 0))
    findings = [
        finding for finding in suspect_settings(model, distance, currents, names) if finding.column not in suspected
    ]
    suspected |= {finding.column for finding in findings}
    for k, command in enumerate(voltage_columns(model.circuit_names)):
        polarity = _polarity(model, k, command, rows[command].to_numpy(), columns[k])
        if polarity is not None and not suspected & {command, names[k]}:
            findings.append(polarity)
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
    model: ActuatorModel, circuit: int, command: str, volts: FloatArray, current: FloatArray
) -> Finding | None:
    """A command that its supply gives only the other way round, or that takes power out of the winding."""
    fed, commands = model.circuits[circuit], volts[np.isfinite(volts)]
    low, high = fed.voltage_min_V, fed.voltage_max_V
    turned, most = np.sign(high + low), max(abs(low), abs(high))
    if low * high >= 0.0 and np.isfinite(most):
        beyond = turned * commands < -FLOWS * most
        if beyond.sum() >= LEAST_READINGS and not (turned * commands > FLOWS * most).any():
            supply = amount_range(low, high, "V")
            recorded = amount_range(float(commands.min()), float(commands.max()), "V")
            why = f"the supply gives {supply}, and all commands are {recorded}"
            return _other_polarity(command, f"{command} seems to be of the other sign: {why}.", "Convert the column.")
    mean = np.append(0.5 * (current[1:] + current[:-1]), np.nan)  # the command is held over the step
    here = np.isfinite(mean) & np.isfinite(volts)
    bounds = np.abs(model.validity.current_limits_A[circuit : circuit + 1])
    if here.sum() < LEAST_READINGS or not bounds.size or np.sqrt(np.mean(mean[here] ** 2)) < FLOWS * bounds.max():
        return None
    power, heat = float(np.mean(volts[here] * mean[here])), float(np.mean(mean[here] ** 2)) * fed.resistance_ohm
    if power > -AGAINST * heat:
        return None
    name = circuit_currents(model.circuit_names)[circuit]
    text = (
        f"{command} and {name} seem to count opposite ways: on average the winding would give {amount(-power, 'W')} "
        f"to its driver, while its resistance takes {amount(heat, 'W')}."
    )
    return _other_polarity(command, text, "Convert one of the two columns.")


def _other_polarity(command: str, text: str, remedy: str) -> Finding:
    return Finding("suspected-sign", "warning", text, remedy, column=command)


def _own_times(model: ActuatorModel) -> tuple[float, ...]:
    """Shortest and longest L / R of the windings, and the time in which the largest force takes the body its way."""
    distance, current = model.validity.grid(5, 3)
    magnetic = model.magnetics.state(distance, current)
    times: list[float] = []
    if model.circuits:
        inductance = magnetic.inductance + model.series_inductances_H
        settling = np.diagonal(inductance, axis1=-2, axis2=-1) / model.resistances_ohm
        times += [float(settling.min()), float(settling.max())]
    motion = model.motion
    if motion is not None:
        box, forces = model.validity, np.abs(magnetic.force)
        most = float(forces.max()) + motion.mass_kg * abs(motion.gravity_m_s2)
        if most > 0.0:
            times.append(float(np.sqrt(2.0 * motion.mass_kg * (box.distance_max_m - box.distance_min_m) / most)))
    return tuple(time for time in times if time > 0.0 and np.isfinite(time))


@dataclass(frozen=True, eq=False)
class Given:
    """The voltage that the driver gave, and what is said of it."""

    voltage_V: FloatArray
    unsure: BoolArray  # Where a diode stops conducting in the noise of the current, at a moment that is estimated
    findings: tuple[Finding, ...]


def given_voltage(
    model: ActuatorModel,
    time_s: FloatArray,
    segment: IntArray,
    voltage: FloatArray,
    current: FloatArray,
    distance: FloatArray,
    noise: tuple[float, float],
    circuit: int = 0,
) -> Given:
    """The voltage at the winding: commands beyond the supply are believed where the current follows them, else clamped.

    Parameters
    ----------
    time_s, segment, voltage, distance : array, shape (samples,)
        In s, V and m; NaN where missing.
    current : array, shape (samples, n)
        In A; NaN where missing.
    noise : (float, float)
        Standard deviation of a sample of the circuit's current in A and of the distance in m; NaN where unknown.
    circuit : int
        The place of the circuit whose voltage it is.
    """
    fed, own_current = model.circuits[circuit], current[:, circuit]
    clamped = np.clip(voltage, fed.voltage_min_V, fed.voltage_max_V)
    with np.errstate(invalid="ignore"):
        beyond = clamped != voltage
    beyond &= np.isfinite(voltage)
    diode, unsure = fed.drive.diode_V, np.zeros(len(voltage), dtype=bool)
    if diode is not None:
        off = voltage <= 0.0
        flows, unsure = _conducts(own_current, segment, off, OFF * noise[0] if np.isfinite(noise[0]) else 0.0)
        voltage, clamped = (np.where(off, np.where(flows, -diode, 0.0), volts) for volts in (voltage, clamped))
        beyond &= ~off
    if not beyond.any():
        return Given(voltage, unsure, ())
    limits = amount_range(fed.voltage_min_V, fed.voltage_max_V, "V")
    reach = amount_range(float(voltage[beyond].min()), float(voltage[beyond].max()), "V")
    if int(beyond.sum()) == 1:
        reach = amount(float(voltage[beyond][0]), "V")
    of = f" to {fed.name}" if len(model.circuits) > 1 else ""
    head = f"{counted(int(beyond.sum()), 'command')}{of} of {len(voltage)} ({reach}) lie beyond the supply's {limits}"
    favour = _favour(model, time_s, segment, (voltage, clamped), current, distance, beyond, noise, circuit)
    if favour > NEARER:
        text = f"{head}, and the current follows them: the driver gave them, and they were believed."
        return Given(voltage, unsure, (Finding("beyond-supply", "warning", text, "Change [supply] in the drawing."),))
    why = "the current follows the clamp" if favour < -NEARER else "the record cannot tell whether the driver gave them"
    text = f"{head}; {why}, and they were taken as clamped."
    remedy = "" if favour < -NEARER else "If the driver can do more, change [supply] in the drawing."
    return Given(clamped, unsure, (Finding("clamped", "warning", text, remedy),))


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


def _favour(
    model: ActuatorModel,
    time: FloatArray,
    segment: IntArray,
    volts: tuple[FloatArray, FloatArray],
    current: FloatArray,
    distance: FloatArray,
    beyond: BoolArray,
    noise: tuple[float, float],
    circuit: int,
) -> float:
    """Logarithm of the likelihood of the commands as recorded over that of the clamped ones; zero where unknown."""
    follows = np.zeros(len(time), dtype=bool)
    follows[:-1] = np.diff(segment) == 0
    finite = np.isfinite(current).all(axis=1) & np.isfinite(distance)
    finite &= model.validity.contains(np.nan_to_num(distance), np.nan_to_num(current))
    usable = beyond & follows & finite & np.r_[finite[1:], False]
    if not usable.any() or not np.isfinite(noise).all():
        return 0.0
    first = np.flatnonzero(usable & ~np.r_[False, usable[:-1]])
    last = np.flatnonzero(usable & ~np.r_[usable[1:], False]) + 1
    d, i = np.nan_to_num(distance), np.nan_to_num(current)
    magnetic = model.magnetics.state(d, i)
    series, resistance = model.circuits[circuit].inductance_H, model.circuits[circuit].resistance_ohm
    slope, inductance = magnetic.motional_constant[:, circuit], magnetic.inductance[:, circuit, circuit] + series
    own_current = i[:, circuit]
    flux = model.magnetics.flux_linkage(d, i)[:, circuit] + series * own_current
    step = np.r_[np.diff(time), 0.0]
    drop = resistance * step * 0.5 * (own_current + np.r_[own_current[1:], 0.0])
    gained = flux[last] - flux[first]
    total = np.r_[0.0, np.cumsum(np.where(usable, drop, 0.0))]
    residuals = []
    for command in volts:
        supplied = np.r_[0.0, np.cumsum(np.where(usable, step * np.nan_to_num(command), 0.0))]
        residuals.append(gained + (total[last] - total[first]) - (supplied[last] - supplied[first]))
    spread = 2.0 * (inductance[first] * noise[0]) ** 2 + 2.0 * (slope[first] * noise[1]) ** 2
    spread += (last - first) * (resistance * np.median(step[usable]) * noise[0]) ** 2
    recorded, clamped = (float(np.sum(residual**2 / spread)) for residual in residuals)
    return 0.5 * (clamped - recorded)
