"""Loops beyond one winding behind a bridge and a Hall element, and around plants that are not the model."""

from dataclasses import replace

import numpy as np
import pytest

from femfit.device.electrics import CurrentSensor, Drive
from femfit.device.mechanics import Spring, Stop
from femfit.fit.build import fit_model
from femfit.model.magnetics import Coefficient, LawMagnetics
from femfit.simulation.close_loop import close_loop, run_loops
from femfit.simulation.design import design_loop
from femfit.simulation.experiment import Experiment
from femfit.simulation.operating_point import operating_point
from femfit.simulation.plant import Plant
from support.bearing import ENTRY, Symmetric, table_with_hall
from support.readings import LASER_10_V as LASER


@pytest.fixture(scope="module")
def ball(levitation_model):
    """A steel ball, attracted with 2e-5 N m^2/A^2 i^2/d^2, under a laser: lambda = sqrt(2 g/d)."""
    return replace(
        levitation_model,
        magnetics=LawMagnetics("F1e", (Coefficient("d^-2", 2, 2e-5, "N m^2 / A^2"),), {}, 0.03),
        sensor=None,
        other_sensors=(LASER,),
        reference_distances_m=(0.016, 0.020, 0.016),
    )


def driven(model, **drive):
    return replace(model, circuits=(replace(model.circuit, drive=Drive(**drive), voltage_min_V=0.0),))


def test_the_balls_unstable_pole_is_that_of_an_inverse_square(ball):
    point = operating_point(ball, 0.018)
    assert point.unstable_pole_rad_s == pytest.approx(np.sqrt(2.0 * 9.80665 / 0.018), rel=1e-6)


DRIVES = {
    "bridge": {},
    "diode": {"diode_V": 0.7},
    "amplifier": {"kind": "current", "current_min_A": 0.0, "current_max_A": 1.2, "bandwidth_Hz": 200.0},
    "amplifier without a bandwidth": {"kind": "current"},
}


@pytest.mark.nightly
@pytest.mark.parametrize("drive", DRIVES)
def test_a_steel_ball_is_held_by_the_default_controller_behind_every_driver(ball, drive):
    loop = close_loop(driven(ball, **DRIVES[drive]), runs=2, seconds=0.9, recorded=1)
    assert loop.held == 2, loop
    assert loop.tracking_rms_m.median < 4e-4
    currents = loop.result.series.currents_A
    assert np.nanmin(currents) >= 0.0


def test_an_amplifier_follows_its_command_as_its_bandwidth_and_voltage_allow(ball):
    model = driven(ball, kind="current", bandwidth_Hz=50.0)
    plant, state = Plant(model), np.array([[0.018, 0.0, 0.50]])
    moved = plant.step(state, np.array([0.52]))
    kept = np.exp(-2.0 * np.pi * 50.0 * model.sample_time_s)
    assert moved[0, 2] == pytest.approx(0.52 - 0.02 * kept, rel=1e-12)
    slow = plant.step(state, np.array([50.0]))[0, 2]
    at_full = Plant(replace(model, circuits=(replace(model.circuit, drive=Drive()),))).step(state, np.array([3.0]))[
        0, 2
    ]
    assert slow == pytest.approx(at_full, rel=1e-12)


@pytest.mark.nightly
def test_a_body_that_springs_hold_has_a_position_loop(levitation_model):
    """A stiff spring makes every rest stable; the reference still asks for other places."""
    motion = replace(
        levitation_model.motion, springs=(Spring(stiffness_N_per_m=20.0, preload_N=0.0, distance_m=0.024),)
    )
    stable = replace(
        levitation_model, motion=motion, sensor=None, other_sensors=(LASER,), reference_distances_m=(0.024, 0.0245)
    )
    design = design_loop(stable)
    assert all(point.unstable_pole_rad_s == 0.0 for point in design.points)
    assert "stable" in str(close_loop(stable, runs=1, seconds=0.05))
    for name in ("pid", "state-feedback", "backstepping"):
        loop = close_loop(stable, controller=name, estimator="ukf", runs=2, seconds=0.6)
        assert loop.held == 2
        assert loop.tracking_rms_m.median < 1e-4


@pytest.mark.nightly
def test_a_body_is_lost_where_it_meets_a_stop_whether_it_stays_or_bounces(ball):
    """Without gain it falls to its far stop; the stop is within the model's distances."""
    lost_s = []
    for restitution in (0.0, 0.6):
        motion = replace(ball.motion, far_stop=Stop(0.024, restitution), near_stop=Stop(0.0155, restitution))
        loop = close_loop(
            replace(ball, motion=motion),
            gains={"kp": 0.0, "ki": 0.0, "kd": 0.0}, runs=2, seconds=0.5, recorded=2, estimator="ukf", rng=1,
        )  # fmt: skip
        assert loop.held == 0
        assert set(loop.outcomes) <= {"FELL", "PULLED_IN"}
        lost_s.append(loop.result.outcome_time_s)
        before = loop.result.series.distance_m[loop.result.time_s < lost_s[-1].min() - 1e-9]
        assert ((before > 0.0155) & (before < 0.024)).all()
        assert np.isnan(loop.result.series.distance_m[loop.result.time_s > lost_s[-1].max() + 1e-9]).all()
    np.testing.assert_array_equal(*lost_s)


@pytest.mark.nightly
def test_a_current_sensor_alone_is_said_not_to_tell_a_body_at_rest(ball):
    blind = replace(ball, other_sensors=(CurrentSensor(name="shunt", circuit="coil", noise=0.2),))
    assert design_loop(blind).settled_errors is None or design_loop(blind).settled_errors[0] > 1e-5
    both = replace(ball, other_sensors=(LASER, CurrentSensor(name="shunt", circuit="coil", noise=1e-3)))
    design = design_loop(both)
    assert design.sensors == ("laser", "shunt")
    assert design.settled_errors[0] <= design_loop(ball).settled_errors[0]
    assert close_loop(both, runs=2, seconds=0.3).held == 2


@pytest.mark.nightly
def test_a_bearing_is_held_by_the_direct_measurement_of_a_hall_element_that_all_currents_reach():
    entry = {**ENTRY, "mechanics": {"gravity_m_s2": 0.0}}
    fitted = fit_model(table_with_hall(Symmetric(), entry, noise_V=1e-4)).model
    model = replace(fitted, sample_time_s=5e-5, reference_distances_m=(0.5e-3,))
    loop = close_loop(model, estimator="direct", runs=1, seconds=0.01)
    assert loop.held == 1

    assert loop.estimate_rms_m.median < 2e-7


def held(model, plant, runs=4, seconds=0.4, **options):
    design = design_loop(model)
    experiment = Experiment("backstepping", "ukf", (0.022,), **options)
    return run_loops(design, experiment, np.random.default_rng(3), runs=runs, duration_s=seconds, plant=plant)


@pytest.fixture(scope="module")
def warm(levitation_model):
    """The same actuator with a winding that is 8 K warmer: 3.1 % more resistance."""
    circuit = replace(levitation_model.circuit, resistance_ohm=1.031 * levitation_model.circuit.resistance_ohm)
    return replace(levitation_model, circuits=(circuit,), name="warm")


@pytest.mark.nightly
def test_the_model_itself_as_plant_changes_nothing(levitation_model):
    own, none = (held(levitation_model, plant, runs=1, seconds=0.1) for plant in (levitation_model, None))
    assert own.estimate_rms_m == none.estimate_rms_m
    assert own.tracking_rms_m == none.tracking_rms_m


@pytest.mark.nightly
def test_a_warmer_winding_than_believed_moves_the_estimate_and_shows_in_the_innovations(levitation_model, warm):
    believed, true = held(levitation_model, warm), held(warm, warm)
    assert believed.outcomes == true.outcomes == {"HELD": 4}
    assert true.innovation_band.contains(true.normalised_innovation_squared)
    assert believed.normalised_innovation_squared > 1.5 * true.innovation_band.upper
    assert believed.estimate_rms_m.median > 2.0 * true.estimate_rms_m.median
    assert believed.tracking_rms_m.median > 2.0 * true.tracking_rms_m.median
