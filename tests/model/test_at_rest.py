"""Readings at rest whose conditions differ."""

from dataclasses import replace

import numpy as np
import pytest

from femfit.effects.conditions import Conditions
from femfit.model.at_rest import at_rest
from femfit.model.with_effects import nominal_of, with_effects
from support.added_effects import added
from support.model_kinds import states_of

COLD = added("magnet_temperature", coefficient_per_K=-2e-3)
WEAK = added("magnet_demagnetisation", loss=0.1)
LATE = added("eddy_current_lag", ring_share=0.3)


def settings(count=20):
    d, i = np.meshgrid(np.linspace(0.018, 0.04, count), np.linspace(0.1, 1.2, 3))
    return d.ravel(), i.ravel()[:, None]


def test_readings_with_conditions_of_their_own_are_each_that_of_a_model_under_these(levitation_model):
    d, i = settings()
    warm = np.linspace(10.0, 60.0, len(d))
    warm[3] = np.nan  # not recorded
    at = Conditions(nominal_of(levitation_model), magnet_temperature_C=warm)
    found = at_rest(levitation_model, d, i, [COLD, WEAK], at)
    for k in (0, 3, 31):
        known = replace(levitation_model, magnet_temperature_C=float(warm[k]))
        model = with_effects(known, [COLD, WEAK])
        state = model.magnetics.state(d[k], i[k])
        assert found.force[k] == pytest.approx(float(state.force), rel=1e-12)
        assert found.motional_constant[k, 0] == pytest.approx(float(state.motional_constant[0]), rel=1e-12)
        assert found.inductance[k, 0, 0] == pytest.approx(float(state.inductance[0, 0]), rel=1e-12)
        assert found.flux_linkage[k, 0] == pytest.approx(float(model.magnetics.flux_linkage(d[k], i[k])[0]), rel=1e-12)


def test_states_that_the_conditions_know_are_taken_and_others_rest(levitation_model):
    d, i = settings()
    at = Conditions(nominal_of(levitation_model))
    resting = at_rest(levitation_model, d, i, [LATE], at).flux_linkage
    np.testing.assert_allclose(resting, levitation_model.magnetics.flux_linkage(d, i), rtol=1e-12)
    held = replace(at, memory={"eddy_ring": np.full(len(d), 0.2), "eddy_diffusion": np.zeros(len(d))})
    less = 0.3 * 0.2 * at.nominal.peak_current_A
    moved = at_rest(levitation_model, d, i, [LATE], held).flux_linkage
    np.testing.assert_allclose(moved, levitation_model.magnetics.flux_linkage(d, i - less), rtol=1e-12)


def test_without_a_winding_there_are_forces_alone(model_kind):
    magnets = model_kind("magnets")
    states, _ = states_of(magnets, 5)
    found = at_rest(magnets, states[:, 0], np.zeros((5, 0)), [WEAK], Conditions(nominal_of(magnets)))
    plain = magnets.magnetics.force(states[:, 0], np.zeros((5, 0)))
    np.testing.assert_allclose(found.force, 0.81 * plain, rtol=1e-12)
    assert found.inductance.shape == (5, 0, 0)
