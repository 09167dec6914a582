"""The closed loop: plant, sensor, observer and controller, one sample after the other, batched over runs.

At sample k: the sensor reads the plant, the observer makes an estimate of the reading and the voltage held since sample
k - 1, the controller answers with the voltage held until k + 1. A run that is lost stops there; its series are NaN from
then on and it never enters a mean.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from femfit.core.arrays import BoolArray, FloatArray, IntArray
from femfit.model.actuator_model import ActuatorModel, HallSensor
from femfit.model.dynamics import hall_voltage
from femfit.simulation.controller import Controller, Reference
from femfit.simulation.observer import Observer
from femfit.simulation.outcome import LoopOutcome
from femfit.simulation.plant import Plant
from femfit.simulation.sensor import SensorErrors, initial_sensor_state, read_sensor


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """Everything that a batch of runs is made of.

    Parameters
    ----------
    observer : Observer or None
        None: the controller knows the exact state.
    """

    plant: Plant
    sensor: HallSensor
    errors: SensorErrors
    observer: Observer[Any] | None
    controller: Controller
    reference: Reference


@dataclass(frozen=True, eq=False)
class TimeSeries:
    """What was recorded; every array of shape (steps, recorded runs), NaN after a run was lost.

    Parameters
    ----------
    normalised_innovation_squared : array
        NaN where the observer has none.
    """

    distance_m: FloatArray
    velocity_m_s: FloatArray
    current_A: FloatArray
    estimated_distance_m: FloatArray
    estimated_velocity_m_s: FloatArray
    estimated_current_A: FloatArray
    voltage_V: FloatArray
    hall_V: FloatArray
    reference_m: FloatArray
    normalised_innovation_squared: FloatArray


@dataclass(frozen=True, eq=False)
class WindowStatistics:
    """Sums over the samples of one window, each of shape (runs,); NaN for runs lost before the window's end.

    Parameters
    ----------
    estimate_rms_m : array
        sqrt(mean((true - estimated distance)^2)), the paper's RMS.
    normalised_innovation_squared : array
        Mean; 1 is expected of a true filter.
    """

    estimate_rms_m: FloatArray
    estimate_bias_m: FloatArray
    tracking_rms_m: FloatArray
    tracking_bias_m: FloatArray
    normalised_innovation_squared: FloatArray


@dataclass(frozen=True, eq=False)
class LoopResult:
    """What came of a batch of runs.

    Parameters
    ----------
    time_s : array, shape (steps,)
        Of the samples.
    windows : tuple of WindowStatistics
        In the order asked for, over all runs.
    outcome : array of int, shape (runs,)
        A :class:`LoopOutcome` each.
    outcome_time_s : array, shape (runs,)
        When it was lost; NaN for runs that were held.
    """

    time_s: FloatArray
    series: TimeSeries
    windows: tuple[WindowStatistics, ...]
    outcome: IntArray
    outcome_time_s: FloatArray

    def outcomes(self) -> tuple[LoopOutcome, ...]:
        """The outcome of every run."""
        return tuple(LoopOutcome(int(code)) for code in self.outcome)

    def part(self, runs: slice) -> "LoopResult":
        """The result of some consecutive runs of the batch."""
        series = TimeSeries(*(getattr(self.series, name)[:, runs] for name in TimeSeries.__dataclass_fields__))
        windows = tuple(
            WindowStatistics(*(getattr(w, name)[runs] for name in WindowStatistics.__dataclass_fields__))
            for w in self.windows
        )
        return LoopResult(self.time_s, series, windows, self.outcome[runs], self.outcome_time_s[runs])

    @property
    def held(self) -> BoolArray:
        """Which runs were held, shape (runs,)."""
        return np.asarray(self.outcome == LoopOutcome.HELD)


def run_loop(
    loop: ClosedLoop,
    start: FloatArray,
    random: np.random.Generator,
    *,
    start_estimate: FloatArray | None = None,
    supported_steps: int = 0,
    recorded: int | None = None,
    windows: tuple[slice, ...] = (),
) -> LoopResult:
    """Run a batch of closed loops.

    Parameters
    ----------
    start : array, shape (runs, 3)
        True state at the first sample: m, m/s, A.
    start_estimate : array, shape (runs, 3), or None
        Where the observer believes to start; None: at the true state.
    supported_steps : int
        Samples before the first during which the body rests on a support and the driver holds the voltage R i, so that
        the observer settles before the loop is closed.
    recorded : int or None
        Number of runs whose series are kept; None: all.
    """
    model = loop.plant.model
    runs, steps = len(start), len(loop.reference.distance)
    step = model.sample_time_s
    kept = slice(0, runs if recorded is None else min(recorded, runs))
    record = np.full((len(TimeSeries.__dataclass_fields__), steps, kept.stop), np.nan)
    sums = np.zeros((len(windows), 5, runs))
    plant_sensor = replace(model, sensor=loop.sensor)
    state = loop.plant.start(start)
    belief = state[:, :3] if start_estimate is None else np.asarray(start_estimate, dtype=np.float64)
    sensor = initial_sensor_state(runs)
    seen = None if loop.observer is None else loop.observer.start(belief)
    memory = loop.controller.initial_memory(belief)
    voltage = np.clip(model.require_circuit().resistance_ohm * belief[:, 2], *_clamp(model))
    outcome, when = np.zeros(runs, dtype=np.intp), np.full(runs, np.nan)
    alive = np.ones(runs, dtype=bool)
    held_volts = hall_voltage(plant_sensor, state)
    for k in range(-supported_steps, 0):
        sensor = read_sensor(loop.sensor, loop.errors, sensor, held_volts, 0.0, step, random)
        if loop.observer is not None:
            seen = loop.observer.observe(seen, voltage, sensor.reading_V, first=k == -supported_steps)
    for k in range(steps):
        volts = hall_voltage(plant_sensor, state, k * step)
        sensor = read_sensor(loop.sensor, loop.errors, sensor, volts, k * step, step, random)
        estimate, diverged, quality = state[:, :3], np.zeros(runs, dtype=np.bool_), np.full(runs, np.nan)
        if loop.observer is not None:
            seen = loop.observer.observe(seen, voltage, sensor.reading_V, first=k == 0 and not supported_steps)
            estimate, diverged = loop.observer.estimate(seen), loop.observer.diverged(seen)
            quality = loop.observer.normalised_innovation_squared(seen)
        usable = np.asarray(np.isfinite(estimate).all(axis=1))
        outcome, when, alive = _judge(model, state, diverged, usable, outcome, when, k * step)
        belief = np.where((alive & usable)[:, None], estimate, belief)
        reference = loop.reference.at(k)
        voltage, memory = loop.controller.command(memory, belief, reference)
        wanted = np.broadcast_to(reference.distance, (runs,))
        if kept.stop:
            row = [*state.T[:3], *belief.T, voltage, sensor.reading_V, wanted, quality]
            record[:, k] = np.where(alive[kept], np.stack([part[kept] for part in row]), np.nan)
        _accumulate(sums, windows, k, state[:, 0], belief[:, 0], reference.distance, quality)
        state = np.where(alive[:, None], loop.plant.step(state, voltage), state)
        if not np.any(alive):
            break
    lost_at = np.where(np.isnan(when), steps * step, when)
    return LoopResult(
        time_s=step * np.arange(steps, dtype=np.float64),
        series=TimeSeries(*record),
        windows=tuple(_statistics(sums[j], window, lost_at, step, steps) for j, window in enumerate(windows)),
        outcome=outcome,
        outcome_time_s=when,
    )


def _clamp(model: ActuatorModel) -> tuple[float, float]:
    circuit = model.require_circuit()
    return circuit.voltage_min_V, circuit.voltage_max_V


def _judge(
    model: ActuatorModel,
    state: FloatArray,
    diverged: BoolArray,
    usable: BoolArray,
    outcome: IntArray,
    when: FloatArray,
    time: float,
) -> tuple[IntArray, FloatArray, BoolArray]:
    """Name what is lost at this sample; a diverged filter that still gives numbers goes on, named."""
    box = model.validity
    distance, current = state[:, 0], state[:, 2]
    slack = 1e-9 * (box.current_max_A - box.current_min_A)
    code = np.select(
        [
            ~(distance >= box.distance_min_m),
            distance > box.distance_max_m,
            (current < box.current_min_A - slack) | (current > box.current_max_A + slack),
            diverged,
        ],
        [LoopOutcome.PULLED_IN, LoopOutcome.FELL, LoopOutcome.CURRENT_OUT_OF_RANGE, LoopOutcome.FILTER_DIVERGED],
        LoopOutcome.HELD,
    )
    inside = model.validity.contains(distance, current)
    fresh = (outcome == LoopOutcome.HELD) & (code != LoopOutcome.HELD)
    return np.where(fresh, code, outcome), np.where(fresh, time, when), inside & usable


def _accumulate(
    sums: FloatArray,
    windows: tuple[slice, ...],
    k: int,
    distance: FloatArray,
    estimated: FloatArray,
    reference: FloatArray,
    quality: FloatArray,
) -> None:
    inside = [j for j, window in enumerate(windows) if window.start <= k < window.stop]
    if inside:
        error, deviation = estimated - distance, distance - reference
        sums[inside] += np.stack([error**2, error, deviation**2, deviation, quality])


def _statistics(sums: FloatArray, window: slice, lost_at: FloatArray, step: float, steps: int) -> WindowStatistics:
    stop = min(window.stop, steps)
    mean = np.where(lost_at >= stop * step - 0.5 * step, sums, np.nan) / (stop - window.start)
    return WindowStatistics(np.sqrt(mean[0]), mean[1], np.sqrt(mean[2]), mean[3], mean[4])
