"""Slow and late sensors, what a drawn sensor's column holds; plants and loops with eddy currents or effects."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.stats import chi2

from femfit.device.electrics import AccelerationSensor, CurrentSensor, Drive, PositionSensor
from femfit.device.mechanics import Mechanics
from femfit.fit.build import fit_model
from femfit.model.dynamics import voltages_needed
from femfit.simulation.close_loop import run_loops
from femfit.simulation.design import design_loop
from femfit.simulation.experiment import Experiment, direct_distance
from femfit.simulation.linear_loop import linear_plant
from femfit.simulation.observers import DirectObserver
from femfit.simulation.open_loop import simulate
from femfit.simulation.operating_point import operating_point
from femfit.simulation.plant import Plant, loop_sensors, with_force_scale
from support.added_effects import usually
from support.bearing import CIRCUITS, ENTRY, table_of
from support.closed_loop import run
from support.eddies import with_eddies
from support.readings import LASER
from support.solenoids import SHARE, search_coil, solenoid
from support.switching import pulse

PERIOD, NOISE, DISTANCE = 4, 2e-5, 0.026
BY_EKF = Experiment("backstepping", "ekf", (DISTANCE,))


def design_with(model, noise, period):
    laser = replace(LASER, noise=noise, sample_time_s=period * model.sample_time_s)
    return design_loop(replace(model, sensor=None, other_sensors=(laser,), reference_distances_m=(DISTANCE,)))


@pytest.fixture(scope="module")
def slow(levitation_model):
    return design_with(levitation_model, NOISE, PERIOD)


def test_the_age_of_the_readings_is_taken_from_the_delay_margin(slow, levitation_model):
    """The last of four samples is three samples old, the mean one and a half."""
    prompt = design_with(levitation_model, NOISE * np.sqrt(PERIOD), 1)  # whose noise tells the filter as much
    one, other = (design.margins("backstepping", "ekf")[0].delay_s for design in (slow, prompt))
    assert other - one == pytest.approx(1.5 * slow.model.sample_time_s, rel=0.02)


def test_the_band_of_the_innovations_counts_the_readings(slow):
    """Two sensors, of which one is read at every fourth of 80 samples: 100 readings of each of three runs."""
    (laser,), step = slow.model.other_sensors, slow.model.sample_time_s
    model = replace(slow.model, other_sensors=(laser, replace(laser, name="prompt", sample_time_s=None)))
    (loop,) = run_loops(design_loop(model), [BY_EKF], np.random.default_rng(1), runs=3, duration_s=80 * step)
    assert loop.held == 3
    found = loop.innovation_band
    assert (found.lower, found.upper) == pytest.approx(chi2.ppf([0.025, 0.975], 300) / 300, rel=1e-12)
    assert loop.result.readings.tolist() == [100.0] * 3
    assert loop.normalised_innovation_squared == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / 300))


def test_the_direct_measurement_stays_what_the_last_reading_said(slow):
    series = run(slow, BY_EKF, steps=40).series
    read = series.readings[::PERIOD, :, 0]  # The laser says the distance itself
    np.testing.assert_allclose(direct_distance(slow, series), np.repeat(read, PERIOD, axis=0), rtol=1e-9)


@pytest.mark.parametrize(("times", "period"), [(0.1, 1), (1.0, 1), (3.0, 3)])
def test_a_sensor_is_read_at_whole_samples_and_a_faster_one_at_each(levitation_model, times, period):
    (sensor,) = design_with(levitation_model, NOISE, times).loop_sensors()
    assert sensor.period == period


LATE = PositionSensor(
    name="laser", noise=1e-3, distances_m=(0.0, 5e-3), readings=(1.0, 6.0), maximum=4.0, delay_s=1e-3, unit="V"
)
STEP_S = 1e-4


def test_a_drawn_sensors_column_holds_what_it_reads():
    """A late characteristic within its range, what changes the velocity, and the mean voltage of the step before."""
    plain, shunt = solenoid(), CurrentSensor(name="shunt", circuit="coil", gain=1.1)
    sensors = LATE, AccelerationSensor(name="mems"), search_coil(plain), shunt
    models = plain, replace(plain, other_sensors=sensors)
    alone, table = (simulate(one, voltage_V=12.0, duration_s=0.02, sample_time_s=STEP_S).table for one in models)
    np.testing.assert_array_equal(table["current_A"], alone["current_A"])  # the true one, whatever a sensor reads
    late = np.r_[np.full(10, table["distance_m"][0]), table["distance_m"][:-10]]
    np.testing.assert_allclose(table["position_V"], np.minimum(1.0 + 1e3 * late, 4.0), atol=1e-9)
    flying = np.flatnonzero((table["velocity_m_s"] < -0.05) & (table["distance_m"] < 3.5e-3))[1:10]
    steps = np.diff(table["velocity_m_s"])[flying - 1] / STEP_S
    between = 0.5 * (table["acceleration_m_s2"][flying] + table["acceleration_m_s2"][flying - 1])
    np.testing.assert_allclose(between, steps, rtol=0.02)  # the trapezium's own error
    means = SHARE * np.diff(table["flux_linkage_Wb"]) / STEP_S  # a share of the winding's
    np.testing.assert_allclose(table["pickup_V"][1:], means, atol=1e-3 * np.abs(means).max())


BRIDGES = [{**circuit, "voltage_min_V": -24.0, "drive": {}} for circuit in CIRCUITS]


@pytest.mark.parametrize("currents", [(1.0, -0.5), (0.0, 1.5)])
def test_two_coupled_coils_of_the_direct_measurement_follow_their_equations(currents):
    """L i' = U - R i at rest."""
    model = fit_model(table_of(entry={**ENTRY, "circuits": BRIDGES})).model
    observer = DirectObserver(replace(model, other_sensors=(LASER,)), "laser")
    mean, volts = np.array([[0.4e-3, 0.0, *currents]]), np.array([[6.0, -3.0]])
    found = observer.step(observer.start(mean), volts, np.full((1, 1), 0.1)).mean[:, 2:]
    (inductance,) = voltages_needed(model, *mean.T[:2], mean[:, 2:])[1]
    A = -np.linalg.solve(inductance, np.diag(model.resistances_ohm))
    drive = np.linalg.solve(inductance, volts[0])
    whole = expm(model.sample_time_s * np.block([[A, drive[:, None]], [np.zeros((1, 3))]]))
    np.testing.assert_allclose(found[0], whole[:2, :2] @ currents + whole[:2, 2], rtol=1e-9)


DISTANCE_M = 0.024


@pytest.mark.parametrize("times", [(), (20e-3, 2e-3)])
def test_the_plant_follows_a_diode_as_the_open_loop_does(times):
    """The closed loop's steps keep the flux that patterns link where a diode blocks, and let no current turn."""
    model = replace(solenoid(Mechanics(1e9, 0.0), Drive(diode_V=0.7)), sample_time_s=0.1e-3)
    model = with_eddies(model, times) if times else model
    table = simulate(model, drive=pulse("voltage", 12.0), duration_s=0.04, start_m=4e-3, sample_time_s=0.1e-3).table
    plant = Plant(model)
    state, found, currents = plant.start(np.array([[4e-3, 0.0, 0.0]])), [], []
    for k in range(400):
        found.append(float(model.windings.magnetics.force(state[:, 0], state[:, 2 : model.windings.end])[0]))
        state = plant.step(state, np.array([12.0 if k < 200 else 0.0]))
        currents.append(state[0, 2])
    wanted = table["force_N"][:400]
    np.testing.assert_allclose(found, wanted, atol=2e-3 * wanted.max())  # the diode blocks within a step
    assert min(currents) >= 0.0
    assert currents[-1] < 1e-12  # of patterns that go on, to rounding


@pytest.mark.parametrize("effects", [(), ("eddy_current_lag", "magnet_demagnetisation", "driver_gain")])
def test_a_plant_of_another_force_has_its_motional_constant_scaled_alike(levitation_model, effects):
    """A stronger one falls more slowly, and a factor of one changes nothing."""
    model = usually(levitation_model, *effects)
    stronger, volts = with_force_scale(model, 1.1), np.full((4, 1), 1.1)
    state = np.random.default_rng(2).normal(0.0, 0.05, (4, model.order))
    state[:, [0, 2]] = 0.022, 0.4
    found, same = Plant(stronger).step(state, volts), Plant(model).step(state, volts)
    assert (found[:, 1] < same[:, 1]).all()
    np.testing.assert_allclose(Plant(with_force_scale(model, 1.0)).step(state, volts), same, rtol=1e-9, atol=1e-12)
    if not effects:
        for part in ("force", "motional_constant"):
            scaled, plain = (getattr(one.magnetics, part)(state[:, 0], state[:, 2:]) for one in (stronger, model))
            np.testing.assert_allclose(scaled, 1.1 * plain, rtol=1e-14)


def test_the_linear_plant_has_the_eddy_currents_modes(levitation_model):
    model = with_eddies(levitation_model, (50e-3, 10e-3))
    sensors = loop_sensors(model, {"hall": 1e-3}, model.sample_time_s)
    braked, still = (
        linear_plant(one, operating_point(one, DISTANCE_M), sensors).A for one in (model, levitation_model)
    )
    assert braked.shape == (5, 5)
    moduli = np.abs(np.linalg.eigvals(braked))
    assert (moduli > 1.0).sum() == 1  # one is unstable, as without
    # Conducting parts brake what runs away
    assert 1.0 < moduli.max() < np.abs(np.linalg.eigvals(still)).max()
