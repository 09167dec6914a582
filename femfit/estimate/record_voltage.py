"""The voltage that a driver gave in a record, and the resistance that the record shows by itself.

Over a stretch of commands beyond the supply of the drawing, with the flux linkage lambda of the model,

    lambda(end) - lambda(begin) = sum of h (U - R i)

holds for the voltage U that the driver gave. The command as recorded and the command as the drawing's supply clamps it
are compared by what they leave of it beside the sensors' noise. With a freewheel diode the winding sees its drop while
the driver is off and a current flows, and nothing once it has stopped.

Over a stretch of the time T in which the current stands still the same balance is

    R = (integral of u dt - (lambda(end) - lambda(begin))) / integral of i dt,

in which the model's flux linkage lambda is a small correction, since next to nothing changes. What is wrong with the
force law, the body or the sensor of the distance does not enter. Gain and offset of the ammeter and of the driver's
voltage do: an ammeter that reads 3 % too little looks like a winding of 3 % more.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import t as student

from femfit.core.numerics import BoolArray, FloatArray, IntArray
from femfit.core.results import Finding
from femfit.core.text import amount, amount_range, counted
from femfit.estimate.constants import BLOCK, FALLING, FLOWS, FLUX_ERROR, NEARER, OFF
from femfit.estimate.rests import Track, still_stretches
from femfit.estimate.words import sentence
from femfit.model.actuator_model import ActuatorModel
from femfit.tables.findings import finding


@dataclass(frozen=True, eq=False)
class Given:
    """The voltage that the driver gave, and what is said of it."""

    voltage_V: FloatArray
    unsure: BoolArray  # Where a diode stops conducting in the noise of the current, at a moment that is estimated
    findings: tuple[Finding, ...]


def given_voltage(model: ActuatorModel, track: Track, voltage: FloatArray, circuit: int) -> Given:
    """The voltage at the winding: commands beyond the supply are believed where the current follows them, else clamped.

    Parameters
    ----------
    voltage : array, shape (samples,)
        Commands in V; NaN where missing.
    circuit : int
        The place of the circuit whose voltage it is.
    """
    fed, noise_A = model.circuits[circuit], track.noise_A[circuit]
    clamped = np.clip(voltage, fed.voltage_min_V, fed.voltage_max_V)
    with np.errstate(invalid="ignore"):
        beyond = clamped != voltage
    beyond &= np.isfinite(voltage)
    diode, unsure = fed.drive.diode_V, np.zeros(len(voltage), dtype=bool)
    if diode is not None:
        off, clear = voltage <= 0.0, OFF * noise_A if np.isfinite(noise_A) else 0.0
        flows, unsure = _conducts(track.current_A[:, circuit], track.segment, off, clear)
        voltage, clamped = (np.where(off, np.where(flows, -diode, 0.0), volts) for volts in (voltage, clamped))
        beyond &= ~off
    if not beyond.any():
        return Given(voltage, unsure, ())
    reach = amount_range(float(voltage[beyond].min()), float(voltage[beyond].max()), "V")
    if int(beyond.sum()) == 1:
        reach = amount(float(voltage[beyond][0]), "V")
    of = f" to {fed.name}" if len(model.circuits) > 1 else ""
    commands = f"{counted(int(beyond.sum()), 'command')}{of} of {len(voltage)} ({reach})"
    favour = _favour(model, track, (voltage, clamped), beyond, circuit)
    code = "beyond-supply" if favour > NEARER else "clamped" if favour < -NEARER else "clamped unknown"
    told = finding(code, commands=commands, limits=amount_range(fed.voltage_min_V, fed.voltage_max_V, "V"))
    return Given(voltage if favour > NEARER else clamped, unsure, (told,))


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
    model: ActuatorModel, track: Track, volts: tuple[FloatArray, FloatArray], beyond: BoolArray, circuit: int
) -> float:
    """Logarithm of the likelihood of the commands as recorded over that of the clamped ones; zero where unknown."""
    follows, noise = np.r_[np.diff(track.segment) == 0, False], (track.noise_A[circuit], track.noise_m)
    finite = np.isfinite(track.current_A).all(axis=1) & np.isfinite(track.distance_m)
    d, i = np.nan_to_num(track.distance_m), np.nan_to_num(track.current_A)
    finite &= model.validity.contains(d, i)
    usable = beyond & follows & finite & np.r_[finite[1:], False]
    if not usable.any() or not np.isfinite(noise).all():
        return 0.0
    first = np.flatnonzero(usable & ~np.r_[False, usable[:-1]])
    last = np.flatnonzero(usable & ~np.r_[usable[1:], False]) + 1
    magnetic = model.magnetics.state(d, i)
    series, resistance = model.circuits[circuit].inductance_H, model.circuits[circuit].resistance_ohm
    slope, inductance = magnetic.motional_constant[:, circuit], magnetic.inductance[:, circuit, circuit] + series
    own_current = i[:, circuit]
    flux = model.magnetics.flux_linkage(d, i)[:, circuit] + series * own_current
    step = np.r_[np.diff(track.time_s), 0.0]
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


@dataclass(frozen=True)
class SteadyResistance:
    """Voltage over current in the stretches in which the current stands still."""

    circuit: str
    ohm: float
    low_ohm: float  # 95 % interval
    high_ohm: float
    model_ohm: float
    stretches: int
    time_s: float  # That they last together

    @property
    def contradicts(self) -> bool:
        """Whether the model's resistance lies outside of the interval."""
        return not self.low_ohm <= self.model_ohm <= self.high_ohm

    def __str__(self) -> str:
        return sentence("observe", "resistance", self)


@dataclass(frozen=True)
class _Stretch:
    """Means over a stretch in which the current stands still."""

    volts: float  # Less what the flux linkage gained
    amperes: float
    duration_s: float
    deviation_V: float  # Of volts - R amperes, by the noise of the current


def steady_resistance(model: ActuatorModel, track: Track, given: Given, circuit: int = 0) -> SteadyResistance | None:
    """The resistance of a circuit; None where its current nowhere stands still, or its driver is no source of voltage.

    Parameters
    ----------
    given : Given
        The voltage that the driver gave.
    """
    drawn, circuit_current, noise_A = model.circuits[circuit], track.current_A[:, circuit], track.noise_A[circuit]
    if drawn.drive.kind == "current" or not noise_A > 0.0 or not np.isfinite(circuit_current).any():
        return None
    box = model.validity
    middle = 0.5 * (box.distance_min_m + box.distance_max_m)
    distance = np.where(np.isfinite(track.distance_m), track.distance_m, middle)
    placed = replace(track, distance_m=np.clip(distance, box.distance_min_m, box.distance_max_m))
    sure = np.isfinite(track.current_A).all(axis=1) & np.isfinite(given.voltage_V) & ~given.unsure
    least = FLOWS * np.nanmax(np.abs(circuit_current))
    stretches = [
        _stretch(model, placed, given.voltage_V, slice(first, last + 1), circuit)
        for first, last, level in still_stretches(track.segment, circuit_current, noise_A)
        if sure[first : last + 1].all() and abs(level) >= least
    ]
    return _mean(drawn.name, drawn.resistance_ohm, stretches) if stretches else None


def _stretch(model: ActuatorModel, track: Track, voltage: FloatArray, rows: slice, circuit: int) -> _Stretch:
    """From the middle of the first block to that of the last, whose means tell where the flux begins and ends."""
    drawn, noise_A = model.circuits[circuit], track.noise_A[circuit]
    time, distance, current = track.time_s[rows], track.distance_m[rows], track.current_A[rows]
    blocks = slice(0, BLOCK), slice(len(time) - BLOCK, len(time))
    end_distances = np.array([distance[block].mean() for block in blocks])
    end_currents = np.array([current[block].mean(axis=0) for block in blocks])
    flux = model.magnetics.flux_linkage(end_distances, end_currents)
    linkage = flux[:, circuit] + drawn.inductance_H * end_currents[:, circuit]
    gained = float(np.diff(linkage)[0])
    inner = slice(BLOCK // 2, len(time) - BLOCK // 2)
    t = time[inner]
    duration = float(t[-1] - t[0])
    inductance = float(model.magnetics.inductance(end_distances[:1], end_currents[:1])[0, circuit, circuit])
    of_flux = np.hypot(inductance * noise_A * (2.0 / BLOCK) ** 0.5, FLUX_ERROR * gained) / duration
    return _Stretch(
        volts=(float(voltage[rows][inner][:-1] @ np.diff(t)) - gained) / duration,
        amperes=float(np.trapezoid(current[inner, circuit], t)) / duration,
        duration_s=duration,
        deviation_V=float(np.hypot(drawn.resistance_ohm * noise_A / len(t) ** 0.5, of_flux)),
    )


def _mean(circuit: str, model_ohm: float, stretches: Sequence[_Stretch]) -> SteadyResistance:
    """Least squares over the stretches; the wider of the intervals by noise and by scatter."""
    u, i, durations, deviations = np.array(
        [(stretch.volts, stretch.amperes, stretch.duration_s, stretch.deviation_V) for stretch in stretches]
    ).T
    share = durations * i / (durations @ i**2)
    ohm = float(share @ u)
    half = 1.96 * float(np.sqrt(share**2 @ deviations**2))
    if len(u) > 1:
        scatter = float(np.sqrt(share**2 @ (u - ohm * i) ** 2 * len(u) / (len(u) - 1.0)))
        half = max(half, float(student.ppf(0.975, len(u) - 1)) * scatter)
    return SteadyResistance(circuit, ohm, ohm - half, ohm + half, model_ohm, len(u), float(durations.sum()))
