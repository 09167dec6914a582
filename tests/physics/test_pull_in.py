"""A solenoid that saturates pulls in: the model against time steps of the nonlinear field."""

import numpy as np
import pytest

import femfit as ff
from femfit.device.load import actuator_from_toml
from femfit.field.nonlinear_system import BiasedSystem
from support.pull_in import FAR, FLAT, PullIn, arrival, switched_field, switched_model

STEP = 2e-4


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    return ff.fit_model(ff.run_sweep(actuator_from_toml(FLAT), tmp_path_factory.mktemp("flat"), workers=2)).model


@pytest.mark.nightly
def test_without_conductors_the_model_switches_with_the_field(model):
    times, distances, currents, *_ = switched_field(12.0, STEP, conducts=False)
    end, found = switched_model(model.without_eddies, 12.0, times)
    assert end == pytest.approx(arrival(times, distances), rel=0.003)
    before = times < 0.95 * end
    assert np.abs(found - currents)[before].max() < 0.01 * currents.max()


@pytest.mark.nightly
@pytest.mark.parametrize("volts", [6.0, 12.0, 24.0])
def test_solid_steel_switches_late_and_the_model_says_by_how_much(model, volts):
    times, distances, currents, *_ = switched_field(volts, STEP * 12.0 / volts)
    exact = arrival(times, distances)
    late, found = switched_model(model, volts, times)
    static, plain = switched_model(model.without_eddies, volts, times)
    assert static < 0.97 * exact  # 3 to 6 % early
    assert abs(late - exact) < min(0.03 * exact, 0.6 * abs(static - exact))
    early = times < 0.8 * exact
    off, unlagged = (np.abs(one - currents)[early].max() / currents.max() for one in (found, plain))
    assert off < 0.75 * unlagged


def test_the_field_in_time_ends_in_the_static_state():
    actuator = actuator_from_toml(FLAT)
    field = PullIn(actuator, [FAR], 2, 30.0)
    _, distances, currents, flux, force = field.run(2.0, FAR, np.geomspace(1e-4, 0.1, 24))
    assert set(distances) == {FAR}
    assert currents[-1] == pytest.approx(2.0 / actuator.circuits[0].resistance_ohm, rel=1e-4)
    held = BiasedSystem(field.moving, actuator, 2)
    held.bias = currents[-1:]
    at_rest = held.evaluate()
    assert flux[-1] == pytest.approx(at_rest.flux_linkage[0, 0], rel=1e-4)
    assert force[-1] == pytest.approx(at_rest.force[0, 0], rel=1e-3)
    assert (np.diff(flux) > 0.0).all()
