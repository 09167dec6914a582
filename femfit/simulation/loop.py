"""The closed loop: plant, sensor, observer and controller, one sample after the other, batched over runs.

At sample k: the sensor reads the plant, the observer makes an estimate of the reading and the voltage held since sample
k - 1, the controller answers with the voltage held until k + 1. A run that is lost stops there; its series are NaN from
then on and it never enters a mean.
"""

from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Any

import numpy as np

from femfit.core.arrays import BoolArray, FloatArray, IntArray
from femfit.model.actuator_model import ActuatorModel
from femfit.model.dynamics import hall_voltage
from femfit.model.hall_sensor import HallSensor
from femfit.simulation.controllers import Controller
from femfit.simulation.observers import Observer
from femfit.simulation.plant import Plant
from femfit.simulation.reference import Reference
from femfit.simulation.sensor import SensorErrors, read_sensor


class LoopOutcome(IntEnum):
    """End of one run; the first outcome other than HELD stays."""

    HELD = 0
    PULLED_IN = 1
    FELL = 2
    CURRENT_OUT_OF_RANGE = 3
    FILTER_DIVERGED = 4

    @property
    def sentence(self) -> str:
        """What happened; :mod:`femfit.simulation.why_lost` finds why."""
        return _SENTENCES[self]


_SENTENCES = {
    LoopOutcome.HELD: "The body was held over the whole time.",
    LoopOutcome.PULLED_IN: "The body came closer than the model's shortest distance and hits the electromagnet.",
    LoopOutcome.FELL: "The body fell beyond the model's longest distance.",
    LoopOutcome.CURRENT_OUT_OF_RANGE: "The current left the range of the model, so that its force there is not known.",
    LoopOutcome.FILTER_DIVERGED: (
        "The filter diverged before anything else went wrong: its estimate left the model, was no number, or its "
        "readings were unlike its predictions for long."
    ),
}
_HELD = int(LoopOutcome.HELD)


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """Everything that a batch of runs is made of."""

    plant: Plant
    sensor: HallSensor
    errors: SensorErrors
    observer: Observer | None  # None: the controller knows the exact state
    controller: Controller
    reference: Reference


@dataclass(frozen=True, eq=False)
class TimeSeries:
    """What was recorded; every array of shape (steps, recorded runs), NaN after a run was lost."""

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
    """Over the samples of one window, each of shape (runs,); NaN for runs lost before the window's end."""

    estimate_rms_m: FloatArray  # sqrt(mean((estimated - true distance)^2))
    estimate_bias_m: FloatArray
    tracking_rms_m: FloatArray
    tracking_bias_m: FloatArray
    normalised_innovation_squared: FloatArray  # Mean; 1 is expected of a true filter


@dataclass(frozen=True, eq=False)
class LoopResult:
    """What came of a batch of runs."""

    time_s: FloatArray
    series: TimeSeries
    windows: tuple[WindowStatistics, ...]  # In the order asked for, over all runs
    outcome: IntArray  # A :class:`LoopOutcome` each; shape (runs,)
    outcome_time_s: FloatArray  # When it was lost; NaN for runs that were held; shape (runs,)

    def outcomes(self) -> tuple[LoopOutcome, ...]:
        """The outcome of every run."""
        return tuple(LoopOutcome(int(code)) for code in self.outcome)

    def counts(self) -> dict[str, int]:
        """Runs by the name of their outcome."""
        names = [outcome.name for outcome in self.outcomes()]
        return {name: names.count(name) for name in dict.fromkeys(names)}

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
        return np.asarray(self.outcome == _HELD)


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
    circuit, step = model.require_circuit(), model.sample_time_s
    runs, steps = len(start), len(loop.reference.distance)
    kept = slice(0, runs if recorded is None else min(recorded, runs))
    record = np.full((len(TimeSeries.__dataclass_fields__), steps, kept.stop), np.nan)
    sums = np.zeros((len(windows), 5, runs))
    plant_sensor = replace(model, sensor=loop.sensor)
    state = loop.plant.start(start)
    belief = state[:, :3] if start_estimate is None else np.asarray(start_estimate, dtype=np.float64)
    reading = np.zeros(runs)
    seen: Any = None if loop.observer is None else loop.observer.start(belief)
    memory = np.zeros((runs, loop.controller.words))
    voltage = np.clip(circuit.resistance_ohm * belief[:, 2], circuit.voltage_min_V, circuit.voltage_max_V)
    outcome, when = np.zeros(runs, dtype=np.intp), np.full(runs, np.nan)
    none, unknown = np.zeros(runs, dtype=np.bool_), np.full(runs, np.nan)
    resting = hall_voltage(plant_sensor, state)
    for k in range(-supported_steps, steps):
        volts = resting if k < 0 else hall_voltage(plant_sensor, state, k * step)
        reading = read_sensor(loop.sensor, loop.errors, reading, volts, max(k, 0) * step, random)
        estimate, diverged, quality = state[:, :3], none, unknown
        if loop.observer is not None:
            first = k == -supported_steps
            seen = loop.observer.update(seen, reading) if first else loop.observer.step(seen, voltage, reading)
            estimate, diverged, quality = seen.mean[:, :3], seen.diverged, seen.normalised_innovation_squared
        if k < 0:
            continue
        usable = np.isfinite(estimate).all(axis=1)
        alive = model.validity.contains(state[:, 0], state[:, 2]) & usable
        whole = bool(alive.all())
        if not whole or diverged.any():
            code = _code(model, state, diverged)
            fresh = (outcome == _HELD) & (code != _HELD)
            outcome, when = np.where(fresh, code, outcome), np.where(fresh, k * step, when)
        # A lost run's controller is asked for rest, which it finds at once, not for what no voltage gives
        belief = estimate if whole else np.where(alive[:, None], estimate, start)
        reference = loop.reference.at(k)
        voltage, memory = loop.controller.command(memory, belief, reference)
        if kept.stop:
            wanted = np.broadcast_to(reference.distance, (runs,))
            row = [*state.T[:3], *belief.T, voltage, reading, wanted, quality]
            record[:, k] = np.where(alive[kept], [part[kept] for part in row], np.nan)
        inside = [j for j, window in enumerate(windows) if window.start <= k < window.stop]
        if inside:
            error, deviation = belief[:, 0] - state[:, 0], state[:, 0] - reference.distance
            sums[inside] += np.stack([error**2, error, deviation**2, deviation, quality])
        moved = loop.plant.step(state, voltage)
        state = moved if whole else np.where(alive[:, None], moved, state)
        if not alive.any():
            break
    lost_at = np.where(np.isnan(when), steps * step, when)
    return LoopResult(
        time_s=step * np.arange(steps, dtype=np.float64),
        series=TimeSeries(*record),
        windows=tuple(_statistics(sums[j], window, lost_at, step, steps) for j, window in enumerate(windows)),
        outcome=outcome,
        outcome_time_s=when,
    )


def _code(model: ActuatorModel, state: FloatArray, diverged: BoolArray) -> IntArray:
    """What is lost at this sample; a diverged filter that still gives numbers goes on, named."""
    box = model.validity
    distance, current = state[:, 0], state[:, 2]
    slack = 1e-9 * (box.current_max_A - box.current_min_A)
    return np.select(
        [
            ~(distance >= box.distance_min_m),
            distance > box.distance_max_m,
            (current < box.current_min_A - slack) | (current > box.current_max_A + slack),
            diverged,
        ],
        [LoopOutcome.PULLED_IN, LoopOutcome.FELL, LoopOutcome.CURRENT_OUT_OF_RANGE, LoopOutcome.FILTER_DIVERGED],
        _HELD,
    )


def _statistics(sums: FloatArray, window: slice, lost_at: FloatArray, step: float, steps: int) -> WindowStatistics:
    stop = min(window.stop, steps)
    mean = np.where(lost_at >= stop * step - 0.5 * step, sums, np.nan) / (stop - window.start)
    return WindowStatistics(np.sqrt(mean[0]), mean[1], np.sqrt(mean[2]), mean[3], mean[4])
