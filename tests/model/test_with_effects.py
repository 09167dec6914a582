"""A model with effects: one co-energy for all channels, readings at rest, and nothing lost in its file."""

from dataclasses import replace

import numpy as np
import pytest

from femfit.core.errors import MissingPartError, UsageError
from femfit.device.electrics import Circuit
from femfit.effects.conditions import Conditions
from femfit.model.dynamics import state_derivative
from femfit.model.readings import Point, at_rest, predict_readings
from femfit.model.with_effects import nominal_of, with_effects
from support.added_effects import added
from support.eddies import with_eddies
from support.model_kinds import states_of
from support.one_current import flat

SATURATION = added("core_saturation", mmf_loss_3=0.1, mmf_loss_6=0.02)


@pytest.fixture(scope="module")
def points(levitation_model):
    box = levitation_model.validity
    d = np.linspace(box.distance_min_m, box.distance_max_m, 7)[1:-1]
    i = np.linspace(box.current_min_A, box.current_max_A, 7)[1:-1]
    return [x.ravel() for x in np.meshgrid(d, i)]


def test_the_changed_hall_field_is_the_flux_of_a_test_coil(levitation_model, points):
    # dW'/dh of -c g(lambda) is -c g'(lambda) dB/di, by reciprocity of the winding and the test coil; small c: G is g
    d, i = points
    saturation = added("core_saturation", magnet_share=1.0, hall_share=1.0, mmf_loss_3=1e-4)
    nominal, base = nominal_of(levitation_model), levitation_model
    flux = flat(base.magnetics).flux_linkage(d, i) / nominal.flux_linkage_Wb
    expected = -1e-4 * nominal.peak_current_A * flux**2 * flat(base.sensor.field).derivatives(d, i)[2]
    changed, plain = (flat(one.sensor.field).field(d, i) for one in (with_effects(base, [saturation]), base))
    np.testing.assert_allclose(changed - plain, expected, rtol=1e-3)  # the next order in c


def test_no_effects_are_the_base_itself(levitation_model):
    assert with_effects(with_effects(levitation_model, [SATURATION]), []) is levitation_model


@pytest.mark.parametrize(
    ("kind", "names", "message"),
    [
        ("one circuit", ["turns", "turns"], "once; instead received turns twice"),
        ("one circuit", ["turns:coil"], r"has coil; instead received turns:coil. Leave the name of a circuit out"),
        ("halves", ["turns:inner", "resistance:nope"], r"inner, outer; instead received resistance:nope. Name one"),
        ("solenoid", ["external_field"], "must have a Hall element"),
    ],
)
def test_an_effect_that_the_model_has_no_place_for_is_refused(model_kind, kind, names, message):
    with pytest.raises((UsageError, MissingPartError), match=message):
        with_effects(model_kind(kind), [added(name) for name in names]).force(0.02, [0.1, 0.1], extrapolate=True)


def test_another_temperature_changes_what_effects_make_of_the_model(levitation_model):
    effects = [COLD, added("coil_temperature", coefficient_per_K=4e-3)]
    temperatures = {"coil_temperature_C": 80.0, "magnet_temperature_C": 60.0}
    found = replace(with_effects(levitation_model, effects), **temperatures)
    wanted = with_effects(replace(levitation_model, **temperatures), effects)
    assert found.resistances_ohm[0] == wanted.resistances_ohm[0] == pytest.approx(1.24 * 2.69)
    assert found.force(0.022, 0.4) == wanted.force(0.022, 0.4) < 0.95 * levitation_model.force(0.022, 0.4)
    assert found.sensor.output(0.022, np.array([0.4])) == wanted.sensor.output(0.022, np.array([0.4]))


def test_a_driver_without_limits_loses_parts_of_what_holds_the_largest_current(levitation_model):
    endless = replace(levitation_model, circuits=(Circuit(2.69),))
    assert nominal_of(endless).voltage_V == pytest.approx(2.69 * levitation_model.validity.current_max_A)
    lossy = with_effects(endless, [added("driver_dead_zone", dead_zone=0.0, drop=0.0)])
    at = np.array([[0.022, 0.0, 0.4]]), np.ones(1)
    np.testing.assert_array_equal(state_derivative(lossy, *at), state_derivative(endless, *at))


def test_readings_pass_the_stages_in_order(levitation_model, points):
    d, i = points
    stage, offset = added("distance_offset", offset_m=1e-4), added("hall_offset", offset_V=0.02)
    at = Conditions(nominal_of(levitation_model))
    read = predict_readings(levitation_model, d, i, at, [offset, stage, SATURATION])
    plain = predict_readings(with_effects(levitation_model, [SATURATION]), d + 1e-4, i, at)
    np.testing.assert_allclose(read["force_N"], plain["force_N"], rtol=1e-12)
    np.testing.assert_allclose(read["hall_V"], plain["hall_V"] + 0.02, rtol=1e-12)
    np.testing.assert_allclose(read["voltage_V"], levitation_model.circuit.resistance_ohm * i, rtol=1e-12)


COLD = added("magnet_temperature", coefficient_per_K=-2e-3)
WEAK = added("magnet_demagnetisation", loss=0.1)
LATE = added("eddy_current_lag", ring_share=0.3)


def test_readings_with_conditions_of_their_own_are_each_that_of_a_model_under_these(levitation_model, points):
    d, i = points[0], points[1][:, None]
    warm = np.linspace(10.0, 60.0, len(d))
    warm[3] = np.nan  # not recorded
    at = Conditions(nominal_of(levitation_model), magnet_temperature_C=warm)
    found = at_rest(Point(levitation_model, d, i, at, [COLD, WEAK]))
    for k in (0, 3, 21):
        known = replace(levitation_model, magnet_temperature_C=float(warm[k]))
        model = with_effects(known, [COLD, WEAK])
        state = model.magnetics.state(d[k], i[k])
        assert found.force[k] == pytest.approx(float(state.force), rel=1e-12)
        assert found.motional_constant[k, 0] == pytest.approx(float(state.motional_constant[0]), rel=1e-12)
        assert found.inductance[k, 0, 0] == pytest.approx(float(state.inductance[0, 0]), rel=1e-12)
        assert found.flux_linkage[k, 0] == pytest.approx(float(model.magnetics.flux_linkage(d[k], i[k])[0]), rel=1e-12)


def test_states_that_the_conditions_know_are_taken_and_others_rest(levitation_model, points):
    d, i = points[0], points[1][:, None]
    at = Conditions(nominal_of(levitation_model))
    resting = at_rest(Point(levitation_model, d, i, at, [LATE])).flux_linkage
    np.testing.assert_allclose(resting, levitation_model.magnetics.flux_linkage(d, i), rtol=1e-12)
    held = replace(at, memory={"eddy_ring": np.full(len(d), 0.2), "eddy_diffusion": np.zeros(len(d))})
    less = 0.3 * 0.2 * at.nominal.peak_current_A
    moved = at_rest(Point(levitation_model, d, i, held, [LATE])).flux_linkage
    np.testing.assert_allclose(moved, levitation_model.magnetics.flux_linkage(d, i - less), rtol=1e-12)


def test_without_a_winding_there_are_forces_alone(model_kind):
    magnets = model_kind("magnets")
    states, _ = states_of(magnets, 5)
    at = Conditions(nominal_of(magnets))
    found = at_rest(Point(magnets, states[:, 0], np.zeros((5, 0)), at, [WEAK]))
    plain = magnets.magnetics.force(states[:, 0], np.zeros((5, 0)))
    np.testing.assert_allclose(found.force, 0.81 * plain, rtol=1e-12)
    assert found.inductance.shape == (5, 0, 0)
    late = with_effects(replace(magnets, sensor=replace(model_kind("one circuit").sensor)), [added("sensor_delay")])
    assert np.isfinite(state_derivative(late, states, np.zeros((5, 0)))).all()
    rings = with_effects(with_eddies(magnets), [added("turns", turns_error=0.1)])
    assert rings.equations.rates(np.full((rings.order, 1), 0.02), np.zeros(0), np.zeros(3)).shape == (rings.order, 1)
