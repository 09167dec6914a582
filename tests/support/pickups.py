"""A solenoid with a pickup coil that takes a share of its winding's turns: its flux linkage is known in closed form."""

from dataclasses import replace

import numpy as np

from femfit.fit.sensed_field import SensedRows, fit_sensed
from femfit.model.hall import PickupSensor
from tests.support.solenoids import inductance, solenoid

SHARE = 0.1
"""Of the winding's turns."""

STEP_S = 1e-4


def flux_linkage(distance, current):
    """Of the pickup coil."""
    return SHARE * inductance(distance) * current


def search_coil(model, **fields):
    """The pickup coil as a sweep of 15 distances shows it."""
    box = model.validity
    d, i = (one.ravel() for one in np.meshgrid(
        np.linspace(box.distance_min_m, box.distance_max_m, 15), np.linspace(box.current_min_A, box.current_max_A, 3)
    ))  # fmt: skip
    fit = fit_sensed(SensedRows(d, i[:, None], flux_linkage(d, i)), "search")
    return PickupSensor(name="search", flux=fit.field, **fields)


def searched(**fields):
    """A solenoid, free between its stops, with the pickup coil."""
    model = solenoid()
    free = replace(model.motion, near_stop=None, far_stop=None)
    model = replace(model, motion=free, sample_time_s=STEP_S)
    return replace(model, other_sensors=(*model.other_sensors, search_coil(model, **fields)))
