"""The signature of every effect, as the pages of the documentation draw it."""

import numpy as np
import pytest

from effect_signature import effect_signature
from femfit.effects.catalogue import BUILT_IN


@pytest.mark.parametrize("effect", BUILT_IN, ids=lambda effect: effect.name)
def test_every_effect_changes_some_reading(effect, levitation_model):
    signature = effect_signature(levitation_model, effect.name, distances=5, currents=4)
    assert signature.visible
    assert all(np.isfinite(change).all() and change.shape == (5, 4) for change in signature.change.values())


def test_friction_shows_in_the_acceleration_and_a_late_sensor_does_not(levitation_model):
    friction, late = (effect_signature(levitation_model, name) for name in ("viscous_friction", "sensor_delay"))
    np.testing.assert_allclose(
        friction.change["acceleration_m_s2"], -0.1 * friction.parameters["damping_per_s"], rtol=1e-9
    )
    assert late.visible == ("hall_V",)
