"""Which numbers of a drawing are calibrated after what a diagnosis names: never one that the data do not tell."""

from types import SimpleNamespace

import pytest

from femfit.core.errors import TableError
from femfit.identify.calibration import choose
from femfit.identify.calibration.choose import Choice, Named, first_choice, next_choice, with_named
from femfit.identify.calibration.suspects import suspects
from support.small_drawing import SMALL

KNOWN = suspects(SMALL, "small.toml")
HEIGHT, RADIUS = "moving.regions.magnet.z_mm[1]", "moving.regions.magnet.r_mm[1]"


def number(key):
    (found,) = (one for one in KNOWN if one.key == key)
    return found


def diagnosis(*missing, verdict="nothing_missing"):
    return SimpleNamespace(missing=missing, verdict=verdict)


@pytest.fixture(autouse=True)
def advice(monkeypatch):
    monkeypatch.setattr(choose, "_advice", lambda *_: "Read the field at 20 mm.")
    monkeypatch.setattr(choose, "verdict_sentence", lambda found: f"The verdict is {found.verdict}.")


def test_a_number_is_calibrated_with_the_effects_named_beside_it():
    choice = first_choice(diagnosis(Named((HEIGHT,), None), Named(("hall_offset", "hall_gain"), (2, 3))), KNOWN, None)
    assert [one.key for one in choice.numbers] == [HEIGHT]
    assert choice.beside == ("hall_offset",)
    assert choice.runs == {"hall_offset": (2, 3)}
    assert choice.remarks == ("hall_offset was fitted beside; hall_gain would give the same readings.",)


def test_a_class_of_numbers_is_calibrated_as_a_whole_and_what_separates_it_is_said():
    choice = first_choice(diagnosis(Named((HEIGHT, RADIUS), None)), KNOWN, None)
    assert [one.key for one in choice.numbers] == [HEIGHT, RADIUS]
    (remark,) = choice.remarks
    assert f"do not say which is wrong: {HEIGHT} or {RADIUS}." in remark
    assert remark.endswith("Read the field at 20 mm.")


def test_the_only_magnets_remanence_is_a_number_of_the_drawing():
    choice = first_choice(diagnosis(Named(("remanence", "turns"), None)), KNOWN, None)
    assert [one.key for one in choice.numbers] == ["materials.hard.remanence_T", "coils.coil.turns"]
    assert [one.tolerance for one in choice.numbers] == pytest.approx([0.018, 0.5])  # 1.5 and 0.5 %


def test_a_class_of_a_number_and_an_effect_decides_nothing():
    with pytest.raises(TableError, match=r"r_mm\[1\] or coil_temperature .* 20 mm\. Nothing is written"):
        first_choice(diagnosis(Named((RADIUS, "coil_temperature"), None)), KNOWN, None)


def test_whoever_asks_for_a_number_decides_its_class():
    asked = Choice((number(RADIUS),))
    choice = with_named(asked, [Named(("coil_temperature", RADIUS), None)], KNOWN, str, asked=True)
    assert choice == asked
    choice = with_named(asked, [Named((HEIGHT,), None), Named(("friction",), None)], KNOWN, str, asked=True)
    assert choice.numbers == asked.numbers
    assert choice.beside == ("friction",)
    assert choice.remarks == (f"{HEIGHT} is named as well; it was not asked for and stays as drawn.",)


def test_nothing_is_calibrated_where_no_number_is_named():
    with pytest.raises(TableError, match=r"nothing is written\. The verdict is unexplained"):
        first_choice(diagnosis(verdict="unexplained"), KNOWN, None)
    with pytest.raises(TableError, match=r"hall_offset, is no number of the drawing: .* femfit add"):
        first_choice(diagnosis(Named(("hall_offset",), None)), KNOWN, None)
    with pytest.raises(TableError, match=r"from run 2 to run 3 alone"):
        first_choice(diagnosis(Named((HEIGHT,), (2, 3))), KNOWN, None)


def test_what_a_calibrated_drawing_leaves_is_taken_up_or_said():
    fit = SimpleNamespace(effects=[SimpleNamespace(effect=SimpleNamespace(name="hall_offset"), runs=(0, 1))])
    classes = (("hall_offset",), (HEIGHT, "friction"))
    decision = SimpleNamespace(classes=classes, chosen=SimpleNamespace(fit=fit))
    choice = next_choice(Choice((number(RADIUS),)), decision, KNOWN, asked=False)
    assert choice.numbers == (number(RADIUS),)
    assert choice.runs == {"hall_offset": (1, 2)}
    (remark,) = choice.remarks
    assert remark.startswith(f"Not fitted, since these data do not say what it is: {HEIGHT} or friction")
    assert choice.undecided == ()
