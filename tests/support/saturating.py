"""Actuators with saturating parts, and short ways to their rows."""

import dataclasses

import numpy as np

from femfit.core.numerics import MU_0
from femfit.device.load import read_actuator
from femfit.device.materials import LIBRARY
from femfit.device.parts import NonlinearMaterial, Region
from support.actuators import GEOMETRY, assembly, rectangle, swept_at
from support.field import prepared

STEEL = LIBRARY["steel_1010"].material


def straight(permeability):
    """A magnetisation curve that is a straight line."""
    b = (0.0, 1.0, 2.0, 3.0)
    return NonlinearMaterial("straight", b, tuple(value / (permeability * MU_0) for value in b))


def rig_with_core(material, distances):
    """The levitation rig with a core of another material."""
    rig = read_actuator(GEOMETRY / "emaws-rig.toml")
    fixed = tuple(dataclasses.replace(part, material=material) for part in rig.fixed)
    return dataclasses.replace(rig, fixed=fixed, sweep=dataclasses.replace(rig.sweep, distances_m=tuple(distances)))


def bobbin(material=STEEL, distances=(0.005,), currents=(0.0, 3.0), mover=None):
    """A bobbin core with 600 turns and a disc of 11 mm x 5 mm before it, all of steel: saturates from about 4 A."""
    parts = [
        Region("upper", rectangle(0.0025, 0.02, -0.025, -0.02), material),
        Region("sleeve", rectangle(0.0025, 0.01, -0.02, -0.005), material),
        Region("lower", rectangle(0.0025, 0.02, -0.005, 0.0), material),
    ]
    disc = Region("disc", rectangle(0.0, 0.0055, 0.0, 0.005), material)
    actuator = assembly(
        fixed=parts,
        moving=mover or [disc],
        distances=distances,
        coil=rectangle(0.01, 0.02, -0.02, -0.005),
        turns=600,
        hall=(0.0, -0.001),
    )
    return swept_at(actuator, currents=tuple(currents))


def rows_at(actuator, distance=None, settings=None):
    """Columns at a distance (the first one by default), as arrays."""
    distance = actuator.sweep.distances_m[0] if distance is None else distance
    rows = prepared(actuator, distance, settings).rows(distance, actuator.sweep.currents_A)
    return {name: np.array(values) for name, values in rows.items()}
