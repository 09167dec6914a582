"""A magnet that falls through a copper tube, and how much the tube brakes it, in closed form.

A ring of the tube of radius a has the resistance 2 pi a / (sigma da dz), and a magnet that moves at v induces
v dPhi/dz in it, so that it is braked by k v with k = integral (dPhi/dz)^2 sigma / (2 pi a) da dz. Of a dipole p
Phi = mu_0 p a^2 / (2 (a^2 + z^2)^(3/2)), hence k = 45 mu_0^2 p^2 sigma w / (1024 a^4) of a thin tube of the wall w
(W. M. Saslow, Am. J. Phys. 60 (1992) 693), integrated over the wall of a thicker one. All this without skin effect.
"""

import math
from functools import cache
from tempfile import TemporaryDirectory

import magpylib
import numpy as np

import femfit as ff
from femfit.core.numerics import MU_0
from femfit.device.load import actuator_from_toml
from femfit.field.eddy_probe import EddyProbe
from femfit.field.eddy_sweep import ORDER
from femfit.field.layout import layout_of
from femfit.field.moving_mesh import MovingMesh
from femfit.field.tolerance import SolverSettings
from support.small_drawing import DRAWINGS

REMANENCE, CONDUCTIVITY, WALL = 1.3, 58e6, (0.008, 0.010)
RADIUS = 0.004
MASS, GRAVITY = 2.6e-3, 9.80665


def height_of(radius):
    """Of a cylinder without an octupole moment."""
    return math.sqrt(3.0) * radius


def drawing(radius=RADIUS, distances_mm=(0,)):
    """A cylinder of a radius in m in the tube's middle; without an octupole moment, since it is as high as that."""
    height = 1e3 * height_of(radius)
    text = (DRAWINGS / "falling-magnet.toml").read_text(encoding="utf-8")
    distances = [float(d) for d in distances_mm]
    return actuator_from_toml(text.format(radius=1e3 * radius, height=height, distances=distances))


def braking_of_dipole(radius):
    """k in N s/m of a dipole with the cylinder's moment."""
    moment = REMANENCE / MU_0 * math.pi * radius**2 * height_of(radius)
    wall = (WALL[0] ** -3 - WALL[1] ** -3) / 3.0
    return 45.0 * MU_0**2 * moment**2 * CONDUCTIVITY * wall / 1024.0


def braking_of_cylinder(radius):
    """The same of the cylinder: dPhi/dz = -2 pi a B_r of magpylib's exact field, integrated over the wall."""
    body = magpylib.magnet.Cylinder(polarization=(0, 0, REMANENCE), dimension=(2.0 * radius, height_of(radius)))
    across, along = (np.polynomial.legendre.leggauss(count) for count in (8, 400))
    half, thick = 0.06, 0.5 * (WALL[1] - WALL[0])
    a, z = np.meshgrid(WALL[0] + thick * (1.0 + across[0]), half * along[0], indexing="ij")
    radial = body.getB(np.stack([a, 0.0 * a, z], axis=-1))[..., 0]
    weight = np.outer(thick * across[1], half * along[1])
    return float(np.sum(weight * 2.0 * math.pi * a * CONDUCTIVITY * radial**2))


def braking_of_field(radius):
    """The same from the field solver, of the field's change with the magnet's place."""
    actuator, settings = drawing(radius), SolverSettings(order=ORDER)
    moving = MovingMesh(actuator, (0.0,), layout_of(actuator, settings), settings)
    return float(EddyProbe(actuator, moving, 0.0, ORDER).braking()[0, 0])


@cache
def fallen():
    """The model of a sweep, and the last 4 mm of its fall, where the velocity is constant."""
    actuator = drawing(distances_mm=[1.5 * k for k in range(-6, 7)])
    with TemporaryDirectory() as directory:
        model = ff.fit_model(ff.run_sweep(actuator, directory, workers=1)).model
    table = ff.simulate(model, duration_s=0.2, start_m=-9e-3).table
    late = table["distance_m"] > 0.005
    return model, {name: values[late] for name, values in table.items()}


def speed():
    """The mean of it in m/s."""
    table = fallen()[1]
    return float(np.ptp(table["distance_m"]) / np.ptp(table["time_s"]))
