"""Which numbers of a drawing are calibrated after what a diagnosis names, and what users may call them."""

from pathlib import Path
from types import SimpleNamespace

import pytest

from femfit.core.errors import TableError, UsageError
from femfit.effects.catalogue import effect_by_name
from femfit.identify.calibration import calibrate
from femfit.identify.calibration.calibrate import _diagnosed
from femfit.identify.calibration.numbers import Choice, Drawing, with_named
from support.small_drawing import SMALL

DRAWING = Drawing(SMALL, "small.toml", Path())
KNOWN = DRAWING.suspects
HEIGHT, RADIUS = "moving.regions.magnet.z_mm[1]", "moving.regions.magnet.r_mm[1]"


def number(key):
    (found,) = DRAWING.wanted(key)
    return found


def decision(*classes, **runs):
    """Named are these classes; effects act in runs that are counted from 0."""
    effects = [SimpleNamespace(effect=SimpleNamespace(name=names[0]), runs=runs.get(names[0])) for names in classes]
    return SimpleNamespace(classes=classes, chosen=SimpleNamespace(fit=SimpleNamespace(effects=effects)))


def found(named):
    """A diagnosis with this decision."""
    return SimpleNamespace(decision=named, observations=SimpleNamespace(nominal=SimpleNamespace(drawn=())))


def test_a_number_is_calibrated_with_the_effects_named_beside_it():
    choice = with_named(Choice(), decision((HEIGHT,), ("hall_offset", "hall_gain"), hall_offset=(1, 2)), KNOWN)
    assert choice.numbers == (number(HEIGHT),)
    assert choice.beside == {"hall_offset": (2, 3)}
    assert choice.remarks == {"hall_offset": "hall_offset was fitted beside; hall_gain would give the same readings."}


def test_a_class_of_numbers_is_calibrated_as_a_whole_and_what_separates_it_is_said():
    choice = with_named(Choice(), decision((HEIGHT, RADIUS)), KNOWN)
    assert choice.numbers == (number(HEIGHT), number(RADIUS))
    (remark,) = choice.remarks.values()
    assert f"do not say which is wrong: {number(HEIGHT).subject} or {number(RADIUS).subject}." in remark
    assert remark.endswith(f"Measure {number(HEIGHT).subject} on the device itself.")


def test_the_only_magnets_remanence_is_a_number_of_the_drawing():
    choice = with_named(Choice(), decision(("remanence", "turns")), KNOWN)
    assert [one.key for one in choice.numbers] == ["materials.hard.remanence_T", "coils.coil.turns"]
    assert [one.deviation for one in choice.numbers] == pytest.approx([0.018, 0.5])  # 1.5 and 0.5 %


@pytest.mark.parametrize("names", [("magnet_temperature", "remanence"), ("remanence", "magnet_temperature")])
def test_of_a_number_and_an_effect_the_drawings_is_calibrated_and_the_other_is_said(names):
    choice = with_named(Choice(), decision(names), KNOWN)
    assert [one.key for one in choice.numbers] == ["materials.hard.remanence_T"]
    assert not choice.beside
    (remark,) = choice.remarks.values()
    assert (
        "the remanence of hard was fitted, as the drawing's. magnet_temperature, not in the drawing, would give"
        in remark
    )
    assert remark.endswith(effect_by_name("magnet_temperature").check)


def test_whoever_asks_for_a_number_decides_its_class():
    asked = Choice((number(RADIUS),))
    assert with_named(asked, decision(("coil_temperature", RADIUS)), KNOWN, asked=True) == asked
    choice = with_named(asked, decision((HEIGHT,), ("coulomb_friction",)), KNOWN, asked=True)
    assert choice.numbers == asked.numbers
    assert choice.beside == {"coulomb_friction": None}
    assert choice.remarks == {
        HEIGHT: f"{number(HEIGHT).subject} is named as well; it was not asked for and stays as drawn."
    }


def test_a_remark_goes_with_the_effect_that_it_is_about():
    choice = with_named(Choice(), decision((HEIGHT, RADIUS), ("hall_offset", "hall_gain")), KNOWN)
    assert set(choice.remarks) == {HEIGHT, "hall_offset"}
    assert set(choice.without(choice.beside).remarks) == {HEIGHT}
    assert not choice.without(["hall_offset"]).beside
    both = with_named(Choice(), decision((HEIGHT, "coulomb_friction", RADIUS)), KNOWN)
    assert both.numbers == (number(HEIGHT), number(RADIUS))
    assert "say which is wrong" in both.remarks[HEIGHT]
    assert "coulomb_friction, not in the drawing," in both.remarks[HEIGHT]
    asked = with_named(Choice((number(RADIUS),)), decision((HEIGHT,)), KNOWN, asked=True)
    assert not with_named(asked, decision(), KNOWN, asked=True).remarks  # named no more


def test_nothing_is_calibrated_where_no_number_is_named(monkeypatch):
    monkeypatch.setattr(calibrate, "verdict_sentence", lambda _: "The verdict.")
    with pytest.raises(TableError, match=r"nothing is written\. The verdict\. To fit numbers all the same"):
        _diagnosed(found(None), KNOWN)
    with pytest.raises(TableError, match=r"That is hall_offset and no number; femfit add"):
        _diagnosed(found(decision(("hall_offset",))), KNOWN)
    changing = decision((HEIGHT,), **{HEIGHT: (1, 2)})
    with pytest.raises(TableError, match=r"from run 2 to run 3 alone"):
        _diagnosed(found(changing), KNOWN)


def test_a_number_is_called_by_its_key_path_a_unique_end_of_it_or_as_a_diagnosis_does():
    for key in ("materials.hard.remanence_T", "hard.remanence_T", "remanence_T", "remanence"):
        assert number(key).key == "materials.hard.remanence_T"
    assert number("magnet.z_mm[1]").key == HEIGHT
    assert [one.key for one in DRAWING.wanted(["turns", "resistance"])] == [
        "coils.coil.turns",
        "coils.coil.resistance_ohm",
    ]
    assert DRAWING.wanted("all") == KNOWN


def test_every_number_of_the_signatures_is_accepted_by_key_and_name():
    for one in KNOWN:
        assert {number(key) for key in (one.key, one.name, *one.also)} == {one}


@pytest.mark.parametrize(
    ("key", "words"),
    [
        ("z_mm[1]", r"may be each of .*coils\.coil\.z_mm\[1\].* Give one of these"),
        ("hall_offset", r"is an effect and no number .* --with hall_offset"),
        ("mass_g", r"is no number .*: its field does not depend on it"),
        ("moving.regions.magnet.z_mm[0]", r"is no number .*: it counts from there"),
        ("iron.remanence_T", r"as drawn there is none of it"),
        ("iron.conductivity_MS_per_m", r"its field does not depend on it"),
        ("moving.magnet.height_mm", r"is no number .* Near it: .*moving\.regions\.magnet"),
    ],
)
def test_a_key_that_cannot_be_calibrated_is_refused_with_the_reason(key, words):
    with pytest.raises(UsageError, match=words):
        DRAWING.wanted(key)
