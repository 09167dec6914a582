"""The solid pot magnet of geometry/: what its model of few eddy states says beside direct solutions one order finer.

Each direct solution has a mesh of its own; 0.75 and 4 mm are among the sweep's distances, 1.75 mm is not.
"""

from functools import cache
from tempfile import TemporaryDirectory

import numpy as np

import femfit as ff
from femfit.core.numerics import central_differences
from femfit.field.eddy_probe import EddyProbe
from femfit.field.eddy_sweep import ORDER
from femfit.model.dynamics import state_scale
from support.actuators import GEOMETRY
from support.eddy_transient import mesh_for
from support.model_kinds import by_volt, held
from support.readings import hall_voltage

DRAWING = GEOMETRY / "pot-magnet.toml"
DISTANCES_MM = (0.75, 1.75, 4.0)
FREQUENCIES_HZ = (1.0, 10.0, 100.0, 1e3, 1e4)
KINDS = ("impedance", "force of an ampere at 1 A", "Hall field of an ampere")


@cache
def states():
    """How many the model keeps."""
    return _model().eddy.count


@cache
def both():
    """Of each kind the direct solution and the model's, complex, shape (kinds, 2, distances, frequencies)."""
    actuator, model, frequencies = ff.read_actuator(DRAWING), _model(), np.array(FREQUENCIES_HZ)
    found = np.empty((len(KINDS), 2, len(DISTANCES_MM), len(frequencies)), complex)
    for k, distance in enumerate(1e-3 * np.array(DISTANCES_MM)):
        moving = mesh_for(actuator, distance, frequencies[-1], ORDER + 1)
        direct, _ = EddyProbe(actuator, moving, distance, ORDER + 1).transfers(frequencies)
        found[0, 0, k] = model.circuits[0].resistance_ohm + 2j * np.pi * frequencies * direct.flux_linkage[:, 0, 0]
        found[1, 0, k] = direct.force[:, 0, 0] + direct.force[:, 1, 0]
        found[2, 0, k] = direct.hall[:, 0]
        found[0, 1, k] = model.impedance(distance, 1.0, frequencies)
        bias, still = np.ones(1), held(model)
        force = model.windings.magnetics.motional_constant(np.asarray(distance), np.eye(model.windings.count)[0])
        state = np.r_[distance, 0.0, 1.0, np.zeros(model.order - 3)][None]
        volts = central_differences(lambda x: hall_voltage(model, x)[:, None], state, state_scale(model))[0, 0, 2:]
        for m, frequency in enumerate(frequencies):
            currents = by_volt(still, distance, bias, frequency)[:, 0]
            found[1, 1, k, m] = force @ currents / currents[0]
            found[2, 1, k, m] = volts @ currents / currents[0] / model.sensor.sensitivity_V_per_T
    return found


def off(kind):
    """The largest departure of a kind, amplitude and phase, over the amplitude."""
    direct, ours = both()[KINDS.index(kind)]
    return float(np.abs(ours / direct - 1.0).max())


@cache
def _model():
    with TemporaryDirectory() as folder:
        ff.run_sweep(DRAWING, folder)
        return ff.fit_model(folder).model
