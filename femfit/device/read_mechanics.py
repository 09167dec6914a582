"""The mass, springs, friction, stops and loads of an actuator file."""

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

from femfit.core.constants import GRAVITY
from femfit.device.complaints import joined, read_table
from femfit.device.decimals import scaled
from femfit.device.mechanics import ForceTable, Mechanics, Spring, Stop
from femfit.device.schema import MovingEntry
from femfit.device.schema_device import MechanicsEntry, SpringEntry, StopEntry

DOWNWARD = {"hanging": 1.0, "standing": -1.0, "horizontal": 0.0, "off": 0.0}
"""Share of gravity along growing distance."""


def read_mechanics(data: Mapping[str, Any], body: MovingEntry | None, problems: list[str]) -> Mechanics | None:
    """The mechanics, of which schema 1 has the mass alone; None if something is wrong."""
    mass = body.mass_g if body is not None else None
    table = data.get("mechanics")
    if not isinstance(table, dict):
        if body is not None and mass is None:
            problems.append("moving.mass_g is missing. Give the mass of the whole moving body in grams.")
        return None if mass is None else Mechanics(scaled(mass))
    if mass is not None and "mass_g" in table:
        problems.append("mechanics.mass_g must be left out beside moving.mass_g. Remove one of them.")
    found = len(problems)
    entry = read_table(MechanicsEntry, ({} if mass is None else {"mass_g": mass}) | table, "mechanics", problems)
    if entry is None:
        return None
    springs = [_spring(joined("mechanics.springs", name), one, problems) for name, one in entry.springs.items()]
    near, far = _stops(entry, problems)
    gravity = _gravity(entry, problems)
    if len(problems) > found:
        return None
    return Mechanics(
        mass_kg=scaled(entry.mass_g),
        gravity_m_s2=gravity,
        springs=tuple(spring for spring in springs if spring is not None),
        viscous_N_s_per_m=entry.viscous_N_s_per_m,
        coulomb_N=entry.coulomb_N,
        load_N=entry.load_N,
        near_stop=near,
        far_stop=far,
    )


def check_travel(mechanics: Mechanics, distances: Sequence[float], problems: list[str]) -> None:
    """Report stops that keep the body away from all distances of the sweep, in mm."""
    near, far = (1e3 * end for end in mechanics.ends)
    if distances and (near > distances[-1] + 1e-9 or far < distances[0] - 1e-9):
        name, place = ("near_stop", near) if near > distances[-1] else ("far_stop", far)
        problems.append(
            f"mechanics.{name} must leave distances of the sweep, {distances[0]:g} to {distances[-1]:g} mm, to the "
            f"body; it is at {place:g} mm. Sweep beyond it, or move it."
        )


def _gravity(entry: MechanicsEntry, problems: list[str]) -> float:
    if entry.gravity is not None and entry.gravity_deg is not None:
        problems.append("mechanics must have either gravity or gravity_deg; it has both. Remove one.")
    if entry.gravity_deg is not None:
        return round(GRAVITY * math.cos(math.radians(entry.gravity_deg)), 12)
    return GRAVITY * DOWNWARD[entry.gravity or "hanging"]


def _spring(path: str, table: object, problems: list[str]) -> Spring | ForceTable | None:
    entry = read_table(SpringEntry, table, path, problems)
    if entry is None:
        return None
    if entry.stiffness_N_per_mm is not None and entry.force_N is None and entry.distance_mm is None:
        if entry.preload_N and entry.preload_at_mm is None:
            problems.append(
                f"{path}.preload_at_mm is missing. Give the distance at which the spring has its preload_N."
            )
        return Spring(1e3 * entry.stiffness_N_per_mm, entry.preload_N, scaled(entry.preload_at_mm or 0.0))
    if entry.stiffness_N_per_mm is not None or entry.distance_mm is None or entry.force_N is None:
        problems.append(
            f"{path} must have either stiffness_N_per_mm or a table of distance_mm and force_N. Give one of the two."
        )
        return None
    if len(entry.distance_mm) != len(entry.force_N):
        problems.append(
            f"{path}.force_N must have as many values as distance_mm; they are {len(entry.force_N)} and "
            f"{len(entry.distance_mm)}. Complete the list."
        )
        return None
    if any(after <= before for before, after in pairwise(entry.distance_mm)):
        problems.append(f"{path}.distance_mm must ascend without repeats. Sort it, with its forces.")
        return None
    return ForceTable(tuple(scaled(d) for d in entry.distance_mm), tuple(entry.force_N))


def _stops(entry: MechanicsEntry, problems: list[str]) -> tuple[Stop | None, Stop | None]:
    near = _stop("mechanics.near_stop", entry.near_stop, problems)
    far = _stop("mechanics.far_stop", entry.far_stop, problems)
    if entry.travel_mm is not None:
        if near is not None or far is not None:
            problems.append("mechanics.travel_mm must be left out beside near_stop and far_stop. Remove one of them.")
        near, far = (Stop(scaled(distance)) for distance in entry.travel_mm)
    if near is not None and far is not None and near.distance_m >= far.distance_m:
        problems.append(
            f"mechanics must have its near stop below its far one; they are at {1e3 * near.distance_m:g} and "
            f"{1e3 * far.distance_m:g} mm. Exchange or change them."
        )
    return near, far


def _stop(path: str, table: object, problems: list[str]) -> Stop | None:
    entry = None if table is None else read_table(StopEntry, table, path, problems)
    if entry is None:
        return None
    stiffness = None if entry.stiffness_N_per_mm is None else 1e3 * entry.stiffness_N_per_mm
    return Stop(scaled(entry.distance_mm), entry.restitution, stiffness)
