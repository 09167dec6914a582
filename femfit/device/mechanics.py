"""What acts on the moving part beside the magnetic force, in SI units.

Limits in a field's metadata are what a model file is held to: see :mod:`femfit.model.json_section`. Forces here are
positive along growing distance, as gravity is on a body that hangs: m d'' = sum of them - F(d, i).
"""

from dataclasses import dataclass, field, replace

import numpy as np
from casadi import SX

from femfit.core.graph import Expression, row_of
from femfit.core.numerics import GRAVITY, FloatArray


@dataclass(frozen=True)
class Spring:
    """A linear spring: force along growing distance preload - stiffness (d - distance)."""

    stiffness_N_per_m: float
    preload_N: float = 0.0  # At the distance below; positive pushes the parts apart
    distance_m: float = 0.0


@dataclass(frozen=True)
class ForceTable:
    """A measured force along growing distance, interpolated linearly and continued by its last value."""

    distances_m: tuple[float, ...] = field(metadata={"ascending": True})
    forces_N: tuple[float, ...] = field(metadata={"like": "distances_m"})


@dataclass(frozen=True)
class Stop:
    """An end of the travel."""

    distance_m: float
    # Velocity after an impact over that before it
    restitution: float = field(default=0.0, metadata={"lower": 0.0, "upper": 1.0})
    stiffness_N_per_m: float | None = field(default=None, metadata={"positive": True})  # None: rigid


@dataclass(frozen=True)
class Mechanics:
    """The moving mass and everything mechanical that acts on it."""

    mass_kg: float = field(metadata={"positive": True})
    gravity_m_s2: float = GRAVITY  # Along growing distance: negative where the body stands on the fixed part's side
    springs: tuple[Spring | ForceTable, ...] = ()
    viscous_N_s_per_m: float = field(default=0.0, metadata={"lower": 0.0})
    coulomb_N: float = field(default=0.0, metadata={"lower": 0.0})  # Dry friction, the same sliding and sticking
    load_N: float = 0.0  # A constant force along growing distance
    near_stop: Stop | None = None  # At the least distance
    far_stop: Stop | None = None

    def static_force(self, distance: FloatArray) -> FloatArray:
        """Weight, springs and load at distances in m of any shape: along growing distance, in N.

        It is what the magnetic force balances where the body is at rest.
        """
        return self.mass_kg * self.gravity_m_s2 + np.zeros(np.shape(distance)) + self.beside_weight(distance)

    def static_gradient(self, distance: FloatArray) -> FloatArray:
        """Slope of :meth:`static_force` in N/m."""
        slope = np.zeros(np.shape(distance))
        for spring in self.springs:
            slope = slope + spring_gradient(spring, distance)
        return slope

    def friction(self, velocity: Expression, sample_time_s: float) -> Expression:
        """Friction's force along growing distance in N, for equations that are solved in steps.

        Dry friction is F tanh(v / v_0): v_0 is the speed that it takes from the body within one sample, so that it
        stops a body and does not throw it back.
        """
        force = -self.viscous_N_s_per_m * velocity
        if self.coulomb_N:
            force = force - self.coulomb_N * np.tanh(velocity / self._creep(sample_time_s))
        return force

    def acceleration(
        self, distance: Expression, velocity: Expression, force: Expression, sample_time_s: float
    ) -> Expression:
        """Acceleration along growing distance in m/s^2 under a magnetic force in N; stops are not part of it."""
        beside = self.beside_weight(distance)
        if self.viscous_N_s_per_m or self.coulomb_N:
            beside = beside + self.friction(velocity, sample_time_s)
        return self.gravity_m_s2 + (beside - force) / self.mass_kg

    def force_to_accelerate(
        self, distance: FloatArray, velocity: FloatArray | float, acceleration: FloatArray | float
    ) -> FloatArray:
        """The magnetic force in N for which the body has an acceleration in m/s^2, dry friction left aside."""
        inertia = self.mass_kg * (self.gravity_m_s2 - np.asarray(acceleration))
        return inertia + (self.beside_weight(distance) - self.viscous_N_s_per_m * np.asarray(velocity))

    @property
    def ends(self) -> tuple[float, float]:
        """Distances of the stops in m; infinite where there is none."""
        near, far = self.near_stop, self.far_stop
        return -np.inf if near is None else near.distance_m, np.inf if far is None else far.distance_m

    def with_ends(self, near_m: float, far_m: float) -> "Mechanics":
        """The same with its stops elsewhere; one that is not there stays away."""
        near = None if self.near_stop is None else replace(self.near_stop, distance_m=near_m)
        far = None if self.far_stop is None else replace(self.far_stop, distance_m=far_m)
        return replace(self, near_stop=near, far_stop=far)

    def beside_weight(self, distance: Expression) -> Expression:
        """Springs and load along growing distance, in N."""
        return self.push_of_springs(distance) + self.load_N if self.springs else self.load_N

    def push_of_springs(self, distance: Expression) -> Expression:
        """All springs along growing distance, in N."""
        return sum(spring_force(spring, distance) for spring in self.springs) + 0.0 * distance

    def energy_of_springs(self, distance: Expression) -> Expression:
        """Energy of all springs in J at distances in m of any shape, or of an expression."""
        return sum(spring_energy(spring, distance) for spring in self.springs) + 0.0 * distance

    def _creep(self, sample_time_s: float) -> float:
        return self.coulomb_N * sample_time_s / self.mass_kg


def spring_force(spring: Spring | ForceTable, distance: Expression) -> Expression:
    """Force of a spring along growing distance, in N."""
    if isinstance(spring, Spring):
        return spring.preload_N - spring.stiffness_N_per_m * (distance - spring.distance_m)
    way, _, force, slope = _piece(spring, distance)
    return force + slope * way


def spring_gradient(spring: Spring | ForceTable, distance: FloatArray) -> FloatArray:
    """Slope of :func:`spring_force` in N/m; of a table, that of the piece above each distance."""
    if isinstance(spring, Spring):
        return np.full(np.shape(distance), -spring.stiffness_N_per_m)
    return np.asarray(_piece(spring, distance)[3])


def spring_energy(spring: Spring | ForceTable, distance: Expression) -> Expression:
    """Energy of a spring in J, from nought at its distance or at the first one of its table."""
    if isinstance(spring, Spring):
        stretched = distance - spring.distance_m
        return 0.5 * spring.stiffness_N_per_m * stretched**2 - spring.preload_N * stretched
    way, done, force, slope = _piece(spring, distance)
    return -(done + force * way + 0.5 * slope * way**2)


def _piece(table: ForceTable, distance: Expression) -> tuple[Expression, Expression, Expression, Expression]:
    """The way from the lower end of each distance's piece, and there the work done, the force and its slope."""
    at, force = np.asarray(table.distances_m), np.asarray(table.forces_N)
    work = np.concatenate([[0.0], np.cumsum(0.5 * (force[1:] + force[:-1]) * np.diff(at))])
    slopes = np.concatenate([[0.0], np.diff(force) / np.diff(at), [0.0]])
    rows = np.stack([*(np.concatenate([x[:1], x]) for x in (at, work, force)), slopes], axis=1)
    if isinstance(distance, SX):
        row = row_of(rows, [at], [distance])
        return distance - row[0], row[1], row[2], row[3]
    start, done, push, slope = np.moveaxis(rows[at.searchsorted(distance, "right")], -1, 0)
    return distance - start, done, push, slope
