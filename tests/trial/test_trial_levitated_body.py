"""The levitated body's truth: equilibrium, energy, friction, eddies, and a loop that holds it."""

from dataclasses import replace

import numpy as np
import pytest

from femfit.core.constants import GRAVITY
from support.trial_study.levitated_body import Body, MovingTruth
from support.trial_study.series_effects import SERIES_EFFECTS

D = 0.022


@pytest.fixture
def balanced(rig_truth):
    """A body and the current that holds it."""
    coefficients = MovingTruth(rig_truth, Body(1.0))._coefficients(np.array([D]))[0][:, 0]
    mass = rig_truth.actuator.mechanics.mass_kg
    roots = np.roots([coefficients[2], coefficients[1], coefficients[0] - mass * GRAVITY])
    return Body(mass), float(roots[np.argmin(np.abs(roots))].real)


def moved(truth, body, current, steps=40, velocity=0.0, voltage=None):
    plant = MovingTruth(truth, body)
    state = plant.start(np.array([D]), np.array([current]))
    state[:, 1] = velocity
    held = np.array([truth.actuator.coil.resistance_ohm * current if voltage is None else voltage])
    path = [state]
    for _ in range(steps):
        path.append(plant.step(path[-1], held, 0.5e-3))
    return np.array(path)[:, 0]


def test_a_body_in_balance_stays_for_some_time_constants(rig_truth, balanced):
    body, current = balanced
    path = moved(rig_truth, body, current)  # 20 ms: less than one time constant of the fall
    assert np.abs(path[:, 0] - D).max() < 1e-9
    assert np.ptp(path[:, 2]) < 1e-9


def test_it_falls_away_at_the_rate_of_its_unstable_pole(rig_truth, balanced):
    body, current = balanced
    held = replace(body, pull_N=1e-5)
    path = moved(rig_truth, held, current, steps=20)
    # d'' = pull / m at first: 1e-5 N over 4.35 g for 10 ms, a little more as it gets away
    expected = 0.5 * 1e-5 / body.mass_kg * 0.01**2
    assert expected < path[-1, 0] - D < 1.6 * expected


def test_electrical_energy_becomes_heat_field_and_motion(rig_truth, balanced):
    body, current = balanced
    resistance = rig_truth.actuator.coil.resistance_ohm
    path = moved(rig_truth, body, current, steps=60, velocity=0.02, voltage=2.0)
    time = 0.5e-3 * np.arange(len(path))
    d, v, i = path[:, 0], path[:, 1], path[:, 2]
    supplied = np.trapezoid(2.0 * i, time)
    heat = np.trapezoid(resistance * i**2, time)
    base = rig_truth.base
    force, flux = base.at(d, i).force, base.at(d, i).flux_linkage
    # field energy W = i Lambda - W'; its coil part is L i^2 / 2, and what the magnet gives leaves through -F_0
    inductance = (flux - base.at(d, 0 * i).flux_linkage) / np.where(i == 0.0, 1.0, i)
    stored = 0.5 * inductance * i**2
    magnet_work = np.trapezoid((force - 0.5 * (base.at(d, i).force - base.at(d, -i).force)) * v, time)
    kinetic = 0.5 * body.mass_kg * (v**2 - v[0] ** 2)
    gravity = body.mass_kg * GRAVITY * (d - d[0])
    left = supplied - heat - (stored[-1] - stored[0]) + gravity[-1] - magnet_work - kinetic[-1]
    assert abs(left) < 2e-3 * supplied


def test_drag_and_bristles_take_energy_and_let_a_still_body_rest(rig_truth, balanced):
    body, current = balanced
    free = moved(rig_truth, body, current, velocity=0.01, steps=20)
    for braked in (replace(body, viscous_N_s_m=0.05), replace(body, coulomb_N=2e-3)):
        path = moved(rig_truth, braked, current, velocity=0.01, steps=20)
        assert 0.0 < path[-1, 1] < free[-1, 1]
    stuck = moved(rig_truth, replace(body, coulomb_N=4e-3, pull_N=1e-3), current, steps=60)
    assert np.abs(stuck[-1, 0] - D) < 1e-5  # bristles of 400 N/m bend by 2.5 um and hold


def test_eddy_paths_delay_the_field_and_leave_the_rest_as_it_is(rig_truth, balanced):
    body, current = balanced
    late = replace(body, eddy_shares=(0.2, 0.1))
    np.testing.assert_allclose(moved(rig_truth, late, current), moved(rig_truth, body, current), atol=1e-9)
    jump = 2.0 * rig_truth.actuator.coil.resistance_ohm * current
    plain, path = (moved(rig_truth, b, current, voltage=jump, steps=4) for b in (body, late))
    assert path[1, 2] > plain[1, 2]  # the current rises faster where the core is shielded
    assert path[1, 3] < path[1, 2]  # and the slow path is behind it


def test_a_filter_before_the_reading_lags_by_its_time_constant(rig_truth, balanced):
    body, current = balanced
    plant = MovingTruth(rig_truth, replace(body, delay_s=2e-3))
    plain = MovingTruth(rig_truth, body)
    state = plant.start(np.array([D]), np.array([current]))
    state[:, 1] = 0.01
    for _ in range(24):
        state = plant.step(state, np.array([rig_truth.actuator.coil.resistance_ohm * current]), 0.5e-3)
    earlier = state.copy()
    earlier[:, 0] -= state[:, 1] * 2e-3
    now, then = plain.hall_output(state), plain.hall_output(earlier)
    assert plant.hall_output(state)[0] == pytest.approx(then[0], abs=0.2 * abs(now[0] - then[0]))


def test_every_effect_of_no_size_leaves_the_body_as_it_is(rig_truth, balanced):
    body, current = balanced
    reference = moved(rig_truth, body, current, velocity=0.01, steps=10)
    for name, effect in SERIES_EFFECTS.items():
        same = effect.change(body, 0.0, np.random.default_rng(1))
        np.testing.assert_allclose(
            moved(rig_truth, same, current, velocity=0.01, steps=10)[:, :3], reference[:, :3], atol=1e-12, err_msg=name
        )
