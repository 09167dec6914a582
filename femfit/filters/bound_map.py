"""The Cramer-Rao bound of the distance over distance and current: where sensors can tell it, and where they are blind.

The body stands still; the winding carries a constant current, or one on which a test voltage is superposed. A current
that changes tells the inductance L(d, i), and so the distance, at every sample; a constant one only what the motion
does to it, and no current nothing. Where the iron saturates, dL/dd falls.

References
----------
P. Tichavsky, C. H. Muravchik and A. Nehorai, IEEE Trans. Signal Processing 46 (1998) 1386: the bound's recursion.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from femfit.core.amount import amount, amount_range
from femfit.core.arrays import BoolArray, FloatArray
from femfit.core.errors import FilterError
from femfit.core.printed import Printed
from femfit.filters.constants import MAP_POINTS, OBSERVED_SHARE, SETTLING_STEPS, TEST_SAMPLES
from femfit.filters.error_bound import next_covariance, output_jacobians, without_stops
from femfit.filters.fine_steps import in_fine_steps
from femfit.filters.levitation import levitation_process
from femfit.filters.noise import FilterNoise
from femfit.filters.process import FilterProcess
from femfit.model.actuator_model import ActuatorModel
from femfit.model.json_file import model_of


@dataclass(frozen=True, eq=False, repr=False)
class BoundMap(Printed):
    """Least standard deviation of the distance that any unbiased filter can reach, over distance and current.

    Examples
    --------
    >>> import femfit as ff
    >>> found = ff.bound_map("model.json", distances_m=(0.02, 0.03), currents_A=(0.2, 0.6, 1.0))
    >>> found.deviation_m.shape, bool(found.blind.any())
    ((2, 3), False)
    """

    sensors: tuple[str, ...]
    distances_m: FloatArray  # (d,)
    currents_A: FloatArray  # Mean of the winding's current; (c,)
    deviation_m: FloatArray  # (d, c)
    unread_m: FloatArray  # What the model tells without a reading, of a body that comes to rest by itself; (d, c)
    first_m: float  # Standard deviation of the first estimate
    test_voltage_V: float
    test_frequency_Hz: float

    @property
    def blind(self) -> BoolArray:
        """Where the sensors do not halve what neither first estimate nor model knows without them; shape (d, c)."""
        return np.asarray(~(self.deviation_m < OBSERVED_SHARE * np.minimum(self.first_m, self.unread_m)))

    def __str__(self) -> str:
        with_test = "without a test voltage"
        if self.test_voltage_V:
            test = amount(self.test_voltage_V, "V"), amount(self.test_frequency_Hz, "Hz")
            with_test = f"with a square wave of +-{test[0]} at {test[1]} on the command"
        against = f"with {', '.join(self.sensors)} against the process noises that it allows for"
        lines = [f"Best that any filter can tell of the distance {against}, {with_test}:"]
        for k in range(0, len(self.currents_A), max(1, len(self.currents_A) // 5)):
            best = self.deviation_m[:, k]
            told = best[~self.blind[:, k]]
            at = f"  at {amount(float(self.currents_A[k]), 'A')}: "
            if not len(told):
                lines.append(f"{at}nothing; it is blind there{self._without(k)}")
                continue
            worst = "" if len(told) == len(best) else f", blind at {self._where(self.blind[:, k])}"
            lines.append(f"{at}{amount_range(float(told.min()), float(told.max()), 'm')}{worst}")
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """As JSON-ready data."""
        arrays = ("distances_m", "currents_A", "deviation_m", "blind")
        plain = ("first_m", "test_voltage_V", "test_frequency_Hz")
        return (
            {"sensors": list(self.sensors)}
            | {name: getattr(self, name) for name in plain}
            | {name: getattr(self, name).tolist() for name in arrays}
        )

    def _without(self, k: int) -> str:
        """What is known all the same, where a stable body has come to rest."""
        known = self.unread_m[:, k]
        known = known[known < OBSERVED_SHARE * self.first_m]
        if not len(known):
            return ""
        span = amount_range(float(known.min()), float(known.max()), "m")
        return f"; the model alone, without a reading, knows the position of rest to {span}"

    def _where(self, here: BoolArray) -> str:
        places = self.distances_m[here]
        return amount_range(float(places.min()), float(places.max()), "m")


def bound_map(
    model: ActuatorModel | str | Path,
    *,
    sensors: Sequence[str] | None = None,
    noise: FilterNoise | None = None,
    distances_m: Sequence[float] | None = None,
    currents_A: Sequence[float] | None = None,
    test_voltage_V: float = 0.0,
    test_frequency_Hz: float | None = None,
) -> BoundMap:
    """How well sensors can tell the distance of a body that stands still, over distance and current.

    Parameters
    ----------
    sensors, noise : optional
        As for :func:`femfit.kalman_filter`.
    distances_m, currents_A : sequence of float or None
        Fifteen over the travel, and fifteen from no current to the largest, where None.
    test_voltage_V : float
        Amplitude of a square wave on top of the voltage that holds the current, within the driver's limits.
    test_frequency_Hz : float or None
        Of that square wave, whose period is rounded to whole samples; a twentieth of the sampling rate where None.

    Raises
    ------
    MissingPartError
        If the model lacks a sensor, circuit or motion, or has several circuits.
    FilterError
        If a sensor has no noise, or the frequency is not below half of the sampling rate.

    Examples
    --------
    >>> import femfit as ff
    >>> found = ff.bound_map("model.json", sensors=("hall",), distances_m=(0.022,), currents_A=(0.4,))
    >>> bool(found.deviation_m[0, 0] < 1e-4)
    True
    """
    model = model_of(model)
    circuit, box = model.require_circuit(), model.validity
    ends = np.clip(model.require_motion().ends, box.distance_min_m, box.distance_max_m)
    d = (
        np.linspace(float(ends[0]), float(ends[1]), MAP_POINTS)
        if distances_m is None
        else np.asarray(distances_m, np.float64)
    )
    least = min(max(0.0, box.current_min_A), box.current_max_A)
    i = np.linspace(least, box.current_max_A, MAP_POINTS) if currents_A is None else np.asarray(currents_A, np.float64)
    box.require(d[:, None], i)
    free = without_stops(model)
    process = in_fine_steps(free, levitation_process(free, sensors=sensors, noise=noise))
    frequency = 1.0 / (TEST_SAMPLES * process.step_s) if test_frequency_Hz is None else test_frequency_Hz
    if not 0.0 < frequency <= 0.5 / process.step_s:
        raise FilterError(
            f"The test voltage's frequency must be > 0 and at most half of the sampling rate, "
            f"{0.5 / process.step_s:g} Hz; instead received {frequency:g} Hz."
        )
    places = np.zeros((len(d) * len(i), process.order))
    places[:, 0], places[:, 2] = np.repeat(d, len(i)), np.tile(i, len(d))
    low = circuit.voltage_min_V if circuit.drive.diode_V is None else 0.0
    period = max(2, round(1.0 / (frequency * process.step_s)))
    wave = _Wave(test_voltage_V, period, low, circuit.voltage_max_V)
    variance = _settled(process, model, places, wave)
    return BoundMap(
        sensors=tuple(output.name for output in process.outputs),
        distances_m=d,
        currents_A=i,
        deviation_m=np.sqrt(variance).reshape(len(d), len(i)),
        unread_m=_unread(process, model, places).reshape(len(d), len(i)),
        first_m=float(np.sqrt(process.require_start_covariance()[0, 0])),
        test_voltage_V=test_voltage_V,
        test_frequency_Hz=1.0 / (period * process.step_s) if test_voltage_V else 0.0,
    )


@dataclass(frozen=True)
class _Wave:
    """A square wave with a period of so many samples, kept within the driver's limits."""

    amplitude: float
    period: int
    low: float
    high: float

    def added_to(self, volts: FloatArray, sample: int) -> FloatArray:
        sign = 1.0 if 2 * (sample % self.period) < self.period else -1.0
        return np.clip(volts + sign * self.amplitude, self.low, self.high) if self.amplitude else volts


def _unread(process: FilterProcess, model: ActuatorModel, places: FloatArray) -> FloatArray:
    """Deviation of the distance at each place without a reading; infinite where it grows."""
    slope = process.state_jacobian(places, model.require_circuit().resistance_ohm * places[:, 2])
    covariance = np.broadcast_to(process.require_start_covariance(), slope.shape)
    with np.errstate(over="ignore", invalid="ignore"):
        for _ in range(SETTLING_STEPS):
            covariance = slope @ covariance @ slope.swapaxes(1, 2) + process.process_covariance
        found = np.sqrt(covariance[:, 0, 0])
    return np.where(np.isfinite(found), found, np.inf)


def _settled(process: FilterProcess, model: ActuatorModel, places: FloatArray, wave: _Wave) -> FloatArray:
    """Variance of the distance at each place, as the mean of the last period."""
    box, states = model.validity, places.copy()
    holding = model.require_circuit().resistance_ohm * places[:, 2]
    covariance = np.broadcast_to(process.require_start_covariance(), (len(places), process.order, process.order))
    total = np.zeros(len(places))
    slope, outputs = process.state_jacobian(states, holding), output_jacobians(process, states)
    for sample in range(SETTLING_STEPS):
        if wave.amplitude:
            volts = wave.added_to(holding, sample)
            slope = process.state_jacobian(states, volts)
            moved = process.transition(states, volts)[:, 2]
            states[:, 2] = np.clip(moved, box.current_min_A, box.current_max_A)
            outputs = output_jacobians(process, states)
        covariance = next_covariance(process, covariance, slope, outputs)
        if sample >= SETTLING_STEPS - wave.period:
            total += covariance[:, 0, 0] / wave.period
    return total
