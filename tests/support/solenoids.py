"""Solenoids of which everything is known in closed form, with a pickup coil of a share of the winding's turns too."""

from dataclasses import replace

import numpy as np

from femfit.device.electrics import Circuit, Drive
from femfit.device.mechanics import Mechanics, Spring, Stop
from femfit.fit.sensed_field import fit_sensed
from femfit.model.actuator_model import ActuatorModel
from femfit.model.bspline import DistanceCoordinate, TensorSpline, basis_matrix
from femfit.model.hall import PickupSensor
from femfit.model.magnetics import CoenergySpline, Magnetics
from femfit.model.validity import ValidityBox

LEAKAGE_H, REACH_H_M, SHIFT_M, REFERENCE_M = 5e-3, 3e-5, 1e-3, 2e-3
"""L(d) = LEAKAGE_H + REACH_H_M / (d + SHIFT_M): 35 mH closed, 11 mH at 4 mm."""


def inductance(distance):
    return LEAKAGE_H + REACH_H_M / (distance + SHIFT_M)


HELD = Mechanics(0.025, 0.0, springs=(Spring(0.0, 5.0),), near_stop=Stop(0.2e-3), far_stop=Stop(4e-3))
"""Pressed on its far stop."""


def solenoid(mechanics: Mechanics | None = None, drive: Drive | None = None) -> ActuatorModel:
    """W' = L(d) i^2 / 2 as a spline in d_0 / (d + s) and i, which holds it to rounding; 12 V, 20 ohm, 25 g."""
    u = REFERENCE_M / (np.array([6e-3, -0.5e-3]) + SHIFT_M)
    u_knots, i_knots = np.r_[[u[0]] * 5, np.linspace(*u, 13)[1:-1], [u[1]] * 5], np.r_[[-2.0] * 3, [2.0] * 3]
    grid, currents = np.linspace(*u, 200), np.linspace(-2.0, 2.0, 7)
    rows, columns = basis_matrix(grid, u_knots, 4), basis_matrix(currents, i_knots, 2)
    values = 0.5 * (LEAKAGE_H + REACH_H_M / REFERENCE_M * grid)[:, None] * currents**2
    coefficients = np.linalg.lstsq(rows, values @ np.linalg.pinv(columns).T, rcond=None)[0]
    stops = {"near_stop": Stop(0.2e-3, 0.2), "far_stop": Stop(4e-3, 0.2)}
    return ActuatorModel(
        name="solenoid",
        magnetics=CoenergySpline(
            DistanceCoordinate(REFERENCE_M, SHIFT_M), TensorSpline(u_knots, i_knots, 4, 2, coefficients)
        ),
        validity=ValidityBox.of_currents((0.1e-3, 6e-3), (-2.0, 2.0)),
        circuits=(Circuit(20.0, 0.0 if drive else -12.0, 12.0, drive or Drive()),),
        motion=mechanics or Mechanics(0.025, 0.0, springs=(Spring(200.0, 0.1, 4e-3),), **stops),
    )


class NoField(Magnetics):
    """A winding of 10 mH that pulls nothing."""

    def expression(self, _, currents):
        return 0.005 * currents[0] ** 2


SHARE = 0.1
"""Of the winding's turns: those of the pickup coil."""

STEP_S = 1e-4


def flux_linkage(distance, current):
    return SHARE * inductance(distance) * current


def search_coil(model, **fields):
    """The pickup coil as a sweep of 15 distances shows it."""
    box = model.validity
    d, i = (one.ravel() for one in np.meshgrid(
        np.linspace(box.distance_min_m, box.distance_max_m, 15), np.linspace(box.current_min_A, box.current_max_A, 3)
    ))  # fmt: skip
    fit = fit_sensed(d, i[:, None], flux_linkage(d, i), "search")
    return PickupSensor(name="search", flux=fit.field, **fields)


def searched(**fields):
    """A solenoid, free between its stops, with the pickup coil."""
    model = solenoid()
    free = replace(model.motion, near_stop=None, far_stop=None)
    model = replace(model, motion=free, sample_time_s=STEP_S)
    return replace(model, other_sensors=(*model.other_sensors, search_coil(model, **fields)))
