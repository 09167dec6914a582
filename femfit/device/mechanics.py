"""What acts on the moving part beside the magnetic force, in SI units, as the actuator file and a model file say it.

Forces here are positive along growing distance, as gravity is on a body that hangs: m d'' = sum of them - F(d, i).
"""

import math
from collections.abc import Callable
from dataclasses import field, replace
from typing import Any, ClassVar, Literal

import numpy as np
from casadi import SX

from femfit.core.graph import Expression, row_of
from femfit.core.numerics import GRAVITY, FloatArray
from femfit.device.keys import FORCE, LENGTH, POINTS, Entry, Record, key, scaled


class Spring(Record, kw_only=False):
    """``[mechanics.springs.NAME]``: force along growing distance preload - stiffness (d - distance)."""

    stiffness_N_per_m: float = key("the stiffness in N/mm, or distance_mm and force_N as measured", **FORCE)
    preload_N: float = key("the force at preload_at_mm; positive pushes the parts apart", 0.0, **FORCE)
    distance_m: float = key("the distance at which the spring has its preload", 0.0, file="preload_at_mm", **LENGTH)

    @classmethod
    def derived(cls, entry: Entry, complain: Callable[..., None]) -> dict[str, Any]:
        """Nothing; a preload has its distance."""
        if entry.preload_N and "preload_at_mm" not in entry.stated:
            complain("preload")
        return {}


class ForceTable(Record, kw_only=False):
    """A measured force along growing distance, interpolated linearly and continued by its last value."""

    distances_m: tuple[float, ...] = key(
        "ascending distances of a measured force", file="distance_mm", count=POINTS, ascending=True, **LENGTH
    )
    forces_N: tuple[float, ...] = key(
        "the forces at distance_mm; positive pushes the parts apart", file="force_N", count=POINTS, like="distance_mm"
    )


class Stop(Record, kw_only=False):
    """``[mechanics.near_stop]`` and ``[mechanics.far_stop]``: an end of the travel."""

    distance_m: float = key("the distance at which the body meets the stop", **LENGTH)
    restitution: float = key("the velocity after an impact over that before, 0 for no bounce", 0.0, ge=0, lt=1)
    stiffness_N_per_m: float | None = key(
        "the stop's stiffness in the open loop, or leave it out for a rigid one, as filters and closed loops hold all",
        None,
        gt=0,
        le=1e9,
    )


DOWNWARD = {"hanging": 1.0, "standing": -1.0, "horizontal": 0.0, "off": 0.0}
"""Share of gravity along growing distance."""


class Mechanics(Record, kw_only=False):
    """``[mechanics]``: the moving mass and everything mechanical that acts on it."""

    mass_kg: float = key("the mass of the whole moving body in grams", ge=1e-6, le=1e9)
    # Along growing distance: negative where the body stands on the fixed part's side
    gravity_m_s2: float = field(default=GRAVITY, metadata={"always": True})
    springs: tuple[Spring | ForceTable, ...] = key("each spring as a table [mechanics.springs.NAME]", (), any_name=True)
    viscous_N_s_per_m: float = key("the viscous friction in N s/m", 0.0, ge=0, le=1e9)
    coulomb_N: float = key("the dry friction in N, the same sliding and sticking", 0.0, ge=0, le=1e6)
    load_N: float = key("a constant force; positive pulls the parts apart", 0.0, **FORCE)
    near_stop: Stop | None = key("the stop at the least distance as a table", None)
    far_stop: Stop | None = key("the stop at the largest distance as a table", None)
    gravity: ClassVar[Literal["hanging", "standing", "horizontal", "off"] | None] = key(
        '"hanging" where weight pulls the parts apart, "standing" where it pulls them together, "horizontal" or "off"',
        None,
    )
    gravity_deg: ClassVar[float | None] = key(
        "the angle from downwards to growing distance instead", None, ge=-360, le=360
    )
    travel_mm: ClassVar[tuple[float, float] | None] = key(
        "[least, largest] distance between rigid stops, or near_stop and far_stop", None, **LENGTH
    )

    @classmethod
    def derived(cls, entry: Entry, complain: Callable[..., None]) -> dict[str, Any]:
        """Gravity along growing distance, and the stops of a travel, neither of which is given twice."""
        if {"gravity", "gravity_deg"} <= entry.stated:
            complain("gravity")
        if entry.travel_mm and (entry.near_stop or entry.far_stop):
            complain("travel")
        gravity = GRAVITY * DOWNWARD[entry.gravity or "hanging"]
        if entry.gravity_deg is not None:
            gravity = round(GRAVITY * math.cos(math.radians(entry.gravity_deg)), 12)
        ends = zip(("near_stop", "far_stop"), entry.travel_mm or (), strict=False)
        return {"gravity_m_s2": gravity} | {name: Stop(scaled(distance)) for name, distance in ends}

    def static_force(self, distance: FloatArray) -> FloatArray:
        """Weight, springs and load at distances in m of any shape: along growing distance, in N.

        It is what the magnetic force balances where the body is at rest.
        """
        return self.mass_kg * self.gravity_m_s2 + np.zeros(np.shape(distance)) + self.beside_weight(distance)

    def static_gradient(self, distance: FloatArray) -> FloatArray:
        """Slope of :meth:`static_force` in N/m; of a table, that of the piece above each distance."""
        slopes = (_piece(spring, distance)[3] for spring in self.springs)
        return sum(slopes, np.zeros(np.shape(distance)))

    def friction(self, velocity: Expression, sample_time_s: float = 0.0) -> Expression:
        """Friction's force along growing distance in N, for equations that are solved in steps where a step is entry.

        Dry friction is then F tanh(v / v_0): v_0 is the speed that it takes from the body within one sample, so that it
        stops a body and does not throw it back. Of velocities that were measured it is F sign(v).
        """
        creep, force = self.coulomb_N * sample_time_s / self.mass_kg, -self.viscous_N_s_per_m * velocity
        if self.coulomb_N:
            force = force - self.coulomb_N * (np.tanh(velocity / creep) if creep else np.sign(velocity))
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
        pieces = (_piece(spring, distance) for spring in self.springs)
        return sum(force + slope * way for way, _, force, slope in pieces) + 0.0 * distance

    def energy_of_springs(self, distance: Expression) -> Expression:
        """Energy of all springs in J, of each from nought at its distance or at the first one of its table."""
        pieces = (_piece(spring, distance) for spring in self.springs)
        return sum(-(done + force * way + 0.5 * slope * way**2) for way, done, force, slope in pieces) + 0.0 * distance


def _piece(spring: Spring | ForceTable, distance: Expression) -> tuple[Expression, Expression, Expression, Expression]:
    """The way from the lower end of each distance's piece, and there the work done, the force and its slope.

    A spring is one piece, from its distance on; a table has one from each point to the next.
    """
    if isinstance(spring, Spring):
        return distance - spring.distance_m, 0.0, spring.preload_N, -spring.stiffness_N_per_m
    points, force = np.asarray(spring.distances_m), np.asarray(spring.forces_N)
    work = np.concatenate([[0.0], np.cumsum(0.5 * (force[1:] + force[:-1]) * np.diff(points))])
    slopes = np.concatenate([[0.0], np.diff(force) / np.diff(points), [0.0]])
    rows = np.stack([*(np.concatenate([x[:1], x]) for x in (points, work, force)), slopes], axis=1)
    if isinstance(distance, SX):
        row = row_of(rows, [points], [distance])
        return distance - row[0], row[1], row[2], row[3]
    start, done, push, slope = np.moveaxis(rows[points.searchsorted(distance, "right")], -1, 0)
    return distance - start, done, push, slope
