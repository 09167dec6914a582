"""The closed loop: plant, sensor, observer and controller, one sample after the other, batched over runs.

At sample k: the sensors read the plant as it was their delay ago, the observer makes an estimate of the readings and
the command held since sample k - 1, the controller answers with a command that acts for a sample, at once or after the
latency. A run that is lost stops there; its series are NaN from then on and it never enters a mean. Several controllers
have equal shares of a batch, one after the other, which meet the same noise.

How far a simulation of several parts is: a callable that is told the part, the samples done and all of them.
"""

from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np

from femfit.core.numerics import BoolArray, FloatArray, IntArray
from femfit.estimate.constants import AT_STOP
from femfit.estimate.filter_state import FilterState
from femfit.model.actuator_model import ActuatorModel
from femfit.simulation.allocation import limits_of
from femfit.simulation.controllers import Controller
from femfit.simulation.observers import Observer
from femfit.simulation.operating_point import resting_command
from femfit.simulation.plant import LoopSensor, Plant, SensorBank, SensorErrors
from femfit.simulation.targets import Reference

Show = Callable[[int, int], None]
"""Takes how many samples are done, and of how many."""

LIFTED = 1e-3
"""Conventional: part of the validity domain's distances by which a body has left the stop where it began."""

SHOWN = 50
"""Conventional: samples between two reports of how far a loop is."""


class LoopOutcome(IntEnum):
    """End of one run; the first outcome other than HELD stays."""

    HELD = 0
    PULLED_IN = 1
    FELL = 2
    CURRENT_OUT_OF_RANGE = 3
    FILTER_DIVERGED = 4


_HELD, *_LOST = (int(outcome) for outcome in LoopOutcome)


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """Everything that a batch of runs is made of."""

    plant: Plant
    sensors: tuple[LoopSensor, ...]
    errors: SensorErrors
    observer: Observer
    controllers: tuple[Controller, ...]  # Each of as many runs
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
    """What came of a batch of runs; the last four are of each run's samples, NaN for runs that were lost."""

    time_s: FloatArray
    series: TimeSeries
    outcome: IntArray  # A :class:`LoopOutcome` each; shape (runs,)
    outcome_time_s: FloatArray  # When it was lost; NaN for runs that were held; shape (runs,)
    estimate_rms_m: FloatArray  # sqrt(mean((estimated - true distance)^2)); shape (runs,)
    tracking_rms_m: FloatArray
    normalised_innovation_squared: FloatArray  # Mean over the readings; 1 is expected of a true filter
    readings: FloatArray  # How many a filter took, of all sensors; 0 without one

    @property
    def held(self) -> BoolArray:
        """Which runs were held, shape (runs,)."""
        return np.asarray(self.outcome == _HELD)


def run_loop(
    loop: ClosedLoop,
    start: FloatArray,
    random: np.random.Generator,
    *,
    supported_steps: int = 0,
    recorded: int | None = None,
    show: Show | None = None,
) -> list[LoopResult]:
    """Run a batch of closed loops; of each controller there is a result.

    Parameters
    ----------
    start : array, shape (runs, 2 + n)
        State at the first sample, which the observer knows: m, m/s, A.
    supported_steps : int
        Samples before the first during which the body rests on a support and the driver holds the current, so that the
        observer settles before the loop is closed.
    show : callable or None
        Takes the samples done and all of them, now and then.
    recorded : int or None
        Number of runs of each controller whose series are kept; None: all.
    """
    model, step = loop.plant.model, loop.plant.model.sample_time_s
    n, runs, steps = len(model.circuits), len(start), len(loop.reference.distance)
    share = runs // len(loop.controllers)
    controlled = [(each, slice(k * share, (k + 1) * share)) for k, each in enumerate(loop.controllers)]
    recorded_runs = np.flatnonzero(np.arange(runs) % share < (runs if recorded is None else recorded))
    record = np.full((steps, len(recorded_runs), 6 + 3 * n + len(loop.sensors)), np.nan)
    sums = np.zeros((4, runs))
    state = loop.plant.start(start)
    belief = state[:, : 2 + n]
    sensing = SensorBank(model, loop.sensors, loop.errors, state, random, len(controlled))
    observed: Any = loop.observer.start(belief)
    memories = [np.zeros((share, controller.words)) for controller in loop.controllers]
    rest = np.clip(resting_command(model, belief[:, 2:]), *limits_of(model))
    on_their_way = deque([rest] * (loop.latency + 1), maxlen=loop.latency + 1)  # the oldest of them acts
    watch, touched = _Watch(model, runs), np.zeros((2, runs), dtype=np.bool_)
    for k in range(-supported_steps, steps):
        readings = sensing.read(k, max(k, 0) * step)
        observed = (
            loop.observer.update(observed, readings)
            if k == -supported_steps
            else loop.observer.step(observed, on_their_way[0], readings)
        )
        if show is not None and k % SHOWN == 0:
            show(k + supported_steps, steps + supported_steps)
        if k < 0:
            continue
        estimate, reference = observed.mean[:, : 2 + n], loop.reference.at(k)
        alive = watch.alive(k * step, state, observed, touched, reference.distance)
        # A lost run's controller is asked for rest, which it finds at once, not for what no voltage gives
        belief = np.where(alive[:, None], estimate, start)
        answers = [
            controller.command(memory, belief[which], reference)
            for memory, (controller, which) in zip(memories, controlled, strict=True)
        ]
        command, memories = np.concatenate([commands for commands, _ in answers]), [memory for _, memory in answers]
        on_their_way.append(command)
        squared = observed.normalised_innovation_squared
        read = np.isfinite(observed.innovation_variance).reshape(runs, -1).sum(axis=1)
        if len(recorded_runs):
            distance, quality = np.broadcast_to(reference.distance, runs), squared / np.maximum(read, 1)
            row = np.column_stack([state[:, : 2 + n], belief, command, readings, distance, quality])
            record[k] = np.where(alive[:, None], row, np.nan)[recorded_runs]
        error, deviation = belief[:, 0] - state[:, 0], state[:, 0] - reference.distance
        sums += np.stack([error**2, deviation**2, np.where(np.isfinite(squared), squared, 0.0), read])
        touched[:] = False
        state = np.where(alive[:, None], loop.plant.step(state, on_their_way[0], touched), state)
        sensing.see(state, max(k + 1, 0) * step)
        if not alive.any():
            break
    outcome, when = watch.end()
    mean = np.where(outcome == _HELD, sums, np.nan) / steps
    with np.errstate(invalid="ignore"):
        statistics = np.stack([np.sqrt(mean[0]), np.sqrt(mean[1]), mean[2] / mean[3], sums[3]])
    time_s = step * np.arange(steps, dtype=np.float64)
    return [
        LoopResult(time_s, _series(rows, n, len(loop.sensors)), outcome[which], when[which], *statistics[:, which])
        for rows, (_, which) in zip(np.split(record, len(controlled), axis=1), controlled, strict=True)
    ]


def _series(record: FloatArray, circuits: int, sensors: int) -> TimeSeries:
    """Rows of (state, belief, command, readings, reference, quality) of each sample and run, by their names."""
    ends = np.cumsum([2 + circuits, 2 + circuits, circuits, sensors])
    state, belief, command, readings, last = np.split(record, ends, axis=2)
    return TimeSeries(
        state[..., 0], state[..., 1], state[..., 2:],
        belief[..., 0], belief[..., 1], belief[..., 2:],
        command, readings, last[..., 0], last[..., 1],
    )  # fmt: skip


class _Watch:
    """Which runs are lost, how and when."""

    def __init__(self, model: ActuatorModel, runs: int) -> None:
        self._box, self._ends, self._circuits = model.validity, model.require_motion().ends, len(model.circuits)
        self._outcome, self._when = np.zeros(runs, dtype=np.intp), np.full(runs, np.nan)
        self._lifted, self._met = np.zeros(runs, dtype=np.bool_), np.zeros((2, runs), dtype=np.bool_)

    def alive(
        self, time: float, state: FloatArray, observed: FilterState, touched: BoolArray, reference: FloatArray
    ) -> BoolArray:
        """Which runs go on from this sample; a diverged filter that still gives numbers goes on, named.

        Bodies that met a stop since the sample before are lost, but for those that the reference seats there, and those
        that have not left the one where they began or were seated.
        """
        box, distance, currents = self._box, state[:, 0], state[:, 2 : 2 + self._circuits]
        low, high, (near, far) = box.distance_min_m, box.distance_max_m, self._ends
        inside = box.contains(distance, currents)  # to rounding, as of a body on a stop at the domain's end
        if not inside.all() or observed.diverged.any():
            covered = box.contains(np.full(len(distance), 0.5 * (low + high)), currents)
            self._name([~inside & ~(distance >= low), ~inside & (distance > high), ~covered, observed.diverged], time)
        met = np.stack([(distance <= near) | touched[0], (distance >= far) | touched[1]])
        seated = met & (np.abs(reference - np.array([[near], [far]])) <= AT_STOP * (high - low))
        self._met, apart = met & ~seated, LIFTED * (high - low)
        self._lifted &= ~seated.any(axis=0)
        self._lifted |= (distance > near + apart) & (distance < far - apart) & ~touched.any(axis=0)
        self._name(self._met & self._lifted, time)
        finite = np.isfinite(observed.mean[:, : 2 + self._circuits]).all(axis=1)
        return np.asarray(inside & finite & ~np.isin(self._outcome, _LOST[:2]))

    def _name(self, lost: Iterable[BoolArray], time: float) -> None:
        """Runs that are lost by these outcomes in their order; the first name of a run stays."""
        for outcome, runs in zip(_LOST, lost, strict=False):
            fresh = runs & (self._outcome == _HELD)
            self._outcome[fresh], self._when[fresh] = outcome, time

    def end(self) -> tuple[IntArray, FloatArray]:
        """Outcomes and times; a body that never left the stop where it began was not held, from the first sample on."""
        self._name(self._met & ~self._lifted, 0.0)
        return self._outcome, self._when


LoopProgress = Callable[[str, int, int], None]
"""Takes what is simulated, how many samples are done, and of how many."""
