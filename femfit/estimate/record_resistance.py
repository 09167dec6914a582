"""The resistance that a record shows by itself, where its current stands still.

Over a stretch of the time T in which the current stands still the voltage balance is

    R = (integral of u dt - (lambda(end) - lambda(begin))) / integral of i dt,

in which the model's flux linkage lambda is a small correction, since next to nothing changes. What is wrong with the
force law, the body or the sensor of the distance does not enter. Gain and offset of the ammeter and of the driver's
voltage do: an ammeter that reads 3 % too little looks like a winding of 3 % more.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from femfit.core.numerics import BoolArray, FloatArray, IntArray
from femfit.core.text import amount, counted
from femfit.estimate.constants import BLOCK, FLOWS, FLUX_ERROR
from femfit.estimate.rests import still_stretches
from femfit.model.actuator_model import ActuatorModel


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
        change = 100.0 * (self.ohm / self.model_ohm - 1.0)
        beside, cause = f"the model's resistance of {self.circuit}", ""
        if self.contradicts:
            side, winding = ("larger", "warmer") if change > 0.0 else ("smaller", "colder")
            beside = f"{abs(change):.2g} % {side} than {beside}"
            cause = f": the winding is {winding}, or the ammeter or the driver's voltage is off"
        else:
            beside = f"as {beside}"
        interval = f"95 %: {self.low_ohm:.4g} to {self.high_ohm:.4g} ohm"
        stretches = f"{counted(self.stretches, 'stretch', 'stretches')}, {amount(self.time_s, 's', 2)} together"
        return f"Voltage over steady current is {self.ohm:.4g} ohm ({interval}, {stretches}), {beside}{cause}."


@dataclass(frozen=True)
class _Stretch:
    """Means over a stretch in which the current stands still."""

    volts: float  # Less what the flux linkage gained
    amperes: float
    duration_s: float
    deviation_V: float  # Of volts - R amperes, by the noise of the current


def steady_resistance(
    model: ActuatorModel,
    time_s: FloatArray,
    segment: IntArray,
    voltage: FloatArray,
    unsure: BoolArray,
    current: FloatArray,
    distance: FloatArray,
    noise_A: float,
    circuit: int = 0,
) -> SteadyResistance | None:
    """The resistance of a circuit; None where its current nowhere stands still, or its driver is no source of voltage.

    Parameters
    ----------
    time_s, segment, voltage, unsure, distance : array, shape (samples,)
        The voltage that the driver gave, and where that is not sure; distances in m, NaN where unknown.
    current : array, shape (samples, n)
        Of all circuits.
    noise_A : float
        Standard deviation of a sample of this circuit's current.
    """
    drawn, circuit_current = model.circuits[circuit], current[:, circuit]
    if drawn.drive.kind == "current" or not noise_A > 0.0 or not np.isfinite(circuit_current).any():
        return None
    box = model.validity
    middle = 0.5 * (box.distance_min_m + box.distance_max_m)
    place = np.clip(np.where(np.isfinite(distance), distance, middle), box.distance_min_m, box.distance_max_m)
    stretches = []
    for first, last, level in still_stretches(segment, circuit_current, noise_A):
        rows = slice(first, last + 1)
        complete = np.isfinite(current[rows]).all() and np.isfinite(voltage[rows]).all() and not unsure[rows].any()
        if complete and abs(level) >= FLOWS * np.nanmax(np.abs(circuit_current)):
            stretch = _stretch(model, time_s[rows], voltage[rows], current[rows], place[rows], noise_A, circuit)
            stretches.append(stretch)
    return _mean(drawn.name, drawn.resistance_ohm, stretches) if stretches else None


def _stretch(
    model: ActuatorModel,
    time_s: FloatArray,
    voltage: FloatArray,
    current: FloatArray,
    distance: FloatArray,
    noise_A: float,
    circuit: int,
) -> _Stretch:
    """From the middle of the first block to that of the last, whose means tell where the flux begins and ends."""
    drawn = model.circuits[circuit]
    blocks = slice(0, BLOCK), slice(len(time_s) - BLOCK, len(time_s))
    end_distances = np.array([distance[block].mean() for block in blocks])
    end_currents = np.array([current[block].mean(axis=0) for block in blocks])
    flux = model.magnetics.flux_linkage(end_distances, end_currents)
    linkage = flux[:, circuit] + drawn.inductance_H * end_currents[:, circuit]
    gained = float(np.diff(linkage)[0])
    inner = slice(BLOCK // 2, len(time_s) - BLOCK // 2)
    t = time_s[inner]
    duration = float(t[-1] - t[0])
    state = model.magnetics.state(end_distances[:1], end_currents[:1])
    inductance = float(state.inductance[0, circuit, circuit])
    of_flux = np.hypot(inductance * noise_A * (2.0 / BLOCK) ** 0.5, FLUX_ERROR * gained) / duration
    return _Stretch(
        volts=(float(voltage[inner][:-1] @ np.diff(t)) - gained) / duration,
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
