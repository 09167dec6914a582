"""How far a sensor that is blind for the body limits every loop.

A zero z of the reading over the command that lies in the unstable half plane, beside an unstable pole p of the body,
bounds the sensitivity of any controller at all, |S| >= |(z + p) / (z - p)| at a frequency, and so the modulus margin
1 / max |S| from above. A Hall element beside its coil has such zeros where the coil's own field outweighs what the body
adds to it.

References
----------
S. Skogestad and I. Postlethwaite, Multivariable Feedback Control (Wiley, 2005), section 5.3.
"""

from dataclasses import dataclass

import numpy as np

from femfit.core.numerics import ComplexArray
from femfit.simulation.linear_loop import LinearPlant
from femfit.simulation.tune import Bench


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
