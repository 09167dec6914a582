"""What acts on the moving part beside the magnetic force, in SI units; numpy alone.

Forces here are positive along growing distance, as gravity is on a body that hangs: m d'' = sum of them - F(d, i).
"""

from dataclasses import dataclass

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.core.constants import GRAVITY


@dataclass(frozen=True)
class Spring:
    """A linear spring: force along growing distance preload - stiffness (d - distance)."""

    stiffness_N_per_m: float
    preload_N: float = 0.0  # At the distance below; positive pushes the parts apart
    distance_m: float = 0.0


@dataclass(frozen=True)
class ForceTable:
    """A measured force along growing distance, interpolated linearly and continued by its last value."""

    distances_m: tuple[float, ...]  # Ascending
    forces_N: tuple[float, ...]


@dataclass(frozen=True)
class Stop:
    """An end of the travel."""

    distance_m: float
    restitution: float = 0.0  # Velocity after an impact over that before it, 0 to 1
    stiffness_N_per_m: float | None = None  # None: rigid


@dataclass(frozen=True)
class Mechanics:
    """The moving mass and everything mechanical that acts on it."""

    mass_kg: float
    gravity_m_s2: float = GRAVITY  # Along growing distance: negative where the body stands on the fixed part's side
    springs: tuple[Spring | ForceTable, ...] = ()
    viscous_N_s_per_m: float = 0.0
    coulomb_N: float = 0.0  # Dry friction, the same sliding and sticking
    load_N: float = 0.0  # A constant force along growing distance
    near_stop: Stop | None = None  # At the least distance
    far_stop: Stop | None = None

    def static_force(self, distance: FloatArray) -> FloatArray:
        """Weight, springs and load at distances in m of any shape: along growing distance, in N."""
        force = np.full(np.shape(distance), self.mass_kg * self.gravity_m_s2 + self.load_N)
        for spring in self.springs:
            force = force + spring_force(spring, distance)
        return force

    def static_gradient(self, distance: FloatArray) -> FloatArray:
        """Slope of :meth:`static_force` in N/m."""
        slope = np.zeros(np.shape(distance))
        for spring in self.springs:
            slope = slope + spring_gradient(spring, distance)
        return slope


def spring_force(spring: Spring | ForceTable, distance: FloatArray) -> FloatArray:
    """Force of a spring along growing distance, in N."""
    if isinstance(spring, ForceTable):
        return np.asarray(np.interp(distance, spring.distances_m, spring.forces_N))
    return spring.preload_N - spring.stiffness_N_per_m * (np.asarray(distance) - spring.distance_m)


def spring_gradient(spring: Spring | ForceTable, distance: FloatArray) -> FloatArray:
    """Slope of :func:`spring_force` in N/m; of a table, that of the piece above each distance."""
    if isinstance(spring, Spring):
        return np.full(np.shape(distance), -spring.stiffness_N_per_m)
    at, force = np.asarray(spring.distances_m), np.asarray(spring.forces_N)
    slopes = np.concatenate([[0.0], np.diff(force) / np.diff(at), [0.0]])
    return np.asarray(slopes[np.searchsorted(at, distance, side="right")])
