"""Numbers that are said of a closed loop, by one loop and by a study of many: rows, design, margins and their bound.

A zero z of the reading over the command that lies in the unstable half plane, beside an unstable pole p of the body,
bounds the sensitivity of any controller at all, |S| >= |(z + p) / (z - p)| at a frequency, and so the modulus margin
1 / max |S| from above. A Hall element beside its coil has such zeros where the coil's own field outweighs what the body
adds to it.

References
----------
S. Skogestad and I. Postlethwaite, Multivariable Feedback Control (Wiley, 2005), section 5.3.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from math import isfinite
from typing import Any

import numpy as np

from femfit.core.errors import DomainError, FilterError
from femfit.core.files import json_ready
from femfit.core.numerics import ComplexArray, FloatArray
from femfit.estimate.noise import ConsistencyBand
from femfit.simulation.constants import LESS_NOISE, NEARLY, WANTED_MODULUS
from femfit.simulation.controllers import ControllerName
from femfit.simulation.design import LoopDesign, keeping_margins
from femfit.simulation.experiment import Experiment
from femfit.simulation.linear_loop import LinearPlant
from femfit.simulation.margins import Margins, worst_of
from femfit.simulation.tune import Bench

SEEN = 2.0
"""Derived: standard errors beyond which a mean is more than chance, 95 %."""


@dataclass(frozen=True, eq=False)
class StepSeries:
    """One recorded run over reference steps."""

    controller: str
    observer: str
    time_s: FloatArray
    reference_m: FloatArray
    true_m: FloatArray
    direct_m: FloatArray
    estimated_m: FloatArray
    voltage_V: FloatArray
    current_A: FloatArray


@dataclass(frozen=True)
class StepRow:
    """How well one measurement follows the true distance over the reference steps."""

    controller: str
    measurement: str  # ``direct`` or the filter that feeds the loop
    rms_m: float  # Over the runs that were held; NaN if none was
    held: int
    runs: int


@dataclass(frozen=True)
class HoldRow:
    """Direct against filtered noise at rest."""

    controller: str
    filter: str
    distance_m: float
    direct_rms_m: float
    filtered_rms_m: float
    # Direct over filtered rms, and 1/sqrt(2 lambda t_s), which no filter of white noise passes
    ratio: float
    bound: float
    normalised_innovation_squared: float
    innovation_band: ConsistencyBand  # 95 % for the mean of the normalised innovations squared
    held: int
    runs: int


@dataclass(frozen=True)
class FaultRow:
    """How the runs of one experiment ended, with the means of those that were held."""

    experiment: Experiment
    runs: int
    outcomes: Mapping[str, int]  # Number of runs by the name of their :class:`~femfit.simulation.loop.LoopOutcome`
    last_loss_s: float | None  # When the last of the lost runs was lost
    # Estimated minus true distance, and true distance minus reference; NaN if no run was held
    estimate_rms_m: float
    estimate_bias_m: float
    position_bias_m: float
    # How far the body moved against the loop without the fault on the same noise, and the standard error of that; NaN
    # without such a loop, or if fewer than two runs were held in both
    position_shift_m: float
    shift_error_m: float

    @property
    def held(self) -> int:
        """Number of runs that were held."""
        return self.outcomes.get("HELD", 0)

    @property
    def moved(self) -> bool:
        """Whether the shift is more than chance."""
        return abs(self.position_shift_m) > SEEN * self.shift_error_m


@dataclass(frozen=True, eq=False)
class SpectrumPair:
    """Amplitudes of direct and filtered distance at rest, so that a sine of amplitude a shows a peak of height a."""

    controller: str
    frequency_Hz: FloatArray
    direct_m: FloatArray
    filtered_m: FloatArray


@dataclass(frozen=True)
class BlindBound:
    """An upper bound on the modulus margin of any controller, by the zero that lies nearest to a pole."""

    distance_m: float
    zero_rad_s: float
    pole_rad_s: float
    modulus: float


def blind_bound(bench: Bench) -> BlindBound | None:
    """The bound of a loop of one sensor and one command; None of any other, and where no zero and pole make one."""
    step, bounds = bench.model.sample_time_s, []
    for point, plant in zip(bench.points, bench.plants, strict=True):
        if len(plant.C) != 1 or plant.B.shape[1] != 1:
            return None
        poles = _unstable(np.linalg.eigvals(plant.A).astype(np.complex128))
        for zero in _unstable(zeros_of(plant)):
            each = np.abs((zero - poles) / (1.0 - poles.conj() * zero))
            if each.size:
                zero_rate, pole_rate = (float(abs(np.log(root)) / step) for root in (zero, poles[np.argmin(each)]))
                bounds.append(BlindBound(point.distance_m, zero_rate, pole_rate, float(np.prod(each))))
    return min(bounds, key=lambda bound: bound.modulus, default=None)


def zeros_of(plant: LinearPlant) -> ComplexArray:
    """Zeros of the reading over the command, of det(z - A + B C) - det(z - A) for each of the reading's samples."""
    poles, late = np.poly(plant.A), plant.C.shape[1]
    above = np.zeros(len(poles) + late - 1)
    for k, row in enumerate(plant.C[0]):
        above[k : k + len(poles)] += np.poly(plant.A - plant.B @ row[None]).real - poles.real
    return np.roots(np.trim_zeros(np.where(np.abs(above) > 1e-13 * np.abs(above).max(), above, 0.0))).astype(complex)


def _unstable(roots: ComplexArray) -> ComplexArray:
    return np.asarray(roots[np.abs(roots) > 1.0], dtype=np.complex128)


@dataclass(frozen=True)
class JudgedLoop:
    """A linear loop at its worst point of rest."""

    controller: ControllerName
    observer: str
    margins: Margins | None  # None where there are none
    refusal: str = ""  # Why there are none
    # Where the margins are thin: what no controller with this sensor passes, where that is less than what is aimed at
    bound: BlindBound | None = None
    # And what the same controller, designed anew, keeps without one of what may take margins, the best first
    raised: tuple[tuple[str, Margins], ...] = ()


def judged_loop(design: LoopDesign, name: ControllerName, observer: str) -> JudgedLoop:
    """The margins of a loop; where they are thin, what takes them."""
    try:
        worst = worst_of(design.margins(name, observer))  # type: ignore[arg-type]
    except (DomainError, FilterError) as error:
        return JudgedLoop(name, observer, None, str(error))
    if not worst.thin:
        return JudgedLoop(name, observer, worst)
    bound = blind_bound(design.bench("ekf"))
    quieter = replace(design, noise={sensor: LESS_NOISE * white for sensor, white in design.noise.items()})
    ways = {"less-noise": (keeping_margins(quieter), observer), "exact-state": (design, "exact")}
    if observer.endswith("4"):
        ways["known-offset"] = design, observer[:-1]
    if design.latency:
        ways["no-latency"] = keeping_margins(replace(design, latency=0)), observer
    raised = []
    for way, (better, by) in ways.items():
        try:
            margins = worst_of(better.margins(name, by))  # type: ignore[arg-type]
        except (DomainError, FilterError):
            continue
        if margins.stable and NEARLY * margins.kept > worst.kept:
            raised.append((way, margins))
    raised.sort(key=lambda pair: pair[1].kept, reverse=True)
    within = bound if bound is not None and bound.modulus < WANTED_MODULUS else None
    return JudgedLoop(name, observer, worst, bound=within, raised=tuple(raised))


def consistency(holds: Sequence[HoldRow]) -> dict[str, int]:
    """How many filters' predictions are as wrong as they expect: inside of their 95 % band, below and above it."""
    judged = [row for row in holds if isfinite(row.normalised_innovation_squared)]
    below = sum(row.normalised_innovation_squared < row.innovation_band.lower for row in judged)
    above = sum(row.normalised_innovation_squared > row.innovation_band.upper for row in judged)
    return {"inside": len(judged) - below - above, "below": below, "above": above}


_OF_BACKSTEPPING = {
    "position_gain_1_s2": "position_gain",
    "velocity_gain_1_s": "velocity_gain",
    "current_gain_ohm": "current_gain_ohm",
}
_OF_POINT = ("distance_m", "currents_A", "commands", "unstable_pole_rad_s", "coil_pole_rad_s")


def design_data(design: LoopDesign, loops: Sequence[tuple[ControllerName, str]] = ()) -> dict[str, Any]:
    """Reference, gains, margins and operating points, ready for JSON."""
    backstepping = design.controller("backstepping")
    pid, feedback = (None if design.why_no(name) else design.controller(name) for name in ("pid", "state-feedback"))
    margins = {loop: worst_of(design.margins(*loop)) for loop in loops}  # type: ignore[arg-type]
    return {
        "sensors": list(design.sensors),
        "noise": dict(design.noise),
        "latency_samples": design.latency,
        "targets_m": list(design.targets_m),
        "reference_rate_rad_s": design.reference_rate_rad_s,
        "backstepping": {key: getattr(backstepping, name) for key, name in _OF_BACKSTEPPING.items()},
        "pid": pid and {**pid.parts, **{name: json_ready(getattr(pid, name)) for name in ("filter_pole", "gains")}},
        "no_pid": design.why_no("pid"),
        "state_feedback": feedback and {name: getattr(feedback, name).tolist() for name in ("gains", "integral")},
        "no_state_feedback": design.why_no("state-feedback"),
        "margins": [
            {"controller": name, "observer": observer, **json_ready(asdict(worst))}
            for (name, observer), worst in margins.items()
        ],
        "points": [{name: np.array(getattr(point, name)).tolist() for name in _OF_POINT} for point in design.points],
    }
