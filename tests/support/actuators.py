"""Actuators built in code, for tests of the field solver."""

import re
from dataclasses import replace
from pathlib import Path

from femfit.device.electrics import Circuit, HallElement
from femfit.device.mechanics import Mechanics
from femfit.device.parts import Actuator, Coil, LinearMaterial, MovingPart, Region, SweepAxes

GEOMETRY = Path(__file__).parents[2] / "geometry"


def rig_at(currents_A, distances_mm):
    """The text of emaws-rig, swept over other axes, which are given as the file has them."""
    text = (GEOMETRY / "emaws-rig.toml").read_text(encoding="utf-8")
    text = re.sub(r"(?m)^current_A = .*$", f"current_A = {currents_A}", text)
    return re.sub(r"(?m)^distance_mm = .*$", f"distance_mm = {distances_mm}", text)


def swept_at(actuator, distances=None, currents=None):
    """An actuator swept over other distances in m and currents of its first circuit in A."""
    sweep = actuator.sweep
    axes = {"distances_m": distances or sweep.distances_m, "currents_A": currents or sweep.currents_A}
    return replace(actuator, sweep=replace(sweep, **{name: tuple(values) for name, values in axes.items()}))


def rectangle(r_min, r_max, z_min, z_max):
    """Corners of a rectangle in m."""
    return ((r_min, z_min), (r_max, z_min), (r_max, z_max), (r_min, z_max))


def magnet(remanence, r_max, height, z_min=0.0, permeability=1.0, name="magnet"):
    """A cylinder magnet standing on z_min."""
    material = LinearMaterial(name, permeability, remanence)
    return Region(name, rectangle(0.0, r_max, z_min, z_min + height), material)


def assembly(*, moving, distances, fixed=(), coil=None, turns=1.0, hall=None):
    """An actuator of given parts; without a coil it gets a weak one far away."""
    return Actuator(
        name="assembly",
        fixed=tuple(fixed),
        coils=(Coil(coil or rectangle(0.2, 0.21, -0.21, -0.2), turns, 1.0),),
        circuits=(Circuit(1.0, 0.0, 1.0),),
        moving=MovingPart(tuple(moving)),
        mechanics=Mechanics(0.1),
        sweep=SweepAxes((0.0, 1.0), tuple(distances)),
        sensors=() if hall is None else (HallElement(*hall),),
    )
