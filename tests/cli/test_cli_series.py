"""A record over time, as ``femfit simulate`` writes it, through compare, diagnose, add and suggest."""

import json
from dataclasses import replace

import pytest

from femfit.effects.catalogue import effect_by_name
from femfit.effects.effect import AddedEffect
from femfit.model.json_file import read_model, write_model
from femfit.model.with_effects import with_effects
from support.command import femfit

IDEAL = ("--column", "true_distance_m=distance_m", "--column", "true_current_A=current_A")
"""Instruments of distance and current without noise, which the rig of the Hall element does not have."""

CHANNELS = ["force_balance_N", "voltage_balance_V", "hall_V"]


@pytest.fixture(scope="module")
def files(levitation_model, tmp_path_factory):
    """A model, a plant with friction, and a loop around each."""
    folder = tmp_path_factory.mktemp("series")
    model = replace(levitation_model, sample_time_s=1e-3)
    friction = AddedEffect(effect_by_name("viscous_friction"), {"damping_per_s": 3.0})
    write_model(model, folder / "model.json")
    write_model(with_effects(model, [friction]), folder / "plant.json")
    for name, plant in (("clean.csv", "model.json"), ("record.csv", "plant.json")):
        done = femfit(
            "simulate", folder / "model.json", "--plant", folder / plant, "--runs", 2, "--seconds", 2,
            "--csv", folder / name,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
    return folder


def test_a_simulated_record_agrees_with_its_own_model(files):
    done = femfit("compare", files / "model.json", files / "clean.csv", *IDEAL, "--json", files / "c.json")
    assert done.returncode == 0, done.stderr
    assert "The model agrees with these data" in done.stdout
    data = json.loads((files / "c.json").read_text())
    assert [one["channel"] for one in data["channels"]] == CHANNELS
    assert {one["noise_source"] for one in data["channels"]} == {"samples"}


def test_friction_in_the_plant_is_named_from_the_record_and_reported(files):
    done = femfit(
        "diagnose", files / "model.json", files / "record.csv", *IDEAL, "--bootstrap", 0, "--json", files / "d.json",
        "--report", files / "d.html",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "Where: Measured force that the motion shows" in done.stdout
    data = json.loads((files / "d.json").read_text())
    assert data["verdict"] in {"named", "form_insufficient"}
    assert "viscous_friction" in data["missing"][0]["class"]
    page = (files / "d.html").read_text(encoding="utf-8")
    assert "windows of a recorded motion" in page
    assert "re-mount" not in page.partition("Noise of a single reading")[2].partition("</table>")[0]


def test_the_error_falls_to_the_noise_on_the_run_left_out_once_friction_is_added(files):
    done = femfit(
        "add", files / "model.json", "viscous_friction", files / "record.csv", *IDEAL, "-o", files / "new.json",
        "--base", "never", "--json", files / "a.json",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    data = json.loads((files / "a.json").read_text())
    name = CHANNELS[0]
    assert data["left_out"][name] < 0.2 * data["error_fall"][name]["rms_before"]
    (added,) = read_model(files / "new.json").effects
    assert added.parameters["damping_per_s"] == pytest.approx(3.0, rel=0.02)  # no sensor noise but the Hall element's
    done = femfit("compare", files / "new.json", files / "record.csv", *IDEAL)
    assert "The model agrees with these data" in done.stdout


def test_suggest_tells_what_isolates_what_a_record_leaves_together(files):
    done = femfit("suggest", files / "model.json", files / "record.csv", *IDEAL)
    assert done.returncode == 0, done.stderr
    assert "viscous_friction: " in done.stdout or "nothing to separate" in done.stdout


def test_a_record_without_distances_is_refused_with_the_remedy(files):
    for command in ("compare", "diagnose"):
        done = femfit(command, files / "model.json", files / "record.csv")
        assert done.returncode == 1
        assert "lacks current_A and distance_m" in done.stderr
