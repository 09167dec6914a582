"""Gains of controllers: found by what the sampled loop can stand, over the whole reference.

A candidate is judged at the nearest, the middle and the farthest point of rest by the least phase margin and modulus
margin (the distance of the loop's gain from -1) over those that are wanted, the largest share of the commands' room
that the sensors' noise takes with any of the filters that may run, and how fast the loop's slowest motion decays.
Wanted is the fastest one that keeps :data:`WANTED_PHASE_DEG`, :data:`WANTED_MODULUS`, :data:`NOISE_ROOM` and
:data:`SETTLING_PART`; where none does, the one that comes nearest.

References
----------
K. J. Astrom and T. Hagglund, Advanced PID Control (ISA, 2006), section 4.3: robustness by the maximum sensitivity.
R. Hooke and T. A. Jeeves, J. ACM 8 (1961) 212: the search by patterns.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from femfit.core.errors import DomainError
from femfit.core.numerics import FloatArray
from femfit.model.actuator_model import ActuatorModel
from femfit.simulation import constants
from femfit.simulation.controllers import Controller, ControllerName, Pid
from femfit.simulation.gains import design_backstepping, design_pid, first_pid, regulator
from femfit.simulation.linear_loop import Rest
from femfit.simulation.margins import FREQUENCIES, Margins, margins, worst_of
from femfit.simulation.operating_point import OperatingPoint

SEARCH_FREQUENCIES = 120
"""Conventional: points of the frequency response while gains are sought; what is told has five times as many."""

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class Bench:
    """What a controller is judged in: points of rest with their linear plants, sensors and observer."""

    model: ActuatorModel
    points: tuple[OperatingPoint, ...]  # From the nearest to the farthest
    rests: tuple[Rest, ...]  # The nearest, the middle and the farthest of them
    latency: int
    noisier: "Bench | None" = None  # With a filter that may run as well and passes on more of the sensors' noise

    def judge(self, controller: Controller, points: int = FREQUENCIES) -> tuple[Margins, ...]:
        """Margins at each point, from a frequency response of so many points."""
        step, latency = self.model.sample_time_s, self.latency
        return tuple(
            margins(rest.plant, rest.closed_by(controller, latency), step, rest.room, points) for rest in self.rests
        )

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
        rate = constants.SETTLING_PART * min(rest.point.natural_rad_s for rest in self.rests)
        return worst.kept * min(1.0, worst.slowest_pole_rad_s / max(rate, 1e-300))

    def designed(self, name: ControllerName, bandwidth_rad_s: float) -> Controller:
        """The controller of this name for a bandwidth."""
        middle = self.rests[len(self.rests) // 2]
        if name == "backstepping":
            return design_backstepping(self.model, self.points, bandwidth_rad_s)
        if name == "pid":
            return design_pid(self.model, middle.point, bandwidth_rad_s)
        return regulator(self.model, middle.point, middle.plant, bandwidth_rad_s, self.latency)

    def tuned(self, name: ControllerName) -> Controller:
        """The fastest controller that keeps the wanted margins, or what comes nearest to a stable one."""
        if name == "pid":
            return self._searched()
        if name == "state-feedback":
            return self._fastest(name)[1]
        # The gains of the model's own poles where they keep the margins
        first = design_backstepping(self.model, self.points)
        if (score := self.score(first)) >= 1.0:
            return first
        return near_the_best([(score, first), self._fastest(name)])

    def _fastest(self, name: ControllerName) -> tuple[float, Controller]:
        """That of the highest bandwidth that keeps the wanted margins, or comes nearest to them, and its score."""
        highest = constants.USABLE_PART / self.model.sample_time_s
        natural = max(rest.point.natural_rad_s for rest in self.rests)
        lowest = np.clip(
            constants.SLOWEST_OVER_BODY * natural,
            constants.SLOWEST_OVER_HIGHEST * highest,
            constants.NARROWEST_RANGE * highest,
        )
        tried: list[tuple[float, Controller]] = []
        for bandwidth in np.geomspace(highest, lowest, constants.BANDWIDTHS).tolist():
            try:
                controller = self.designed(name, bandwidth)
            except DomainError:
                continue
            tried.append((self.score(controller), controller))
            if tried[-1][0] >= 1.0:
                break
        if not tried:
            raise DomainError(
                f"No controller was found: between {lowest:.4g} and {highest:.4g} rad/s no bandwidth keeps the loop. "
                "Use another controller, or a shorter sample time."
            )
        return max(tried, key=lambda scored: scored[0])

    def _searched(self) -> Pid:
        """Poles placed at the middle point; where that keeps too little margin, a search from there.

        It climbs by one coordinate after the other, and along what the last round changed, with steps that shrink.
        """
        first = first_pid(self.model, self.rests[len(self.rests) // 2].point)
        names = ("kp", "ki", "kd", "filter_rad_s")
        # The filter's pole cannot be faster than the samples
        highest = np.array([np.inf, np.inf, np.inf, np.log(constants.FASTEST_FILTER / self.model.sample_time_s)])

        def made(logs: FloatArray) -> Pid:
            return first.with_parts(dict(zip(names, np.exp(logs).tolist(), strict=True)))

        def scored(logs: FloatArray) -> tuple[float, FloatArray]:
            logs = np.minimum(logs, highest)
            return self.score(made(logs)), logs

        best, values = scored(np.log(np.maximum([first.parts[name] for name in names], 1e-9)))
        step = np.log(constants.FIRST_FACTOR)
        while step > np.log(constants.LAST_FACTOR) and best < 1.0:
            before = values
            for way in np.eye(len(names)):
                for sign in (1.0, -1.0):
                    reached, tried = scored(values + sign * step * way)
                    if reached > best + 1e-9:
                        best, values = reached, tried
                        break
            if np.array_equal(values, before):
                step *= 0.5
                continue
            reached, tried = scored(2.0 * values - before)
            if reached > best:
                best, values = reached, tried
        return made(values)


def near_the_best(tried: Sequence[tuple[float, T]]) -> T:
    """The first of several whose score is :data:`NEARLY` the best; the best itself where none is above zero."""
    best = max(score for score, _ in tried)
    return next(candidate for score, candidate in tried if score >= min(best, constants.NEARLY * best))
