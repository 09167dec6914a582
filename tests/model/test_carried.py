"""An effect that carries splines: one co-energy for all channels, constant beyond its data, nothing lost on the way."""

import json
import pickle

import numpy as np
import pytest

from femfit.core.errors import ModelFileError
from femfit.effects.conditions import Conditions
from femfit.effects.effect import AddedEffect, EffectParameter, EffectPoint
from femfit.model.bspline import DistanceCoordinate, TensorSpline
from femfit.model.carried import Brake, Carried, Curve, FieldTerm, bounded_basis
from femfit.model.hall import HallSpline
from femfit.model.json_file import model_from_dict, model_to_dict
from femfit.model.magnetics import CoenergySpline
from femfit.model.readings import predict_readings
from femfit.model.with_effects import coenergy_of, nominal_of, with_effects
from support.coenergies import partials

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
def model(levitation_model, effect):
    return with_effects(levitation_model, [AddedEffect(effect, {"share": 1.0})])


def points(low_d, high_d, low_i, high_i, count=9):
    return [x.ravel() for x in np.meshgrid(np.linspace(low_d, high_d, count), np.linspace(low_i, high_i, count))]


def change(effect, base, d, i, order):
    coenergy, at = coenergy_of(base), Conditions(nominal_of(base))

    def added(d, i, h):
        return effect.coenergy(coenergy, EffectPoint(d, i, at, {"share": 1.0}, h)) - coenergy(d, i, h)

    return partials(added, d, i, (order,))[0]


def test_beyond_its_data_it_stays_constant(effect, levitation_model):
    def largest(order, *ends):
        return np.abs(change(effect, levitation_model, *points(*ends), order)).max()

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
    d, i = points(0.02, 0.04, 0.1, 1.2)
    turning = Carried(branches=carried.branches)
    only = AddedEffect(turning.effect("turning", "It turns.", [SHARE]), {"share": 1.0})
    at = [Conditions(nominal_of(levitation_model), branch=branch) for branch in (-1, 0, 1)]
    force = [predict_readings(levitation_model, d, i, one, [only])["force_N"] for one in at]
    np.testing.assert_allclose(force[0] + force[2], 2.0 * force[1], rtol=1e-12)
    assert np.abs(force[2] - force[1]).max() > 1e-5


def test_it_survives_the_model_file_and_a_pickle(model):
    setting = *points(0.016, 0.044, 0.0, 1.4), Conditions(nominal_of(model))
    read = model_from_dict(json.loads(json.dumps(model_to_dict(model))))
    for again in (read, pickle.loads(pickle.dumps(model))):  # noqa: S301  its own
        assert model_to_dict(again) == model_to_dict(model)
        np.testing.assert_equal(predict_readings(again, *setting), predict_readings(model, *setting))


def test_damaged_data_are_refused(model):
    data = model_to_dict(model)
    term = data["effects"][0]["carried"]["magnetics"][0]
    term["parameter"] = "amount"
    with pytest.raises(ModelFileError, match="parameter must be one of the effect's"):
        model_from_dict(data)
    term["parameter"], curve = "share", data["effects"][0]["carried"]["brake"]["against"]
    curve["coefficients"] = curve["coefficients"][1:]
    with pytest.raises(ModelFileError, match="as the knots and names beside it ask for"):
        model_from_dict(data)
