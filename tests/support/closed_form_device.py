"""A magnet m^2 / d^4 before a coil, as tables in closed form: F = m^2 A + m t i B + t^2 i^2 C, and so on."""

import numpy as np

from femfit.device.load import read_actuator
from femfit.trial.field_table import Conditions, Device, FieldTable
from support.actuators import GEOMETRY

N = 5
D = np.array([0.0163, 0.0221, 0.0307, 0.0412, 0.0441])
DRAWING = GEOMETRY / "emaws-rig.toml"


class AnyFamily(dict):
    """Every family that is asked for, as a magnet or a winding that is a little weaker; those that are given first."""

    def __missing__(self, name):
        return {-1.0: table(0.95, 0.97), 1.0: table(1.05, 1.03)}


def table(magnet=1.0, turns=1.0, linear_part=1.0):
    actuator = read_actuator(DRAWING)
    x = np.cos(np.pi * (np.arange(16) + 0.5) / 16)[::-1]
    low, high = 0.8 * actuator.sweep.distances_m[0], 1.06 * actuator.sweep.distances_m[-1]
    d = np.exp(0.5 * (np.log(low) + np.log(high)) + 0.5 * (np.log(high) - np.log(low)) * x)
    inverse = np.linalg.inv(np.polynomial.chebyshev.chebvander(x, 15))
    decay, zero = np.exp(-d / 0.0166), np.zeros(16)
    force = [magnet**2 * 4.19e-9 / d**4, magnet * turns * 0.2925 * decay, zero + turns**2 * 6e-3 * decay]
    flux = [magnet * turns * 0.2925 * 0.0166 * decay, turns**2 * linear_part * (0.0162 + 2e-4 * decay), zero]
    hall = [magnet * 8.6e-8 / (d + 0.0015) ** 3, zero + 0.005 * turns, zero]
    currents = np.array([-1.0, 0.0, 1.0])
    values = np.array([np.array(one).T @ np.vander(currents, 3, increasing=True).T for one in (force, flux, hall)])
    return FieldTable((low, high), tuple(currents), inverse @ values)


def closed_form_device():
    families = {
        "saturating": {1.0: table(linear_part=0.9)},
        "remanence": {step: table(magnet=1.0 + step) for step in (-0.1, 0.1)},
    }
    return Device(read_actuator(DRAWING), table(), AnyFamily(families))


def conditions(current=1.0, coil_C=20.0, magnet_C=20.0, distance=D):
    """Readings at distances, 10 s apart."""
    n = len(distance)
    flat, time = np.ones(n), 10.0 * np.arange(n)
    return Conditions(distance, current * flat, time, coil_C * flat, magnet_C * flat, np.zeros(n, dtype=int), time)
