"""A levitating magnet in closed form: F1e with the converged a, 308 turns, and a cylinder magnet's field on its axis."""

import numpy as np
import pytest

from femfit.model.actuator_model import ActuatorModel, Circuit, HallSensor, Motion, ValidityBox
from femfit.model.bspline import TensorSpline, basis_matrix
from femfit.model.hall import HallField
from femfit.model.magnetics import Coefficient, LawMagnetics


def _magnet_on_axis(distance):
    """B_z of an 11 x 5 mm magnet of 1.45 T on its axis, Furlani (2001) section 4.2."""
    radius, height = 5.5e-3, 5e-3
    far, near = distance + height, distance
    return 0.725 * (far / np.hypot(far, radius) - near / np.hypot(near, radius))


def _hall_field():
    reference = 0.015
    knots = np.r_[[1 / 3] * 5, np.linspace(1 / 3, 1, 9)[1:-1], [1] * 5]
    u = np.linspace(1 / 3, 1, 400)
    magnet = np.linalg.lstsq(basis_matrix(u, knots, 4), _magnet_on_axis(reference / u), rcond=None)[0]
    current_knots = np.array([0.0, 0.0, 1.4, 1.4])
    coil = 3.9e-3 * 1.4  # T at 1.4 A: 308 turns on the paper's core
    return HallField(reference, TensorSpline(knots, current_knots, 4, 1, np.stack([magnet, magnet + coil], 1)))


@pytest.fixture(scope="session")
def rig():
    magnetics = LawMagnetics(
        "F1e",
        (
            Coefficient("d^-4", 0, 4.2e-9, "N m^4"),
            Coefficient("d^-2", 1, 4.51e-6 * 308 / 30, "N m^2/A"),
        ),
        constant_inductance_H=16.2e-3,
    )
    return ActuatorModel(
        name="analytic-rig",
        magnetics=magnetics,
        validity=ValidityBox(0.015, 0.045, 0.0, 1.4),
        circuit=Circuit(2.69, 0.5, 3.0),
        motion=Motion(4.35e-3),
        sensor=HallSensor(_hall_field(), 50.0, 2.5, 0.0, 5.0, 12),
        reference_distances_m=(0.022, 0.030, 0.022),
    )
