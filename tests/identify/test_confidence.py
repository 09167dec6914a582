"""What is named is called sure only where a cause outside the catalogue would not have borne the same name."""

import pytest

from femfit.effects.catalogue import effect_by_name
from femfit.effects.effect import AddedEffect
from femfit.identify.decision.diagnose import diagnose
from femfit.identify.decision.diagnosis_text import certainty_sentence
from support.campaign import NOISE, campaign

QUICK = {"bootstrap": 0}


def hidden(name, **parameters):
    effect = effect_by_name(name)
    return AddedEffect(effect, effect.null() | parameters)


@pytest.mark.parametrize(
    "effect",
    [
        pytest.param(hidden("core_saturation", mmf_loss_3=0.02), marks=pytest.mark.long),
        hidden("force_gain", gain_error=0.05),
    ],
    ids=lambda effect: effect.effect.name,
)
def test_a_strong_trace_is_sure_and_no_name_is_where_its_cause_is_withheld(levitation_model, effect):
    table = campaign(levitation_model, 3, [effect])
    found = diagnose(levitation_model, table, **QUICK)
    assert (found.missing[0].name, found.look_alikes, found.confident) == (effect.effect.name, (), True)
    assert certainty_sentence(found).startswith("Certain")
    beside = diagnose(levitation_model, table, **QUICK, exclude=("hall_offset",))
    assert beside.missing[0].name == effect.effect.name
    assert certainty_sentence(beside).startswith("Not certain")
    assert "hall_offset" in certainty_sentence(beside)
    withheld = diagnose(levitation_model, table, **QUICK, exclude=(effect.effect.name,))
    assert withheld.verdict in {"unexplained", "form_insufficient"}
    assert not withheld.confident


def test_a_cause_named_as_its_neighbour_is_not_called_sure(levitation_model):
    table = campaign(levitation_model, 3, [hidden("hall_offset", offset_V=0.02)])
    withheld = diagnose(levitation_model, table, **QUICK, exclude=("hall_offset",))
    assert withheld.verdict in {"unexplained", "named"}
    assert not withheld.confident


def test_force_alone_cannot_make_a_small_gain_sure(levitation_model):
    table = campaign(levitation_model, 3, [hidden("force_gain", gain_error=0.008)], noise={"force_N": NOISE["force_N"]})
    found = diagnose(levitation_model, table, **QUICK)
    assert found.verdict == "named"
    assert "current_gain" in found.look_alikes
    assert {name for one in found.missing for name in one.members[1:]} <= set(found.look_alikes)
    assert not found.confident
    assert found.missing[0].members[1] in certainty_sentence(found)


def test_a_zero_error_is_never_sure_because_no_list_holds_all_its_causes(levitation_model):
    table = campaign(levitation_model, 3, [hidden("constant_force", pull=0.03)])
    alone = diagnose(levitation_model, table, **QUICK, exclude=("force_offset",))
    assert alone.missing[0].name == "constant_force"
    assert not alone.confident
    assert "a constant error of the force" in alone.look_alikes
