"""The resistance that a record shows by itself, where its current stands still.

Over a stretch of the time T in which the current stands still the voltage balance is

    R = (integral of u dt - (lambda(end) - lambda(begin))) / integral of i dt,

in which the model's flux linkage lambda is a small correction, since next to nothing changes. What is wrong with the
force law, the body or the sensor of the distance does not enter.
"""

from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from femfit.core.amount import amount, counted
from femfit.core.arrays import BoolArray, FloatArray, IntArray
from femfit.model.actuator_model import ActuatorModel
from femfit.records.constants import BLOCK, FLOWS, FLUX_ERROR
from femfit.records.rests import still_stretches


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
        beside = (
            f"{abs(change):.2g} % {'larger' if change > 0.0 else 'smaller'} than the model's {self.model_ohm:.4g} ohm"
        )
        if not self.contradicts:
            beside = f"as the model's {self.model_ohm:.4g} ohm"
        return (
            f"The resistance of {self.circuit} is {beside}: voltage over current is {self.ohm:.4g} ohm (95 %: "
            f"{self.low_ohm:.4g} to {self.high_ohm:.4g} ohm) in {counted(self.stretches, 'stretch', 'stretches')} of "
            f"steady current, {amount(self.time_s, 's', 2)} together."
        )


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
    fed, own = model.circuits[circuit], current[:, circuit]
    if fed.drive.kind == "current" or not noise_A > 0.0 or not np.isfinite(own).any():
        return None
    box = model.validity
    middle = 0.5 * (box.distance_min_m + box.distance_max_m)
    place = np.clip(np.where(np.isfinite(distance), distance, middle), box.distance_min_m, box.distance_max_m)
    volts, amperes, lasts, spread = [], [], [], []
    for first, last, level in still_stretches(segment, own, noise_A):
        rows = slice(first, last + 1)
        known = np.isfinite(current[rows]).all() and np.isfinite(voltage[rows]).all() and not unsure[rows].any()
        if not known or abs(level) < FLOWS * np.nanmax(np.abs(own)):
            continue
        # From the middle of the first block to that of the last, whose means tell where the flux begins and ends
        begin, end = first + BLOCK // 2, last - BLOCK // 2
        outer = slice(first, first + BLOCK), slice(last + 1 - BLOCK, last + 1)
        at = np.array([place[one].mean() for one in outer])
        flows = np.array([current[one].mean(axis=0) for one in outer])
        flux = model.magnetics.flux_linkage(at, flows[:, 0] if flows.shape[1] == 1 else flows).reshape(2, -1)[
            :, circuit
        ]
        gained = float(np.diff(flux + fed.inductance_H * flows[:, circuit])[0])
        t = time_s[begin : end + 1]
        length = float(t[-1] - t[0])
        volts.append((float(voltage[begin:end] @ np.diff(t)) - gained) / length)
        amperes.append(float(np.trapezoid(own[begin : end + 1], t)) / length)
        lasts.append(length)
        inductance = float(model.magnetics.state_of_circuits(at[:1], flows[:1]).inductance[0, circuit, circuit])
        of_flux = np.hypot(inductance * noise_A * (2.0 / BLOCK) ** 0.5, FLUX_ERROR * gained) / length
        spread.append(float(np.hypot(fed.resistance_ohm * noise_A / len(t) ** 0.5, of_flux)))
    if not volts:
        return None
    u, i, weight = np.array(volts), np.array(amperes), np.array(lasts)
    ohm = float(weight @ (u * i) / (weight @ i**2))
    share = weight * i / (weight @ i**2)
    half = 1.96 * float(np.sqrt(share**2 @ np.square(spread)))
    if len(u) > 1:
        scatter = float(np.sqrt(share**2 @ (u - ohm * i) ** 2 * len(u) / (len(u) - 1.0)))
        half = max(half, float(student.ppf(0.975, len(u) - 1)) * scatter)
    return SteadyResistance(fed.name, ohm, ohm - half, ohm + half, fed.resistance_ohm, len(u), float(weight.sum()))
