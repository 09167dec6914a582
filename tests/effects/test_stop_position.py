"""A stop that stands elsewhere than drawn is read where the body rests, and moves the plant's stop."""

from dataclasses import replace

import pytest

from femfit.effects.catalogue import effect_by_name
from femfit.identify.bench import placed
from femfit.identify.decision.diagnose import diagnose
from femfit.identify.signatures import why_untestable
from support.solenoids import solenoid
from support.switching import logged, switched

COMMANDS = [0.0, 0.02, 0.08], [0.0, 12.0, 0.0]


@pytest.fixture(scope="module")
def model():
    return solenoid()


@pytest.fixture(scope="module")
def worn(model):
    """Logs of a device whose near stop stands 0.1 mm further away."""
    near = model.motion.near_stop
    worn = replace(model, motion=replace(model.motion, near_stop=replace(near, distance_m=near.distance_m + 0.1e-3)))
    return logged(
        [switched(*COMMANDS, 0.12, model=worn), switched([0.0, 0.01, 0.07], COMMANDS[1], 0.11, model=worn)], seed=2
    )


def test_a_worn_stop_is_named_with_its_size(model, worn):
    found = diagnose(model, worn)
    assert found.missing[0].name == "stop_position"
    added = found.missing[0].parameters["near"] * (model.validity.distance_max_m - model.validity.distance_min_m)
    assert added == pytest.approx(0.1e-3, abs=0.02e-3)


def test_a_body_without_stops_has_none_to_be_wrong(model, worn):
    free = replace(model, motion=replace(model.motion, near_stop=None, far_stop=None))
    assert "no stop" in why_untestable(effect_by_name("stop_position"), placed(free, worn))
