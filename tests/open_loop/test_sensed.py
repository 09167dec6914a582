"""The columns of the drawn sensors in the table of an open loop."""

from dataclasses import replace

import numpy as np

from femfit.device.electrics import AccelerationSensor, CurrentSensor, PositionSensor
from femfit.simulation.open_loop import simulate
from support.pickups import SHARE, search_coil
from support.solenoids import solenoid

LASER = PositionSensor(
    name="laser", noise=1e-3, distances_m=(0.0, 5e-3), readings=(1.0, 6.0), maximum=4.0, delay_s=1e-3, unit="V"
)
STEP_S = 1e-4


def sensed(*sensors):
    model = solenoid()
    model = replace(model, other_sensors=tuple(one(model) if callable(one) else one for one in sensors))
    return simulate(model, voltage_V=12.0, duration_s=0.02, sample_time_s=STEP_S).table


def test_a_position_sensor_reads_its_characteristic_late_and_within_its_range():
    table = sensed(LASER)
    late = np.r_[np.full(10, table["distance_m"][0]), table["distance_m"][:-10]]
    np.testing.assert_allclose(table["position_V"], np.minimum(1.0 + 1e3 * late, 4.0), atol=1e-9)


def test_an_accelerometer_reads_what_changes_the_velocity():
    table = sensed(AccelerationSensor(name="mems"))
    flying = np.flatnonzero((table["velocity_m_s"] < -0.05) & (table["distance_m"] < 3.5e-3))[1:10]
    steps = np.diff(table["velocity_m_s"])[flying - 1] / STEP_S
    between = 0.5 * (table["acceleration_m_s2"][flying] + table["acceleration_m_s2"][flying - 1])
    np.testing.assert_allclose(between, steps, rtol=0.02)  # the trapezium's own error


def test_a_pickup_coil_reads_the_mean_voltage_of_the_step_before():
    """Its flux linkage is a share of the winding's."""
    table = sensed(search_coil)
    means = SHARE * np.diff(table["flux_linkage_Wb"]) / STEP_S
    np.testing.assert_allclose(table["pickup_V"][1:], means, atol=1e-3 * np.abs(means).max())


def test_the_true_current_is_not_replaced_by_a_sensors_reading():
    shunt = CurrentSensor(name="shunt", circuit="coil", gain=1.1)
    np.testing.assert_array_equal(sensed(shunt)["current_A"], sensed()["current_A"])
