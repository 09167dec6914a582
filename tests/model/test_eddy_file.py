"""Eddy currents stand in the model file to the last digit, and a damaged section is named."""

import json
from dataclasses import fields, replace

import numpy as np
import pytest

from femfit.core.errors import ModelFileError
from femfit.model.eddy_currents import EddyBias, EddyCurrents
from femfit.model.json_file import model_from_dict, model_to_dict, read_model, write_model
from support.eddies import with_eddies
from support.halves import cut_in_two


@pytest.fixture(params=["one", "two", "none"])
def model(request, levitation_model):
    none = replace(levitation_model, circuits=(), sensor=None)
    known = {"one": levitation_model, "two": cut_in_two(levitation_model), "none": none}
    return with_eddies(known[request.param])


def test_eddy_currents_are_read_as_they_were_written(model, tmp_path):
    write_model(model, tmp_path / "model.json")
    again = read_model(tmp_path / "model.json")
    for field in fields(EddyCurrents):
        before, after = getattr(model.eddy, field.name), getattr(again.eddy, field.name)
        if isinstance(before, np.ndarray):
            assert before.shape == after.shape
            assert before.tobytes() == after.tobytes()
        else:
            assert before == after
    assert again.state_names == model.state_names
    assert again.order == 2 + len(model.circuits) + 3


def test_the_bias_of_eddy_currents_is_kept_and_followed(levitation_model, tmp_path):
    eddied = with_eddies(levitation_model)
    bias = EddyBias(np.array([0.015, 0.045]), np.array([[0.4], [1.0]]), ("core",))
    model = replace(eddied, eddy=replace(eddied.eddy, bias=bias))
    write_model(model, tmp_path / "model.json")
    again = read_model(tmp_path / "model.json").eddy.bias
    assert again.materials == ("core",)
    assert again.at(np.array([0.0, 0.03, 0.045]))[:, 0] == pytest.approx([0.4, 0.7, 1.0])
    assert "linearised at 0.4 to 1.0 A" in str(model)
    more_turns = model.eddy.scaled(1.0, np.array([1.25])).bias
    assert more_turns.current_A == pytest.approx(bias.current_A / 1.25)  # the same ampere-turns
    assert "bias" not in model_to_dict(eddied)["eddy"]


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [("distances_m", [0.045, 0.015], "numbers that grow"), ("current_A", [[1.0]], "as the knots"), ("more", 1, "more")],
)
def test_a_damaged_bias_is_named(levitation_model, key, value, words):
    eddied = with_eddies(levitation_model)
    bias = EddyBias(np.array([0.015, 0.045]), np.array([[0.4], [1.0]]))
    data = model_to_dict(replace(eddied, eddy=replace(eddied.eddy, bias=bias)))
    data["eddy"]["bias"][key] = value
    with pytest.raises(ModelFileError, match=words):
        model_from_dict(json.loads(json.dumps(data)))


def test_a_file_without_eddy_currents_is_as_before(levitation_model):
    assert "eddy" not in model_to_dict(levitation_model)


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("resistances_ohm", [1.0, -1.0, 1.0], "numbers > 0"),
        ("circuits", ["other"], "those of the model"),
        ("couplings", [[[1.0]]], "as the knots and names beside it ask for"),
        ("inductances_H", None, "positive definite"),
        ("names", "eddy", "list of names"),
        ("names", ["eddy_1", "eddy_1", "eddy_2"], "differ from each other"),
        ("names", ["coil", "eddy_1", "eddy_2"], "differ from each other and from the circuits"),
    ],
)
def test_a_damaged_section_is_named(levitation_model, key, value, words):
    data = json.loads(json.dumps(model_to_dict(with_eddies(levitation_model))))
    eddy = data["eddy"]
    eddy[key] = (-np.array(eddy[key])).tolist() if value is None else value
    with pytest.raises(ModelFileError, match=f"eddy.{key} must be .*{words}"):
        model_from_dict(data)


def test_a_printed_model_says_how_many_states_there_are_and_how_true_they_are(levitation_model):
    text = str(with_eddies(levitation_model))
    assert "eddy currents: 3 states, " in text
    assert "from 1.0 Hz to 10 kHz off the field by at most 0.40 % of its impedance, 0.90 % of its force" in text
    assert "eddy" not in str(levitation_model)
