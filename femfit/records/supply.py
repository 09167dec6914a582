"""Commands beyond the supply of the drawing: whether the recorded current followed them.

Over a stretch of such commands, with the flux linkage lambda of the model,

    lambda(end) - lambda(begin) = sum of h (U - R i)

holds for the voltage U that the driver gave. The command as recorded and the command as the drawing's supply clamps it
are compared by what they leave of it beside the sensors' noise. With a freewheel diode the winding sees its drop while
the driver is off and a current flows, and nothing once it has stopped.
"""

import math
from dataclasses import dataclass

import numpy as np

from femfit.core.amount import amount, amount_range, counted
from femfit.core.arrays import BoolArray, FloatArray, IntArray
from femfit.core.finding import Finding
from femfit.model.actuator_model import ActuatorModel
from femfit.records.constants import FALLING, NEARER, OFF


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
    time_s, segment, voltage, current, distance : array, shape (samples,)
        In s, V, A and m; NaN where missing. Of several circuits all currents, shape (samples, n).
    noise : (float, float)
        Standard deviation of a sample of the circuit's current in A and of the distance in m; NaN where unknown.
    circuit : int
        The place of the circuit whose voltage it is.
    """
    fed, own_current = model.circuits[circuit], current if current.ndim == 1 else current[:, circuit]
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
    finite = np.isfinite(current).reshape(len(time), -1).all(axis=1) & np.isfinite(distance)
    finite &= model.validity.contains(np.nan_to_num(distance), np.nan_to_num(current))
    usable = beyond & follows & finite & np.r_[finite[1:], False]
    if not usable.any() or not np.isfinite(noise).all():
        return 0.0
    first = np.flatnonzero(usable & ~np.r_[False, usable[:-1]])
    last = np.flatnonzero(usable & ~np.r_[usable[1:], False]) + 1
    d, i = np.nan_to_num(distance), np.nan_to_num(current)
    magnetic = model.magnetics.state_of_circuits(d, i.reshape(len(time), -1))
    series, resistance = model.circuits[circuit].inductance_H, model.circuits[circuit].resistance_ohm
    slope, inductance = magnetic.motional_constant[:, circuit], magnetic.inductance[:, circuit, circuit] + series
    own_current = i.reshape(len(time), -1)[:, circuit]
    flux = model.magnetics.flux_linkage(d, i).reshape(len(time), -1)[:, circuit] + series * own_current
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
