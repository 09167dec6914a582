"""Actuators of kinds other than the levitated magnet, built in code: what strangers draw."""

import dataclasses

from femfit.device.electrics import Circuit
from femfit.device.materials import LIBRARY
from femfit.device.mechanics import Mechanics
from femfit.device.outlines import circle
from femfit.device.parts import Actuator, Coil, LinearMaterial, MovingPart, Region, SweepAxes
from support.actuators import magnet, rectangle

STEEL = LIBRARY["steel_1010"].material
FERRITE = LinearMaterial("ferrite_Y30", 1.07, 0.39)
IRON = LinearMaterial("iron", 1000.0)


def device(name, *, fixed=(), coils=(), moving=(), currents=((0.0,),), distances, circuits=None, sensors=()):
    """An actuator of regions and coils, each coil in a circuit of its own unless circuits are given."""
    if circuits is None:
        coils = [dataclasses.replace(coil, circuit=coil.name) for coil in coils]
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


def millimetres(*numbers):
    """A rectangle given in mm."""
    return rectangle(*(1e-3 * number for number in numbers))


def loudspeaker(steel=STEEL, currents=(-4.0, 0.0, 4.0), distances=(0.0,)):
    """A voice coil in the gap of a ring magnet's motor; it stands centred in the gap at distance -9 mm."""
    fixed = [
        Region("backplate", millimetres(0, 36, -30, -24), steel),
        Region("polepiece", millimetres(0, 12, -24, 0), steel),
        Region("ringmagnet", millimetres(17, 36, -24, -6), FERRITE),
        Region("topplate", millimetres(13.5, 36, -6, 0), steel),
    ]
    coil = Coil(millimetres(12.4, 13.1, 0, 12), 110.0, 5.0, moves=True)
    return device("loudspeaker", fixed=fixed, coils=[coil], currents=(currents,), distances=distances)


def push_solenoid(steel=LIBRARY["steel_1018"].material, currents=(0.0, 0.5, 1.5), distances=(1e-3,)):
    """A plunger that slides in a bore."""
    fixed = [
        Region("base", millimetres(3, 14, -4, 0), steel),
        Region("shell", millimetres(12, 14, 0, 30), steel),
        Region("endplate", millimetres(6.3, 14, 30, 34), steel),
    ]
    coil = Coil(millimetres(7, 11.5, 1, 29), 900.0, 10.0)
    plunger = Region("plunger", millimetres(0, 6, 0, 40), steel)
    return device(
        "push-solenoid", fixed=fixed, coils=[coil], moving=[plunger], currents=(currents,), distances=distances
    )


def bearing(steel=STEEL, currents=(-2.0, 0.0, 2.0), distances=(0.5e-3,)):
    """A thrust disk of 10 mm between two electromagnets 11 mm apart."""
    lower = ((10, -15), (40, -15), (40, 0), (32, 0), (32, -9), (18, -9), (18, 0), (10, 0))
    corners = tuple((1e-3 * r, 1e-3 * z) for r, z in lower)
    mirrored = tuple((r, 0.011 - z) for r, z in corners[::-1])
    fixed = [Region("lower", corners, steel), Region("upper", mirrored, steel)]
    coils = [
        Coil(millimetres(19, 31, -8, -1), 150.0, 1.0, name="lower"),
        Coil(millimetres(19, 31, 12, 19), 150.0, 1.0, name="upper"),
    ]
    disk = Region("disk", millimetres(9, 41, 0, 10), steel)
    return device(
        "axial-bearing", fixed=fixed, coils=coils, moving=[disk], currents=(currents, currents), distances=distances
    )


def ball(steel=STEEL, currents=(0.0, 1.0, 2.0), distances=(8e-3,)):
    """A ball of 25 mm below an electromagnet with a core of 25 mm."""
    core = Region("core", millimetres(0, 12.5, -60, 0), steel)
    coil = Coil(millimetres(13.5, 30, -58, -2), 2000.0, 10.0)
    corners, bulges = circle((0.0, 0.0125), 0.0125)
    return device(
        "steel-ball",
        fixed=[core],
        coils=[coil],
        moving=[Region("ball", tuple(corners), steel, tuple(bulges))],
        currents=(currents,),
        distances=distances,
    )


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
        return tuple(one if one.material.remanence_T else dataclasses.replace(one, material=material) for one in group)

    moving = dataclasses.replace(actuator.moving, regions=regions(actuator.moving.regions))
    return dataclasses.replace(actuator, fixed=regions(actuator.fixed), moving=moving)
