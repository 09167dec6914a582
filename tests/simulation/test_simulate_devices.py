"""Loops beyond one winding behind a bridge and a Hall element, and around plants that are not the model."""

from dataclasses import replace

import numpy as np
import pytest

from femfit.device.electrics import Drive
from femfit.device.mechanics import Spring, Stop
from femfit.fit.build import fit_model
from femfit.model.magnetics import Coefficient, LawMagnetics
from femfit.simulation.close_loop import close_loop
from femfit.simulation.design import design_loop
from femfit.simulation.operating_point import operating_point
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
def test_a_bearing_is_held_by_the_direct_measurement_of_a_hall_element_that_all_currents_reach():
    entry = {**ENTRY, "mechanics": {"gravity_m_s2": 0.0}}
    fitted = fit_model(table_with_hall(Symmetric(), entry, noise_V=1e-4)).model
    model = replace(fitted, sample_time_s=5e-5, reference_distances_m=(0.5e-3,))
    loop = close_loop(model, estimator="direct", runs=1, seconds=0.01)
    assert loop.held == 1

    assert loop.estimate_rms_m.median < 2e-7
