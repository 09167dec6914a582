"""The filters of a record predict in fine steps, and their Jacobian is that of these steps."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

import femfit as ff
from femfit.core.errors import FilterError
from femfit.device.sensors import CurrentSensor
from femfit.filters.error_bound import without_stops
from femfit.model.dynamics import state_jacobian
from femfit.replay.build_filter import in_fine_steps
from tests.support.solenoids import solenoid

AT_REST = np.array([[2e-3, 0.0, 0.8]])


def coarse(samples_per_time_constant):
    """A solenoid whose sample is a part of its coil's time constant."""
    model = solenoid()
    inductance = float(model.magnetics.inductance(AT_REST[:, 0], AT_REST[:, 2])[0])
    step = inductance / model.circuit.resistance_ohm / samples_per_time_constant
    shunt = CurrentSensor(name="current", noise=4e-3, circuit="coil")
    return without_stops(replace(model, sample_time_s=step, other_sensors=(shunt,)))


def test_the_jacobian_is_that_of_the_exact_flow():
    model = coarse(1.0 / 0.43)
    process = in_fine_steps(model, ff.kalman_filter(model, sensors=("current",))).process
    volts = np.full(1, model.circuit.resistance_ohm * 0.8)
    found = process.state_jacobian(AT_REST, volts)[0]
    still = model.sample_time_s * state_jacobian(model, AT_REST, volts)[0]
    assert found[2, 2] == pytest.approx(expm(still)[2, 2], rel=0.02)  # Euler's is 12 % below, 1 - 0.43


def test_a_coil_faster_than_the_record_is_no_obstacle_to_fine_steps():
    model = coarse(1.0 / 3.0)
    with pytest.raises(FilterError, match="must take steps of at most"):
        ff.kalman_filter(model, sensors=("current",))
    built = in_fine_steps(model, ff.kalman_filter(model, sensors=("current",), explicit=False))
    state = built.start(AT_REST[0])
    for _ in range(20):
        state = built.step(state, np.full(1, 0.8 * model.circuit.resistance_ohm), np.full(1, 0.8))
    assert state.mean[0, 2] == pytest.approx(0.8, abs=0.01)
