"""What a sensor beside the co-energy's own channels sees of a field that effects change."""

import numpy as np
import pytest

from femfit.core.errors import MissingPartError
from femfit.estimate.kalman_filter import kalman_filter
from femfit.fit.build import fit_model
from femfit.model.sensors import sampled_value
from femfit.model.with_effects import with_effects
from support.added_effects import added
from support.bearing import hall_field, table_with_hall
from support.pickups import SHARE, searched

D, AMPERES = np.array([2e-3, 3e-3]), np.array([[0.5], [1.0]])
GAP, CURRENTS = np.array([0.3e-3, 0.6e-3]), np.array([[0.7, -0.4], [-1.0, 0.5]])


def linked(model, d=D, i=AMPERES):
    (search,) = (one for one in model.other_sensors if one.name == "search")
    return search.flux.field(d, i)


def test_a_pickup_coil_is_linked_by_the_true_number_of_turns_of_the_winding():
    model = searched()
    fewer = with_effects(model, [added("turns", turns_error=-0.1)])
    # The winding itself takes the factor twice, by its current and by its own turns
    np.testing.assert_allclose(linked(fewer) / linked(model), 0.9, rtol=1e-9)
    flux = fewer.magnetics.flux_linkage(D, AMPERES) / model.magnetics.flux_linkage(D, AMPERES)
    np.testing.assert_allclose(flux, 0.81, rtol=1e-6)
    np.testing.assert_allclose(linked(model), SHARE * model.magnetics.flux_linkage(D, AMPERES)[:, 0], rtol=1e-3)


def test_effects_reach_the_measurement_of_a_filter_that_reads_a_pickup_coil():
    model = searched(noise=1e-3)
    states = np.array([[2e-3, 0.1, 0.5], [3e-3, -0.1, 1.0]])
    fewer = with_effects(model, [added("turns", turns_error=-0.1)])
    base, changed = (kalman_filter(one, sensors=("search",)).process.begun(states) for one in (model, fewer))
    np.testing.assert_allclose(changed[:, 3:], 0.9 * base[:, 3:])


def test_turns_and_remanence_scale_a_hall_elements_field_of_several_circuits():
    model = fit_model(table_with_hall()).model
    circuits = [added("turns:upper", turns_error=0.2), added("remanence", remanence_error=-0.1)]
    changed = with_effects(model, circuits)
    idle = hall_field(GAP, np.zeros((2, 2)))
    expected = 0.9 * idle + hall_field(GAP, CURRENTS * [1.0, 1.2]) - idle
    np.testing.assert_allclose(changed.sensor.field.field(GAP, CURRENTS), expected, rtol=1e-9)
    assert changed.without_effects.sensor is model.sensor


def test_an_effect_that_is_not_followed_to_a_pickup_coil_is_named_when_the_coil_is_read():
    model = with_effects(searched(), [added("core_saturation", mmf_loss_3=0.1)])
    assert model.magnetics.force(D, AMPERES).shape == (2,)
    (search,) = (one for one in model.other_sensors if one.name == "search")
    with pytest.raises(MissingPartError, match=r"pickup coil 'search'.*core_saturation"):
        sampled_value(model, search, np.array([[2e-3, 0.0, 0.5]]))
