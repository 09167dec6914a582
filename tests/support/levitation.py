"""A rig like the levitation paper's, in closed form, and splines of known functions for models without a sweep."""

from functools import cache

import numpy as np

from femfit.device.electrics import Circuit
from femfit.device.mechanics import Mechanics
from femfit.model.actuator_model import ActuatorModel
from femfit.model.bspline import DistanceCoordinate, TensorSpline, basis_matrix
from femfit.model.hall import HallSensor, HallSpline
from femfit.model.magnetics import Coefficient, CoenergySpline, LawMagnetics
from femfit.model.validity import Misfit, ValidityBox

REFERENCE_DISTANCE = 0.015
STEEL = LawMagnetics("F1e", (Coefficient("d^-2", 2, 2e-5, "N m^2 / A^2"),), {}, 0.03)
"""What a coil does to a ball of steel, whose current attracts in either direction."""


def fitted_spline(function, currents: np.ndarray, current_degree: int) -> TensorSpline:
    """Quartic spline in u = d_0 / d of a function of (d, i), by least squares over 15..45 mm."""
    u_knots = np.r_[[1 / 3] * 5, np.linspace(1 / 3, 1.0, 7)[1:-1], [1.0] * 5]
    i_knots = np.r_[[currents[0]] * (current_degree + 1), [currents[-1]] * (current_degree + 1)]
    u, i = (grid.ravel() for grid in np.meshgrid(np.linspace(1 / 3, 1.0, 80), currents, indexing="ij"))
    columns = basis_matrix(u, u_knots, 4)[:, :, None] * basis_matrix(i, i_knots, current_degree)[:, None, :]
    values = function(REFERENCE_DISTANCE / u, i)
    scale = np.abs(values).max()
    coefficients = np.linalg.lstsq(columns.reshape(len(u), -1), values / scale, rcond=None)[0] * scale
    return TensorSpline(u_knots, i_knots, 4, current_degree, coefficients.reshape(columns.shape[1:]))


def _coenergy(d: np.ndarray, i: np.ndarray) -> np.ndarray:
    """A magnet under a 308-turn coil: F(20 mm, i) = 0.0262 N + 0.088 N/A i, L = 16 mH; falling as they do."""
    decay = np.exp(-d / 0.0166)
    return 4.19e-9 / (3.0 * d**3) + 0.2925 * 0.0166 * decay * i + 0.5 * (0.0162 + 2e-4 * decay) * i**2


def _hall_field(d: np.ndarray, i: np.ndarray) -> np.ndarray:
    """8.7 mT of the magnet at 20 mm, 5 mT/A of the coil."""
    return 8.6e-8 / (d + 0.0015) ** 3 + (0.005 + 1e-4 * np.exp(-d / 0.0166)) * i


@cache
def levitation_rig() -> ActuatorModel:
    """A rig like the paper's, with a co-energy spline, circuit, motion and Hall sensor (3.2 mV of noise)."""
    currents = np.linspace(0.0, 1.4, 8)
    return ActuatorModel(
        name="test-rig",
        magnetics=CoenergySpline(DistanceCoordinate(REFERENCE_DISTANCE), fitted_spline(_coenergy, currents, 2)),
        validity=ValidityBox.of_currents((0.015, 0.045), (0.0, 1.4)),
        circuits=(Circuit(2.69, 0.5, 3.0),),
        motion=Mechanics(4.35e-3),
        sensor=HallSensor(
            field=HallSpline(DistanceCoordinate(REFERENCE_DISTANCE), fitted_spline(_hall_field, currents, 1)),
            sensitivity_V_per_T=50.0,
            quiescent_V=2.5,
            output_min_V=0.0,
            output_max_V=5.0,
            adc_bits=12,
            noise_V=3.2e-3,
        ),
        misfit=Misfit(1e-5, 4e-5, 5e-4, 2.3e-4, 1e-6, 1e-6, 488, "sweep"),
        sample_time_s=0.5e-3,
        reference_distances_m=(0.022, 0.030, 0.022),
        provenance={"made_by": "tests"},
    )
