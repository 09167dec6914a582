"""Gains of linear controllers: found by what the sampled loop can stand, over the whole reference.

A candidate is judged at the nearest, the middle and the farthest point of rest by the least phase margin and modulus
margin (the distance of the loop's gain from -1) over those that are wanted, the largest share of the commands' room
that the sensors' noise takes with any of the filters that may run, and how fast the loop's slowest motion decays.
Wanted is the fastest one that keeps :data:`WANTED_PHASE_DEG`, :data:`WANTED_MODULUS`, :data:`NOISE_ROOM` and
:data:`SETTLING_PART`; where none does, the one that comes nearest.

References
----------
K. J. Astrom and T. Hagglund, Advanced PID Control (ISA, 2006), section 4.3: robustness by the maximum sensitivity.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeVar

import numpy as np

from femfit.core.errors import DomainError
from femfit.core.numerics import FloatArray
from femfit.estimate.filter import Filter
from femfit.model.actuator_model import ActuatorModel
from femfit.model.drive import commands_currents
from femfit.simulation import constants
from femfit.simulation.allocation import limits_of
from femfit.simulation.controllers import Backstepping, Controller, Pid, design_backstepping, pid_of_parts
from femfit.simulation.linear_loop import (
    LinearController,
    LinearPlant,
    linear_controller,
    linear_observer,
    linear_plant,
)
from femfit.simulation.margins import FREQUENCIES, Margins, margins, worst_of
from femfit.simulation.observers import DirectObserver
from femfit.simulation.operating_point import OperatingPoint, usable_coil_pole, zero_order_hold
from femfit.simulation.sensor import LoopSensor
from femfit.simulation.state_feedback import StateFeedback, pattern_search, regulator

SEARCH_FREQUENCIES = 120
"""Conventional: points of the frequency response while gains are sought; what is told has five times as many."""


T = TypeVar("T")
C = TypeVar("C", bound=Controller)


@dataclass(frozen=True, eq=False)
class Bench:
    """What a controller is judged in: points of rest with their linear plants, sensors and observer."""

    model: ActuatorModel
    points: tuple[OperatingPoint, ...]
    plants: tuple[LinearPlant, ...]
    sensors: tuple[LoopSensor, ...]
    observer: Filter | DirectObserver | None
    latency: int
    noisier: "Bench | None" = None  # With a filter that may run as well and passes on more of the sensors' noise

    @property
    def middle(self) -> int:
        """The point for which linear controllers are designed."""
        return len(self.points) // 2

    def judge(self, controller: Controller, points: int = FREQUENCIES) -> tuple[Margins, ...]:
        """Margins at each point, from a frequency response of so many points."""
        judged = []
        limits = limits_of(self.model)
        for point, plant, observer in zip(self.points, self.plants, self.observers, strict=True):
            law = linear_controller(self.model, point, controller, len(observer[0]))
            linear = LinearController(*observer, *law, self.latency)
            room = np.minimum(point.commands - limits[0], limits[1] - point.commands)
            judged.append(margins(plant, linear, self.model.sample_time_s, room, points))
        return tuple(judged)

    @cached_property
    def observers(self) -> tuple[tuple[FloatArray, FloatArray, FloatArray], ...]:
        """The observer at each point, linear."""
        return tuple(linear_observer(self.model, point, self.observer) for point in self.points)

    def growth(self, controller: Controller) -> float:
        """Rate in 1/s at which the loop's slowest motion grows at its worst point; below zero where it is stable."""
        return max(-point.slowest_pole_rad_s for point in self.judge(controller, SEARCH_FREQUENCIES))

    def score(self, controller: Controller) -> float:
        """Margins over the wanted ones, cut by too much noise and too slow a loop; below zero where it is unstable.

        One where all that is wanted is kept: more margin is not worth a slower loop.
        """
        worst = worst_of(self.judge(controller, SEARCH_FREQUENCIES))
        if not worst.stable:
            return worst.slowest_pole_rad_s * self.model.sample_time_s
        if self.noisier is not None:
            noisier = worst_of(self.noisier.judge(controller, SEARCH_FREQUENCIES))
            worst = replace(worst, noise_share=max(worst.noise_share, noisier.noise_share))
        rate = constants.SETTLING_PART * min(point.natural_rad_s for point in self.points)
        return worst.kept * min(1.0, worst.slowest_pole_rad_s / max(rate, 1e-300))


def make_bench(
    model: ActuatorModel,
    points: Sequence[OperatingPoint],
    sensors: Sequence[LoopSensor],
    observer: Filter | DirectObserver | None,
    latency: int = 0,
) -> Bench:
    """The nearest, the middle and the farthest point with their linear plants."""
    chosen = tuple(points[k] for k in sorted({0, len(points) // 2, len(points) - 1}))
    plants = [linear_plant(model, point, sensors) for point in chosen]
    if observer is None:  # every state is known at once, without noise
        order = model.order
        plants = [replace(plant, C=np.eye(order)[:, None], noise=np.zeros(order)) for plant in plants]
    return Bench(model, chosen, tuple(plants), tuple(sensors), observer, latency)


def tuned_regulator(bench: Bench) -> StateFeedback:
    """The fastest regulator that keeps the wanted margins, or the one that comes nearest to them, be it unstable."""
    point, plant = bench.points[bench.middle], bench.plants[bench.middle]
    return _fastest(bench, lambda bandwidth: regulator(bench.model, point, plant, bandwidth, bench.latency))


def tuned_backstepping(bench: Bench, points: Sequence[OperatingPoint]) -> Backstepping:
    """The gains of the model's own poles where they keep the wanted margins, else those of a bandwidth that does."""
    first = design_backstepping(bench.model, points)
    if (score := bench.score(first)) >= 1.0:
        return first
    best = _fastest(bench, lambda bandwidth: design_backstepping(bench.model, points, bandwidth))
    return near_the_best([(score, first), (bench.score(best), best)])


def _fastest(bench: Bench, made: Callable[[float], C]) -> C:
    """What is made for the highest bandwidth that keeps the wanted margins, or comes nearest to them."""
    highest = constants.USABLE_PART / bench.model.sample_time_s
    natural = max(point.natural_rad_s for point in bench.points)
    lowest = np.clip(
        constants.SLOWEST_OVER_BODY * natural,
        constants.SLOWEST_OVER_HIGHEST * highest,
        constants.NARROWEST_RANGE * highest,
    )
    tried: list[tuple[float, C]] = []
    for bandwidth in np.geomspace(highest, lowest, constants.BANDWIDTHS):
        if tried and tried[-1][0] >= 1.0:
            break
        try:
            controller = made(float(bandwidth))
        except DomainError:
            continue
        tried.append((bench.score(controller), controller))
    if not tried:
        raise DomainError(
            f"No controller was found: between {lowest:.4g} and {highest:.4g} rad/s no bandwidth keeps the loop. "
            "Use another controller, or a shorter sample time."
        )
    return max(tried, key=lambda scored: scored[0])[1]


def near_the_best(tried: Sequence[tuple[float, T]]) -> T:
    """The first of several whose score is :data:`NEARLY` the best; the best itself where none is above zero."""
    best = max(score for score, _ in tried)
    return next(candidate for score, candidate in tried if score >= min(best, constants.NEARLY * best))


def tuned_pid(bench: Bench) -> Pid:
    """Poles placed at the middle point; where that keeps too little margin, a search from there.

    What comes nearest to a stable loop is returned where none was found.
    """
    first = _start(bench)
    direction, current, parts = first.direction, first.current_gain_ohm, first.parts
    values = np.log(np.maximum([parts[name] for name in ("kp", "ki", "kd", "filter_rad_s")], 1e-9))

    def made(logs: FloatArray) -> Pid:
        kp, ki, kd, rate = np.exp(logs)
        return pid_of_parts(bench.model, float(kp), float(ki), float(kd), float(rate), current, direction)

    # The filter's pole cannot be faster than the samples
    highest = np.array([np.inf, np.inf, np.inf, np.log(constants.FASTEST_FILTER / bench.model.sample_time_s)])
    values = np.minimum(values, highest)
    return made(pattern_search(lambda logs: bench.score(made(logs)), values, highest, 1.0))


def _start(bench: Bench) -> Pid:
    model, point = bench.model, bench.points[bench.middle]
    try:
        return design_pid(model, point)
    except DomainError:
        pass
    # No room for four equal poles: more force than the unstable pole asks for, damped at the body's own rate
    current = inner_current_gain(model, point)
    A, B = reduced(model, point, current)
    coil, rate = -A[2, 2], max(point.natural_rad_s, constants.SLOWEST_OVER_HIGHEST * usable_coil_pole(model, point))
    per_command = abs(A[1, 2] * B[2]) / coil
    kp = constants.FIRST_STIFFNESS * (rate**2 + coil * rate) / per_command
    ki, kd = constants.FIRST_INTEGRAL * rate * kp, constants.FIRST_DAMPING * kp / rate
    along = tuple(point.direction.tolist())
    return pid_of_parts(model, kp, ki, kd, constants.FIRST_FILTER * rate, current, along)


def inner_current_gain(model: ActuatorModel, point: OperatingPoint) -> float:
    """Gain in ohm of a loop of the current that makes a coil fast enough for the body; zero where it is so itself."""
    if point.coil_pole_rad_s >= constants.SLOW_COIL * point.unstable_pole_rad_s:
        return 0.0
    wanted = min(constants.WANTED_COIL * point.unstable_pole_rad_s, constants.USABLE_PART / model.sample_time_s)
    return max(0.0, float(model.resistances_ohm.max()) * (wanted / point.coil_pole_rad_s - 1.0))


def reduced(
    model: ActuatorModel, point: OperatingPoint, current_gain_ohm: float = 0.0
) -> tuple[FloatArray, FloatArray]:
    """Distance, velocity and the current along the controller's direction: A (3, 3) and B (3,).

    Of one circuit it is the point's own model; of several that of a current shared so; of an amplifier its bandwidth. A
    loop of the current makes the coil faster.
    """
    amplified, along = bool(commands_currents(model).any()), point.direction
    share = along if amplified else along / model.resistances_ohm  # currents at rest for such a command
    unit = share / (share @ share)
    A = np.zeros((3, 3))
    A[:2, :2] = point.A[:2, :2]
    A[1, 2] = point.A[1, 2:] @ share
    if amplified:
        pole = usable_coil_pole(model, point)
        A[2, 2] = -pole
        return A, np.array([0.0, 0.0, pole])
    inner = current_gain_ohm / model.resistances_ohm
    A[2, 1] = unit @ point.A[2:, 1]
    A[2, 2] = unit @ (point.A[2:, 2:] - current_gain_ohm * point.B[2:]) @ share
    return A, np.array([0.0, 0.0, float(unit @ point.B[2:] @ ((1.0 + inner) * along))])


def design_pid(model: ActuatorModel, point: OperatingPoint, bandwidth_rad_s: float | None = None) -> Pid:
    """Gains by pole placement at one operating point.

    With the plant's G = c/A held over a sample (orders 2 and 3) the closed loop is

        A(z) (z - 1)(z - p) + c(z) (b_0 z^2 + b_1 z + b_2) = (z - q)^4 (z - q_5).

    Its coefficients are linear in p, b_0, b_1, b_2 and q_5: for a wanted quadruple pole q = exp(-w t_s) they follow
    from one 5 x 5 system. In continuous time, with the coil's pole p_c and the derivative filter's N, equal powers of s
    give 10 w^2 - 4 (p_c + N) w + N p_c - lambda^2 = 0, and a choice of N picks w
    unless it is given.

    References
    ----------
    K. J. Astrom and B. Wittenmark, Computer-Controlled Systems (Prentice Hall, 1997), chapter 5.
    """
    step, current = model.sample_time_s, inner_current_gain(model, point)
    A, B = reduced(model, point, current)
    coil = min(-float(A[2, 2]), constants.USABLE_PART / step) if current else usable_coil_pole(model, point)
    unstable = point.unstable_pole_rad_s
    derivative = constants.DERIVATIVE_FILTER_RATIO * coil
    half = 4.0 * (coil + derivative)
    w = (half - np.sqrt(half**2 - 40.0 * (derivative * coil - unstable**2))) / 20.0
    w = w if bandwidth_rad_s is None else bandwidth_rad_s
    if w <= 0.0:
        raise DomainError(
            f"Four equal poles need a coil that is faster than the body; at {1e3 * point.distance_m:g} mm R/L is "
            f"{coil:.4g} rad/s, the body's unstable pole {unstable:.4g} rad/s. Use backstepping or state feedback, "
            "which feed back the current, or a coil with less inductance."
        )
    phi, gamma = zero_order_hold(A, B, step)
    a = np.poly(phi).real
    c = np.poly(phi - np.outer(gamma, [1.0, 0.0, 0.0])).real - a  # c(z) of distance/command, order 2
    integrated = np.polymul(a, [1.0, -1.0])
    wanted = np.poly(np.full(4, np.exp(-w * step)))
    columns = np.zeros((5, 5))
    columns[:, 0] = -integrated
    for power in range(3):
        shifted = np.polymul(c[1:], np.eye(3)[power])
        columns[5 - len(shifted) :, 1 + power] = shifted
    columns[:, 4] = wanted
    right = np.polymul(wanted, [1.0, 0.0])[1:] - np.polymul(integrated, [1.0, 0.0])[1:]
    p, b0, b1, b2, _ = np.linalg.solve(columns, right)
    return Pid(model, float(p), (float(b0), float(b1), float(b2)), tuple(point.direction.tolist()), current)
