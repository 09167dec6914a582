"""Eddy currents in time: a solenoid that pulls in, a step of voltage, and a magnet that a tube brakes."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import femfit as ff
from femfit.device.load import actuator_from_toml
from femfit.field.eddy_probe import EddyProbe
from femfit.field.eddy_sweep import ORDER
from femfit.field.source_fields import SourceFields
from femfit.model.dynamics import state_derivative
from support import falling_magnet as fall
from support.eddy_transient import FieldInTime, mesh_for, pot_step
from support.small_drawing import DRAWINGS

FLAT = (DRAWINGS / "flat-solenoid.toml").read_text(encoding="utf-8")
NEAR, FAR = 0.4e-3, 1.2e-3  # from where to where it is pulled


def switched_field(volts, step):
    """The pull-in of the flat solenoid by the field, as of :meth:`FieldInTime.run`; the first step in fifths."""
    field = FieldInTime(actuator_from_toml(FLAT), np.linspace(NEAR, FAR, 7), 3, 1000.0)
    return field.run(volts, FAR, np.r_[np.full(5, step / 5.0), np.full(1000, step)], until=NEAR)


def switched_model(model, volts, times):
    """The same of a model: when it is there in s, and currents at times."""

    def rates(_, x):
        return state_derivative(model, x[None], np.array([volts]))[0]

    def there(_, x):
        return x[0] - NEAR

    there.terminal = True
    rest = np.zeros(model.order)
    rest[0] = FAR
    found = solve_ivp(
        rates, (0.0, 2.0 * times[-1]), rest, "Radau", events=there, rtol=1e-6, atol=1e-9, dense_output=True
    )
    (end,) = found.t_events[0]
    return end, found.sol(np.minimum(times, end))[2]


STEP = 2e-4


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    return ff.fit_model(ff.run_sweep(actuator_from_toml(FLAT), tmp_path_factory.mktemp("flat"), workers=2)).model


@pytest.mark.nightly
@pytest.mark.parametrize("volts", [6.0, 12.0, 24.0])
def test_solid_steel_switches_late_and_the_model_says_by_how_much(model, volts):
    times, distances, currents, *_ = switched_field(volts, STEP * 12.0 / volts)
    exact = float(np.interp(-NEAR, -distances, times))  # when the body is at the near end
    late, found = switched_model(model, volts, times)
    static, plain = switched_model(model.without_eddies, volts, times)
    assert static < 0.97 * exact  # 3 to 6 % early
    assert abs(late - exact) < min(0.03 * exact, 0.6 * abs(static - exact))
    early = times < 0.8 * exact
    off, unlagged = (np.abs(one - currents)[early].max() / currents.max() for one in (found, plain))
    assert off < 0.75 * unlagged


@pytest.mark.nightly
def test_the_field_in_time_ends_in_the_static_state():
    actuator = actuator_from_toml(FLAT)
    field = FieldInTime(actuator, [FAR], 2, 30.0)
    _, distances, currents, flux, force = field.run(2.0, FAR, np.geomspace(1e-4, 0.1, 24))
    assert set(distances) == {FAR}
    assert currents[-1] == pytest.approx(2.0 / actuator.circuits[0].resistance_ohm, rel=1e-4)
    held = SourceFields(field.moving, actuator, 2)
    held.bias = currents[-1:]
    at_rest = held.evaluate()
    assert flux[-1] == pytest.approx(at_rest.flux_linkage[0, 0], rel=1e-4)
    assert force[-1] == pytest.approx(at_rest.force[0, 0], rel=1e-3)
    assert (np.diff(flux) > 0.0).all()


def test_without_a_winding_there_is_braking_and_nothing_else():
    actuator = fall.drawing()
    found, _ = EddyProbe(actuator, mesh_for(actuator, 0.0, 10.0), 0.0, ORDER).transfers(np.array([10.0]))
    assert found.flux_linkage.shape == (1, 0, 0)
    assert found.force.shape == (1, 1, 0)


@pytest.mark.nightly
def test_a_step_of_voltage_on_a_solid_pot_is_that_of_the_field():
    steps, current, flux = pot_step()
    assert steps < 0.001  # what halving the time steps changes
    assert max(current, flux) < 0.01  # as asked for


@pytest.mark.nightly
def test_a_magnet_falls_through_a_tube_as_fast_as_its_weight_is_braked():
    model, late = fall.fallen()
    distances = np.linspace(-8.9e-3, 8.9e-3, 200)
    braking = (model.eddy.forms(distances, 1)[0].flux_linkage ** 2).sum(axis=-1)
    exact = fall.braking_of_cylinder(fall.RADIUS)
    assert np.abs(braking / exact - 1.0).max() < 0.005  # as asked for, between the sweep's distances too
    weight = fall.MASS * fall.GRAVITY
    assert fall.speed() == pytest.approx(weight / exact, rel=0.002)
    heat = sum(late[name] ** 2 for name in model.eddy_names)  # each of 1 ohm
    mean = np.trapezoid(heat, late["time_s"]) / np.ptp(late["time_s"])
    assert mean == pytest.approx(weight * fall.speed(), rel=0.002)
