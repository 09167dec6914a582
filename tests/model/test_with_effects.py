"""A model with effects: one co-energy for all channels, and nothing lost in its file."""

import numpy as np
import pytest

from femfit.effects.conditions import Conditions
from femfit.model.readings import predict_readings
from femfit.model.with_effects import coenergy_of, nominal_of, with_effects
from support.added_effects import added
from support.coenergies import partials
from support.one_current import flat

SATURATION = added("core_saturation", mmf_loss_3=0.1, mmf_loss_6=0.02)


@pytest.fixture(scope="module")
def points(levitation_model):
    box = levitation_model.validity
    d = np.linspace(box.distance_min_m, box.distance_max_m, 7)[1:-1]
    i = np.linspace(box.current_min_A, box.current_max_A, 7)[1:-1]
    return [x.ravel() for x in np.meshgrid(d, i)]


def test_the_base_coenergy_is_the_model(levitation_model, points):
    d, i = points
    d_w, ii_w, h_w = partials(coenergy_of(levitation_model), d, i, ((1, 0, 0), (0, 2, 0), (0, 0, 1)))
    np.testing.assert_allclose(-d_w, flat(levitation_model.magnetics).force(d, i), rtol=1e-12)
    np.testing.assert_allclose(ii_w, flat(levitation_model.magnetics).inductance(d, i), rtol=1e-12)
    np.testing.assert_allclose(h_w, flat(levitation_model.sensor.field).field(d, i), rtol=1e-12)


def test_the_changed_hall_field_is_the_flux_of_a_test_coil(levitation_model, points):
    # dW'/dh of -c g(lambda) is -c g'(lambda) dB/di, by reciprocity of the winding and the test coil; small c: G is g
    d, i = points
    saturation = added("core_saturation", magnet_share=1.0, hall_share=1.0, mmf_loss_3=1e-4)
    nominal, base = nominal_of(levitation_model), levitation_model
    expected = (
        -1e-4
        * nominal.peak_current_A
        * (flat(base.magnetics).flux_linkage(d, i) / nominal.flux_linkage_Wb) ** 2
        * flat(base.sensor.field).derivatives(d, i)[2]
    )
    change = flat(with_effects(levitation_model, [saturation]).sensor.field).field(d, i) - flat(
        base.sensor.field
    ).field(d, i)
    np.testing.assert_allclose(change, expected, rtol=1e-3)  # the next order in c


def test_no_effects_are_the_base_itself(levitation_model):
    assert with_effects(with_effects(levitation_model, [SATURATION]), []) is levitation_model


def test_readings_pass_the_stages_in_order(levitation_model, points):
    d, i = points
    stage, offset = added("distance_offset", offset_m=1e-4), added("hall_offset", offset_V=0.02)
    at = Conditions(nominal_of(levitation_model))
    read = predict_readings(levitation_model, d, i, at, [offset, stage, SATURATION])
    plain = predict_readings(with_effects(levitation_model, [SATURATION]), d + 1e-4, i, at)
    np.testing.assert_allclose(read["force_N"], plain["force_N"], rtol=1e-12)
    np.testing.assert_allclose(read["hall_V"], plain["hall_V"] + 0.02, rtol=1e-12)
    np.testing.assert_allclose(read["voltage_V"], levitation_model.circuit.resistance_ohm * i, rtol=1e-12)
