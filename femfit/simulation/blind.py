"""How far a sensor that is blind for the body limits every loop.

A zero z of the reading over the command that lies in the unstable half plane, beside an unstable pole p of the body,
bounds the sensitivity of any controller at all, |S| >= |(z + p) / (z - p)| at a frequency, and so the modulus margin
1 / max |S| from above. A Hall element beside its coil has such zeros where the coil's own field outweighs what the body
adds to it.

Why no controller of a kind was found: what stands against it, and which other one is stable in its place.

What is kept of the samples of one window of a batch of loops.

References
----------
S. Skogestad and I. Postlethwaite, Multivariable Feedback Control (Wiley, 2005), section 5.3.
"""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from femfit.core.errors import DomainError
from femfit.core.numerics import BoolArray, ComplexArray, FloatArray
from femfit.core.text import amount, counted
from femfit.estimate.noise import ConsistencyBand, consistency_band
from femfit.simulation.linear_loop import LinearPlant
from femfit.simulation.tune import Bench

if TYPE_CHECKING:
    from femfit.simulation.design import ControllerName, LoopDesign


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


def why_none(design: "LoopDesign", name: "ControllerName", bench: "Bench") -> str:
    """What is said where no controller of this name is stable; others are advised only where they are."""
    points = design.points
    unstable = max(point.unstable_pole_rad_s for point in points)
    slowest = min(point.coil_pole_rad_s for point in points)
    start = (
        f"No {name} was found that keeps this body at rest from the nearest to the farthest distance of the reference: "
    )
    rivals: list[ControllerName] = ["backstepping", "state-feedback"]
    stable = [rival for rival in rivals if rival != name and _is_stable(design, rival, bench)]
    instead = f"{' or '.join(stable)}, which feeds back the current, or " if stable else ""
    late = design.latency * design.model.sample_time_s
    if design.latency and not replace(design, latency=0, given={}).why_no(name):
        return (
            f"{start}the latency of {counted(design.latency, 'sample')}, {amount(late, 's')}, stands against it, since "
            f"without it there is one. Use {instead}a shorter latency."
        )
    between = f", the latency {amount(late, 's')}" if late else ""
    return (
        f"{start}its unstable pole at constant current is {unstable:.4g} rad/s, the coil's R/L {slowest:.4g} rad/s, "
        f"the sample time {amount(design.model.sample_time_s, 's')}{between}. Use {instead}a faster coil, sensors with "
        "less delay, or reference distances that are nearer to each other."
    )


def _is_stable(design: "LoopDesign", name: "ControllerName", bench: "Bench") -> bool:
    try:
        return bench.growth(design.controller(name)) < 0.0
    except DomainError:
        return False


@dataclass(frozen=True, eq=False)
class WindowStatistics:
    """Over the samples of one window, each of shape (runs,); NaN for runs lost before the window's end."""

    estimate_rms_m: FloatArray  # sqrt(mean((estimated - true distance)^2))
    estimate_bias_m: FloatArray
    tracking_rms_m: FloatArray
    tracking_bias_m: FloatArray
    normalised_innovation_squared: FloatArray  # Mean over the readings; 1 is expected of a true filter
    readings: FloatArray  # How many a filter took, of all sensors; 0 without one

    def consistency(self, runs: BoolArray) -> tuple[float, ConsistencyBand]:
        """Mean of the normalised innovations squared of some runs, NaN where there are none, and its 95 % band."""
        count = np.where(runs & (self.readings > 0.0), self.readings, 0.0)
        total = int(count.sum())
        mean = (
            np.sum(np.where(count > 0.0, self.normalised_innovation_squared * count, 0.0)) / total if total else np.nan
        )
        return float(mean), consistency_band(max(1, total))


def window_statistics(
    sums: FloatArray, window: slice, lost_at: FloatArray, step: float, steps: int
) -> WindowStatistics:
    """From sums over the samples: squared error, error, both of the deviation, normalised innovations, readings."""
    stop = min(window.stop, steps)
    mean = np.where(lost_at >= stop * step - 0.5 * step, sums, np.nan) / (stop - window.start)
    with np.errstate(invalid="ignore"):
        quality = mean[4] / mean[5]
    return WindowStatistics(np.sqrt(mean[0]), mean[1], np.sqrt(mean[2]), mean[3], quality, sums[5])
