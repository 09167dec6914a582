"""Actuators built in code, for tests of the field solver."""

import re
from dataclasses import replace
from pathlib import Path

from femfit.device.electrics import Circuit, HallElement
from femfit.device.materials import LIBRARY
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


STEEL = LIBRARY["steel_1010"].material
IRON = LinearMaterial("iron", 1000.0)


def device(name, *, fixed=(), coils=(), moving=(), currents=((0.0,),), distances, circuits=None, sensors=()):
    """An actuator of regions and coils, each coil in a circuit of its own unless circuits are given."""
    if circuits is None:
        coils = [replace(coil, circuit=coil.name) for coil in coils]
        circuits = tuple(Circuit(1.0, -12.0, 12.0, name=coil.name) for coil in coils)
    axes = SweepAxes(tuple(currents[0]), tuple(distances), tuple(map(tuple, currents[1:])))
    return Actuator(
        name=name,
        fixed=tuple(fixed),
        coils=tuple(coils),
        moving=MovingPart(tuple(moving)),
        mechanics=Mechanics(0.1),
        sweep=axes,
        circuits=circuits,
        sensors=tuple(sensors),
    )


def assembly(*, moving, distances, fixed=(), coil=None, turns=1.0, hall=None):
    """An actuator of given parts; without a coil it gets a weak one far away."""
    coils = [Coil(coil or rectangle(0.2, 0.21, -0.21, -0.2), turns, 1.0)]
    sensors = () if hall is None else (HallElement(*hall),)
    parts = {"fixed": fixed, "moving": moving, "coils": coils, "circuits": (Circuit(1.0, 0.0, 1.0),)}
    return device("assembly", **parts, currents=((0.0, 1.0),), distances=distances, sensors=sensors)


def millimetres(*numbers):
    """A rectangle given in mm."""
    return rectangle(*(1e-3 * number for number in numbers))


def coil_on_a_magnet(distances, sensors=()):
    """A magnet with a coil on it before a fixed coil with a core, each coil a circuit of its own."""
    coils = [
        Coil(millimetres(8, 14, -20, -2), 200.0, 1.0, name="fixed"),
        Coil(millimetres(7, 10, 0, 6), 80.0, 1.0, moves=True, name="moving"),
    ]
    core = magnet(0.0, 0.007, 0.02, z_min=-0.021, permeability=500.0, name="core")
    body = magnet(1.2, 0.007, 0.006, permeability=1.05)
    axes = ((0.0, 1.0), (0.0, 1.0))
    return device("two", fixed=[core], coils=coils, moving=[body], currents=axes, distances=distances, sensors=sensors)


def linear(actuator, material=IRON):
    """The same with another material for all that is not a magnet."""

    def regions(group):
        return tuple(one if one.material.remanence_T else replace(one, material=material) for one in group)

    moving = replace(actuator.moving, regions=regions(actuator.moving.regions))
    return replace(actuator, fixed=regions(actuator.fixed), moving=moving)
