"""``femfit add`` as users type it."""

import json
from hashlib import sha256

import pytest

from femfit.cli.add import add as add_command
from femfit.effects.catalogue import effect_by_name
from femfit.effects.effect import AddedEffect
from femfit.model.json_file import read_model, write_model
from support.campaign import NOISE, campaign
from support.command import femfit


@pytest.fixture(scope="module")
def files(levitation_model, tmp_path_factory):
    folder = tmp_path_factory.mktemp("add")
    write_model(levitation_model, folder / "model.json")
    hidden = [
        AddedEffect(effect_by_name(name), effect_by_name(name).null() | values)
        for name, values in (("hall_offset", {"offset_V": 0.02}), ("distance_offset", {"offset_m": 2e-4}))
    ]
    campaign(levitation_model, 51, hidden, distances=6, currents=5, runs=4).rows.to_csv(folder / "bench.csv")
    return folder


@pytest.fixture(scope="module")
def added(files):
    return femfit(
        "add", files / "model.json", "hall_offset", files / "bench.csv", "-o", files / "new" / "model2.json",
        "--with", "distance_offset", "--json", files / "add.json", "--report", files / "add.html",
    )  # fmt: skip


def test_the_fall_of_the_error_is_printed_and_written(added, files):
    assert added.returncode == 0, added.stderr
    assert all(line.endswith("so far") for line in added.stderr.splitlines())  # on a busy machine
    assert added.stdout.startswith("Added hall_offset and distance_offset")
    data = json.loads((files / "add.json").read_text())
    assert [one["name"] for one in data["added"]] == ["hall_offset", "distance_offset"]
    # 240 readings a channel: 5 % of the rms, as much of the floor
    fall = data["error_fall"]["hall_V"]
    assert fall["rms_after"] == pytest.approx(NOISE["hall_V"], rel=0.2)
    assert fall["after_over_noise"] < 1.15
    assert data["left_out"]["hall_V"] == pytest.approx(NOISE["hall_V"], rel=0.2)


def test_the_report_shows_the_fall_and_names_its_files(added, files):
    page = (files / "add.html").read_text(encoding="utf-8")
    assert 'id="figure-waterfall"' in page
    for file in (files / "model.json", files / "bench.csv"):
        assert sha256(file.read_bytes()).hexdigest() in page


def test_what_was_added_is_not_diagnosed_once_more_for_its_report(files, monkeypatch):
    for place in ("diagnose.diagnose", "diagnose.diagnose_observations"):
        monkeypatch.setattr(f"femfit.identify.decision.{place}", None)  # a call of it would fail
    add_command(
        files / "model.json", "hall_offset", files / "bench.csv", output=files / "b.json", report=files / "b.html"
    )
    assert (files / "b.html").is_file()


def test_the_new_model_remembers_its_measurement_and_simulates_and_exports(added, files):
    new = files / "new" / "model2.json"
    model = read_model(new)
    assert [one.effect.name for one in model.effects] == ["hall_offset", "distance_offset"]
    assert model.provenance["added"][0]["data"] == "bench.csv"
    assert femfit("simulate", new, "--controller", "pid", "--filter", "ukf", "--seconds", 0.1).returncode == 0
    assert femfit("export", new, "--to", "estimator", "-o", files / "package").returncode == 0


def test_an_unknown_effect_is_refused_with_those_that_there_are(files):
    done = femfit("add", files / "model.json", "gremlins", files / "bench.csv", "-o", files / "x.json")
    assert done.returncode == 2
    assert "core_saturation" in done.stderr
    assert not (files / "x.json").exists()


def test_an_output_must_be_given(files):
    assert femfit("add", files / "model.json", "hall_offset", files / "bench.csv").returncode == 2


def test_what_no_effect_explains_is_learnt_by_its_own_name(files, levitation_model):
    def bent(readings, rows):
        return {**readings, "force_N": readings["force_N"] + 0.2 * readings["force_N"] ** 2}

    campaign(levitation_model, 52, distances=7, currents=5, change=bent).rows.to_csv(files / "bent.csv")
    done = femfit(
        "add", files / "model.json", "unexplained", files / "bent.csv", "-o", files / "left.json",
        "--json", files / "left-result.json",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(
        "Added as unexplained, for no cause is known: an error of the force over its own value"
    )
    assert [one.effect.name for one in read_model(files / "left.json").effects] == ["unexplained"]
    said = json.loads((files / "left-result.json").read_text())["remainder"]
    assert said["parts"] == ["force_N"]
    assert said["refutation"]["channel"] == "force_N"
