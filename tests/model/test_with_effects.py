"""A model with effects, those that carry splines too: one co-energy for all channels, and nothing lost in its file."""

import json
import pickle
from dataclasses import replace

import numpy as np
import pytest

from femfit.core.errors import MissingPartError, ModelFileError, UsageError
from femfit.device.electrics import Circuit
from femfit.effects.conditions import Conditions
from femfit.effects.effect import AddedEffect, EffectParameter, EffectPoint
from femfit.model.bspline import DistanceCoordinate, TensorSpline
from femfit.model.carried import Brake, Carried, Curve, FieldTerm, bounded_basis
from femfit.model.dynamics import state_derivative
from femfit.model.hall import HallSpline
from femfit.model.json_file import model_from_dict, model_to_dict
from femfit.model.magnetics import CoenergySpline
from femfit.model.readings import Point, at_rest, predict_readings
from femfit.model.with_effects import coenergy_of, nominal_of, with_effects
from support.added_effects import added
from support.coenergies import partials
from support.eddies import with_eddies
from support.model_kinds import states_of
from support.one_current import flat

SATURATION = added("core_saturation", mmf_loss_3=0.1, mmf_loss_6=0.02)


def mesh_of(low_d, high_d, low_i, high_i, count=9):
    return [x.ravel() for x in np.meshgrid(np.linspace(low_d, high_d, count), np.linspace(low_i, high_i, count))]


@pytest.fixture(scope="module")
def points():
    return mesh_of(0.02, 0.04, 0.2, 1.2, count=5)


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


SHARE = EffectParameter("share", bounds=(-2.0, 2.0), plausible=(0.0, 1.0), description="How much of it is there.")
DEGREE = 4
RANGE_M, RANGE_A = (0.02, 0.04), (0.2, 1.2)


def bounded(rng, *ranges, size):
    """A spline in one variable or two with random coefficients that is constant beyond its data."""
    knots, maps = zip(*(bounded_basis(*one, cells=4, degree=DEGREE) for one in ranges), strict=True)
    free = size * rng.normal(size=[one.shape[1] for one in maps])
    if len(ranges) == 1:
        return Curve("share", knots[0], DEGREE, maps[0] @ free)
    return TensorSpline(knots[0], knots[1], DEGREE, DEGREE, maps[0] @ free @ maps[1].T)


@pytest.fixture(scope="module")
def carried():
    rng, plain = np.random.default_rng(3), DistanceCoordinate(1.0, kind="distance")
    coenergy, hall = (bounded(rng, RANGE_M, RANGE_A, size=size) for size in (1e-5, 1e-3))
    brake = bounded(rng, (0.0, 1.0), size=1e-3)
    return Carried(
        (FieldTerm("share", coenergy=CoenergySpline(plain, coenergy), hall=HallSpline(plain, hall)),),
        {"distance_m": bounded(rng, RANGE_M, size=1e-5)},
        {"force_N": bounded(rng, (0.0, 0.2), size=1e-3)},
        {"force_N": bounded(rng, (0.0, 0.2), size=1e-3)},
        Brake(0.02, Curve("share", brake.knots, DEGREE, np.abs(brake.coefficients))),
        bounded(rng, RANGE_A, size=0.1),
        notes={"law": "none"},
    )


@pytest.fixture(scope="module")
def effect(carried):
    return carried.effect("learnt", "The readings depart smoothly.", [SHARE])


@pytest.fixture(scope="module")
def learnt(levitation_model, effect):
    return with_effects(levitation_model, [AddedEffect(effect, {"share": 1.0})])


def change(effect, base, d, i, order):
    coenergy, at = coenergy_of(base), Conditions(nominal_of(base))

    def added(d, i, h):
        return effect.coenergy(coenergy, EffectPoint(d, i, at, {"share": 1.0}, h)) - coenergy(d, i, h)

    return partials(added, d, i, (order,))[0]


def test_beyond_its_data_it_stays_constant(effect, levitation_model):
    def largest(order, *ends):
        return np.abs(change(effect, levitation_model, *mesh_of(*ends), order)).max()

    inside, far, high = (1e-3, 0.06, -0.8, 2.2, 90), (0.07, 1.0, 0.2, 1.2), (0.02, 0.04, 3.0, 50.0)
    force, flux, field = (1, 0, 0), (0, 1, 0), (0, 0, 1)
    assert largest(force, *inside) > 1e-4
    assert largest(force, *far) < 1e-7  # no force but the rounding of a quartic, 200 cells beyond
    assert largest(flux, *far) <= largest(flux, *inside) * 1.001
    assert largest(flux, *high) < 1e-9
    assert largest(force, *high) <= largest(force, *inside) * 1.001
    assert largest(field, *high) <= largest(field, *inside) * 1.001


def test_the_brake_never_pushes(carried, effect, levitation_model):
    v = np.linspace(-3.0, 3.0, 301)
    at = Conditions(nominal_of(levitation_model), velocity_m_s=v)
    # Towards the electromagnet where the body falls away: its power on the body is -F v
    power = -effect.force(EffectPoint(np.full_like(v, 0.03), np.zeros_like(v), at, {"share": 1.0})) * v
    assert power.max() <= 0.0
    assert power.min() < -1e-5


def test_an_error_that_turns_with_the_branch_is_none_where_no_branch_is_known(carried, levitation_model):
    d, i = mesh_of(0.02, 0.04, 0.1, 1.2)
    turning = Carried(branches=carried.branches)
    only = AddedEffect(turning.effect("turning", "It turns.", [SHARE]), {"share": 1.0})
    at = [Conditions(nominal_of(levitation_model), branch=branch) for branch in (-1, 0, 1)]
    force = [predict_readings(levitation_model, d, i, one, [only])["force_N"] for one in at]
    np.testing.assert_allclose(force[0] + force[2], 2.0 * force[1], rtol=1e-12)
    assert np.abs(force[2] - force[1]).max() > 1e-5


def test_it_survives_the_model_file_and_a_pickle(learnt):
    setting = *mesh_of(0.016, 0.044, 0.0, 1.4), Conditions(nominal_of(learnt))
    read = model_from_dict(json.loads(json.dumps(model_to_dict(learnt))))
    for again in (read, pickle.loads(pickle.dumps(learnt))):  # noqa: S301  its own
        assert model_to_dict(again) == model_to_dict(learnt)
        np.testing.assert_equal(predict_readings(again, *setting), predict_readings(learnt, *setting))


def test_damaged_data_are_refused(learnt):
    data = model_to_dict(learnt)
    term = data["effects"][0]["carried"]["magnetics"][0]
    term["parameter"] = "amount"
    with pytest.raises(ModelFileError, match="parameter must be one of the effect's"):
        model_from_dict(data)
    term["parameter"], curve = "share", data["effects"][0]["carried"]["brake"]["against"]
    curve["coefficients"] = curve["coefficients"][1:]
    with pytest.raises(ModelFileError, match="as the knots and names beside it ask for"):
        model_from_dict(data)
