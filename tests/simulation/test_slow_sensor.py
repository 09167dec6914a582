"""Sensors read at every few samples, and what a drawn sensor's column holds."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.stats import chi2

from femfit.device.electrics import AccelerationSensor, CurrentSensor, PositionSensor
from femfit.fit.build import fit_model
from femfit.model.drive import circuit_terms
from femfit.simulation.close_loop import run_loops
from femfit.simulation.design import design_loop
from femfit.simulation.experiment import Experiment, direct_distance, run_experiments
from femfit.simulation.observers import DirectObserver, distance_inverse
from femfit.simulation.open_loop import simulate
from support.bearing import CIRCUITS, ENTRY, table_of
from support.pickups import SHARE, search_coil
from support.readings import LASER
from support.solenoids import solenoid
from support.steps import runge_kutta_step

PERIOD, NOISE, DISTANCE = 4, 2e-5, 0.026


def design_with(model, noise, period):
    step = model.sample_time_s
    laser = replace(LASER, noise=noise, sample_time_s=period * step)
    return design_loop(replace(model, sensor=None, other_sensors=(laser,), reference_distances_m=(DISTANCE,)))


@pytest.fixture(scope="module")
def slow(levitation_model):
    return design_with(levitation_model, NOISE, PERIOD)


@pytest.fixture(scope="module")
def prompt(levitation_model):
    """Read at each sample, with noise that tells the filter as much."""
    return design_with(levitation_model, NOISE * np.sqrt(PERIOD), 1)


def test_the_age_of_the_readings_is_taken_from_the_delay_margin(slow, prompt):
    """The last of four samples is three samples old, the mean one and a half."""
    one, other = (design.margins("backstepping", "ekf")[0].delay_s for design in (slow, prompt))
    assert other - one == pytest.approx(1.5 * slow.model.sample_time_s, rel=0.02)


def test_the_band_of_the_innovations_counts_the_readings(slow):
    """Two sensors, of which one is read at every fourth of 80 samples: 100 readings of each of three runs."""
    prompt = replace(slow.model.other_sensors[0], name="prompt", sample_time_s=None)
    model = replace(slow.model, other_sensors=(*slow.model.other_sensors, prompt))
    experiment = Experiment("backstepping", "ekf", (DISTANCE,))
    loop = run_loops(
        design_loop(model), experiment, np.random.default_rng(1), runs=3, duration_s=80 * model.sample_time_s
    )
    assert loop.held == 3
    band = chi2.ppf([0.025, 0.975], 300) / 300
    found = loop.innovation_band
    # Wilson and Hilferty's quantiles
    assert (found.lower, found.upper) == pytest.approx(tuple(band), rel=1e-3)
    squared = loop.result.windows[0]
    assert squared.readings.tolist() == [100.0] * 3
    assert loop.normalised_innovation_squared == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / 300))


def test_the_direct_measurement_stays_what_the_last_reading_said(slow):
    experiment = Experiment("backstepping", "ekf", (DISTANCE,))
    (result,) = run_experiments(slow, [experiment], np.random.default_rng(5), runs=4, steps=40, supported_steps=300)
    direct = direct_distance(slow, result.series)
    read = result.series.readings[::PERIOD, :, 0]  # The laser says the distance itself
    np.testing.assert_allclose(direct, np.repeat(read, PERIOD, axis=0), rtol=1e-9)


@pytest.mark.parametrize(("times", "period"), [(0.1, 1), (1.0, 1), (3.0, 3)])
def test_a_sensor_is_read_at_whole_samples_and_a_faster_one_at_each(levitation_model, times, period):
    (sensor,) = design_with(levitation_model, NOISE, times).loop_sensors()
    assert sensor.period == period


LATE = PositionSensor(
    name="laser", noise=1e-3, distances_m=(0.0, 5e-3), readings=(1.0, 6.0), maximum=4.0, delay_s=1e-3, unit="V"
)
STEP_S = 1e-4


def sensed(*sensors):
    model = solenoid()
    model = replace(model, other_sensors=tuple(one(model) if callable(one) else one for one in sensors))
    return simulate(model, voltage_V=12.0, duration_s=0.02, sample_time_s=STEP_S).table


def test_a_position_sensor_reads_its_characteristic_late_and_within_its_range():
    table = sensed(LATE)
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


BRIDGES = [{**circuit, "voltage_min_V": -24.0, "drive": {}} for circuit in CIRCUITS]


@pytest.mark.parametrize("currents", [(1.0, -0.5), (0.0, 1.5)])
def test_two_coupled_coils_of_the_direct_measurement_follow_their_equations(currents):
    """L i' = U - R i at rest; and while the body goes on at its speed, against short steps."""
    model = fit_model(table_of(entry={**ENTRY, "circuits": BRIDGES})).model
    observer = DirectObserver(distance_inverse(replace(model, other_sensors=(LASER,)), "laser"))
    mean, volts = np.array([[0.4e-3, 0.0, *currents], [0.4e-3, 0.05, *currents]]), np.array([[6.0, -3.0]] * 2)
    found = observer.step(observer.start(mean), volts, np.full((2, 1), 0.1)).mean[:, 2:]
    _, _, inductance = circuit_terms(model, mean[0, 0], mean[0, 2:])
    A = -np.linalg.solve(inductance, np.diag(model.resistances_ohm))
    drive = np.linalg.solve(inductance, volts[0])
    whole = expm(model.sample_time_s * np.block([[A, drive[:, None]], [np.zeros((1, 3))]]))
    np.testing.assert_allclose(found[0], whole[:2, :2] @ currents + whole[:2, 2], rtol=1e-9)
    moved = runge_kutta_step(model, mean, volts, model.sample_time_s, 50, free=False)[:, 2:]
    np.testing.assert_allclose(found, moved, atol=2e-4 * np.abs(moved - currents).max())
