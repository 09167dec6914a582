"""The closed loop: plant, sensor, observer and controller, one sample after the other, batched over runs.

At sample k: the sensors read the plant as it was their delay ago, the observer makes an estimate of the readings and
the command held since sample k - 1, the controller answers with a command that acts for a sample, at once or after the
latency. A run that is lost stops there; its series are NaN from then on and it never enters a mean.

How far a simulation of several parts is: a callable that is told the part, the samples done and all of them.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np

from femfit.core.numerics import BoolArray, FloatArray, IntArray
from femfit.model.actuator_model import ActuatorModel
from femfit.simulation.allocation import limits_of
from femfit.simulation.blind import WindowStatistics, window_statistics
from femfit.simulation.controllers import Controller
from femfit.simulation.observers import Observer, innovation_quality
from femfit.simulation.operating_point import resting_command
from femfit.simulation.plant import Plant
from femfit.simulation.sensor import History, LoopSensor, SensorErrors, read_sensors, true_readings
from femfit.simulation.targets import Reference

Show = Callable[[int, int], None]
"""Takes how many samples are done, and of how many."""

SHOWN = 50
"""Conventional: samples between two reports of how far a loop is."""


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
    LoopOutcome.PULLED_IN: (
        "The body came to its near stop, or closer than the model's shortest distance, and hits the electromagnet."
    ),
    LoopOutcome.FELL: "The body fell to its far stop, or beyond the model's longest distance.",
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
    sensors: tuple[LoopSensor, ...]
    errors: SensorErrors
    observer: Observer | None  # None: the controller knows the exact state
    controller: Controller
    reference: Reference
    latency: int = 0  # Samples from a reading to the command that it leads to


@dataclass(frozen=True, eq=False)
class TimeSeries:
    """What was recorded; shapes begin with (steps, recorded runs), NaN after a run was lost."""

    distance_m: FloatArray
    velocity_m_s: FloatArray
    currents_A: FloatArray  # (..., n)
    estimated_distance_m: FloatArray
    estimated_velocity_m_s: FloatArray
    estimated_currents_A: FloatArray  # (..., n)
    commands: FloatArray  # (..., n), in V, or in A for a current amplifier
    readings: FloatArray  # (..., sensors); NaN where a sensor is not read
    reference_m: FloatArray
    normalised_innovation_squared: FloatArray  # Over the number of sensors


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
    show: Show | None = None,
) -> LoopResult:
    """Run a batch of closed loops.

    Parameters
    ----------
    start : array, shape (runs, 2 + n)
        True state at the first sample: m, m/s, A.
    start_estimate : array, shape (runs, 2 + n), or None
        Where the observer believes to start; None: at the true state.
    supported_steps : int
        Samples before the first during which the body rests on a support and the driver holds the current, so that the
        observer settles before the loop is closed.
    show : callable or None
        Takes the samples done and all of them, now and then.
    recorded : int or None
        Number of runs whose series are kept; None: all.
    """
    model, step = loop.plant.model, loop.plant.model.sample_time_s
    n, runs, steps = len(model.circuits), len(start), len(loop.reference.distance)
    recorded_runs = slice(0, runs if recorded is None else min(recorded, runs))
    record = _Record(steps, recorded_runs, n, len(loop.sensors))
    sums = np.zeros((len(windows), 6, runs))
    state = loop.plant.start(start)
    belief = state[:, : 2 + n] if start_estimate is None else np.asarray(start_estimate, dtype=np.float64)
    history = History(loop.sensors, state, step)
    last = np.full((runs, len(loop.sensors)), np.nan)
    observed: Any = None if loop.observer is None else loop.observer.start(belief)
    memory = np.zeros((runs, loop.controller.words))
    rest = np.clip(resting_command(model, belief[:, 2:]), *limits_of(model))
    on_their_way = deque([rest] * (loop.latency + 1), maxlen=loop.latency + 1)  # the oldest of them acts
    watch = _Watch(model, runs)
    none, unknown = np.zeros(runs, dtype=np.bool_), np.full(runs, np.nan)
    for k in range(-supported_steps, steps):
        values = true_readings(model, loop.sensors, history, max(k, 0) * step)
        readings = read_sensors(loop.sensors, loop.errors, last, values, k, max(k, 0) * step, random)
        last = np.where(np.isnan(readings), last, readings)
        estimate, diverged, quality = state[:, : 2 + n], none, unknown
        if loop.observer is not None:
            first = k == -supported_steps
            observed = (
                loop.observer.update(observed, readings)
                if first
                else loop.observer.step(observed, on_their_way[0], readings)
            )
            estimate, diverged, quality = observed.mean[:, : 2 + n], observed.diverged, innovation_quality(observed)
        if show is not None and k % SHOWN == 0:
            show(k + supported_steps, steps + supported_steps)
        if k < 0:
            continue
        alive = watch.alive(k * step, state, estimate, diverged)
        all_alive = bool(alive.all())
        # A lost run's controller is asked for rest, which it finds at once, not for what no voltage gives
        belief = estimate if all_alive else np.where(alive[:, None], estimate, start)
        reference = loop.reference.at(k)
        command, memory = loop.controller.command(memory, belief, reference)
        on_their_way.append(command)
        if recorded_runs.stop:
            record.add(k, alive, (state[:, : 2 + n], belief, command, readings, reference.distance, quality))
        inside = [j for j, window in enumerate(windows) if window.start <= k < window.stop]
        if inside:
            error, deviation = belief[:, 0] - state[:, 0], state[:, 0] - reference.distance
            read = np.where(np.isfinite(quality), np.isfinite(readings).sum(axis=1), 0)
            parts = [error**2, error, deviation**2, deviation, np.where(read > 0, quality * read, 0.0), read]
            sums[inside] += np.stack(parts)
        moved = loop.plant.step(state, on_their_way[0])
        state = moved if all_alive else np.where(alive[:, None], moved, state)
        history.add(state)
        if not alive.any():
            break
    outcome, when = watch.end(steps * step)
    lost_at = np.where(np.isnan(when), steps * step, when)
    return LoopResult(
        time_s=step * np.arange(steps, dtype=np.float64),
        series=record.series(),
        windows=tuple(window_statistics(sums[j], window, lost_at, step, steps) for j, window in enumerate(windows)),
        outcome=outcome,
        outcome_time_s=when,
    )


class _Record:
    """The series of the first runs."""

    def __init__(self, steps: int, kept: slice, circuits: int, sensors: int) -> None:
        self._kept = kept
        widths = {"state": 2 + circuits, "belief": 2 + circuits, "command": circuits, "readings": sensors}
        self._many = [np.full((steps, kept.stop, width), np.nan) for width in widths.values()]
        self._reference, self._quality = np.full((2, steps, kept.stop), np.nan)

    def add(self, k: int, alive: BoolArray, row: tuple[FloatArray, ...]) -> None:
        runs, alive = self._kept, alive[self._kept]
        *many, reference, quality = row
        for array, values in zip(self._many, many, strict=True):
            array[k] = np.where(alive[:, None], values[runs], np.nan)
        self._reference[k] = np.where(alive, np.broadcast_to(reference, quality.shape)[runs], np.nan)
        self._quality[k] = np.where(alive, quality[runs], np.nan)

    def series(self) -> TimeSeries:
        state, belief, command, readings = self._many
        return TimeSeries(
            state[..., 0], state[..., 1], state[..., 2:],
            belief[..., 0], belief[..., 1], belief[..., 2:],
            command, readings, self._reference, self._quality,
        )  # fmt: skip


class _Watch:
    """Which runs are lost, how and when."""

    def __init__(self, model: ActuatorModel, runs: int) -> None:
        self._model = model
        self._outcome, self._when = np.zeros(runs, dtype=np.intp), np.full(runs, np.nan)
        self._touched, self._side = np.full(runs, np.nan), np.zeros(runs, dtype=np.intp)

    def alive(self, time: float, state: FloatArray, estimate: FloatArray, diverged: BoolArray) -> BoolArray:
        """Which runs go on from this sample; a diverged filter that still gives numbers goes on, named."""
        model, n = self._model, len(self._model.circuits)
        currents = state[:, 2 : 2 + n]
        alive = model.validity.contains(state[:, 0], currents) & np.isfinite(estimate).all(axis=1)
        if not alive.all() or diverged.any():
            code = self._code(state, currents, diverged)
            fresh = (self._outcome == _HELD) & (code != _HELD)
            self._outcome = np.where(fresh, code, self._outcome)
            self._when = np.where(fresh, time, self._when)
        near, far = model.require_motion().ends
        if (near, far) != (-np.inf, np.inf):
            side = np.where(
                state[:, 0] <= near, LoopOutcome.PULLED_IN, np.where(state[:, 0] >= far, LoopOutcome.FELL, 0)
            )
            self._touched = np.where(side == 0, np.nan, np.where(self._side == side, self._touched, time))
            self._side = side
        return np.asarray(alive)

    def _code(self, state: FloatArray, currents: FloatArray, diverged: BoolArray) -> IntArray:
        box, distance = self._model.validity, state[:, 0]
        middle = np.full(len(distance), 0.5 * (box.distance_min_m + box.distance_max_m))
        return np.select(
            [
                ~(distance >= box.distance_min_m),
                distance > box.distance_max_m,
                ~box.contains(middle, currents),
                diverged,
            ],
            [LoopOutcome.PULLED_IN, LoopOutcome.FELL, LoopOutcome.CURRENT_OUT_OF_RANGE, LoopOutcome.FILTER_DIVERGED],
            _HELD,
        )

    def end(self, time: float) -> tuple[IntArray, FloatArray]:
        """Outcomes and times; a body that lies on a stop at the end was not held."""
        lies = (self._outcome == _HELD) & (self._side != 0)
        outcome = np.where(lies, self._side, self._outcome)
        return outcome, np.where(lies, np.minimum(self._touched, time), self._when)


LoopProgress = Callable[[str, int, int], None]
"""Takes what is simulated, how many samples are done, and of how many."""


def stage(progress: LoopProgress | None, name: str) -> Show | None:
    """What one part of the work is told, as it is said of that part alone."""
    if progress is None:
        return None
    return lambda done, total: progress(name, done, total)
