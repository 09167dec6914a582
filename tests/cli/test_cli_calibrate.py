"""``femfit calibrate``: the drawing written anew with its sweep and model, and nothing where nothing can be."""

import json
import tomllib

import numpy as np
import pandas as pd
import pytest

from femfit.device.load import actuator_from_toml
from femfit.field.sweep import run_sweep
from support.actuators import GEOMETRY
from support.command import femfit
from support.small_drawing import SMALL

KEY = "moving.regions.magnet.z_mm[1]"
DRAWN = SMALL.replace("{ start = 4, stop = 12, step = 1 }", "[4, 5, 6, 7, 8, 9.5, 11, 12.5]")


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """One run of a device with a taller magnet, its noise declared."""
    directory = tmp_path_factory.mktemp("calibrate")
    (directory / "small.toml").write_text(DRAWN)
    true = actuator_from_toml(DRAWN.replace("z_mm = [0, 4]", "z_mm = [0, 4.05]"))
    rows = run_sweep(true, directory / "true", workers=1).rows
    noise = 5e-5 * np.random.default_rng(5).standard_normal(len(rows))
    read = rows[["distance_m", "current_A"]].assign(force_N=rows["force_N"] + noise)
    read.to_csv(directory / "bench.csv", index=False)
    read[:0].to_csv(directory / "empty.csv", index=False)
    return directory


def calibrate(place, output, *options, data="bench.csv"):
    where = ("-o", output, "--runs", place / "runs", "--workers", 1)
    return femfit("calibrate", place / "small.toml", place / data, *where, *options)


@pytest.fixture(scope="module")
def done(place):
    options = ("--numbers", KEY, "--with", "force_offset", "--noise", "force_N=5e-5", "--json", place / "result.json")
    return calibrate(place, place / "new.toml", *options)


def test_the_drawing_is_written_with_what_was_changed_above_it(place, done):
    assert done.returncode == 0, done.stderr
    text = (place / "new.toml").read_text()
    first, second, blank, rest = text.split("\n", 3)
    assert first == "# Calibrated by femfit from small.toml and bench.csv:"
    assert second.startswith(f"#   magnet: face at z = 4 mm [{KEY}] = 4.0")
    assert second.endswith(" mm (drawn 4 mm)")
    assert (blank, len(rest.splitlines())) == ("", len(DRAWN.splitlines()))
    written = tomllib.loads(text)["moving"]["regions"]["magnet"]["z_mm"][1]
    (number,) = json.loads((place / "result.json").read_text())["numbers"]
    assert number["value"] == written
    assert abs(written - 4.05) < 3.0 * number["sd_as_drawn"] < 0.03
    assert number["sd"] > number["sd_as_drawn"]


def test_it_says_that_one_run_leaves_nothing_unseen(done):
    assert "There is one run alone, so that no reading was left out of the fit" in done.stdout
    assert "Fitted beside, not in the drawing: force_offset: " in done.stdout


def test_the_next_command_finds_sweep_and_model(place, done):
    command = done.stdout.splitlines()[-1].partition("Next: femfit ")[2].split()
    assert command == ["compare", str(place / "runs" / "calibrated" / "model.json"), str(place / "bench.csv")]
    assert (place / "runs" / "calibrated" / "manifest.json").is_file()
    assert json.loads((place / "runs" / "calibrated" / "model.json").read_text())["effects"]
    assert not json.loads((place / "runs" / "drawn" / "model.json").read_text()).get("effects")


def test_its_own_drawing_is_replaced_and_no_other(place, done):
    mine = place / "mine.toml"
    mine.write_text(DRAWN)
    result = calibrate(place, mine, "--numbers", KEY)
    assert result.returncode == 1
    assert "was not written by femfit" in result.stderr
    assert mine.read_text() == DRAWN
    result = calibrate(place, place / "new.toml", "--numbers", "nothing")
    assert "is no number of this drawing" in result.stderr  # and not that it would replace a file


def test_errors_write_nothing(place, tmp_path):
    target = tmp_path / "new.toml"
    for data, options, code, words in (
        (
            "bench.csv",
            ("--numbers", "moving.magnet.height_mm"),
            2,
            "is no number of this drawing that can be calibrated",
        ),
        ("bench.csv", ("--numbers", KEY, "--with", "nothing_like_it"), 2, "nothing_like_it"),
        ("empty.csv", ("--numbers", KEY), 1, "empty.csv"),
    ):
        result = calibrate(place, target, *options, data=data)
        assert result.returncode == code, result.stderr
        assert words in result.stderr
    result = femfit("calibrate", GEOMETRY / "emaws-variants.toml", place / "bench.csv", "-o", target)
    assert "sweep.parameters must be absent" in result.stderr
    result = femfit("calibrate", place / "small.toml", "-o", target)
    assert "No measurement is given" in result.stderr
    assert not target.exists()


@pytest.fixture(scope="module")
def weak(tmp_path_factory):
    """A device whose magnet is 6 % weaker than drawn, four of the tolerances that are assumed, read with much noise."""
    directory = tmp_path_factory.mktemp("weak")
    (directory / "assumed.toml").write_text(DRAWN)
    declared = DRAWN.replace("[tolerances]", '[tolerances]\n"materials.hard.remanence_T" = 0.2')
    (directory / "declared.toml").write_text(declared)
    true = actuator_from_toml(DRAWN.replace("remanence_T = 1.2", "remanence_T = 1.128"))
    rows = run_sweep(true, directory / "true", workers=1).rows
    rng, tables = np.random.default_rng(11), []
    for run in (1, 2):
        noise = 0.008 * rng.standard_normal(len(rows))
        tables.append(rows[["distance_m", "current_A"]].assign(run=run, force_N=rows["force_N"] + noise))
    pd.concat(tables).to_csv(directory / "bench.csv", index=False)
    return directory


def remanence_of(place, name):
    done = femfit(
        "calibrate", place / f"{name}.toml", place / "bench.csv", "--numbers", "remanence", "--with", "force_offset",
        "--noise", "force_N=0.008", "-o", place / f"{name}-new.toml", "--runs", place / f"runs-{name}", "--workers", 1,
        "--json", place / f"{name}.json",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    (number,) = json.loads((place / f"{name}.json").read_text())["numbers"]
    return number, done.stdout


def test_a_tolerance_that_nobody_declared_is_not_printed_as_an_interval(weak):
    """It holds the number far from the truth, and its width says nothing of that."""
    number, text = remanence_of(weak, "assumed")
    assert number["held"]
    assert abs(number["value"] - 1.128) > 2.0 * number["sd_as_drawn"]
    value, sd = number["by_data"]
    assert abs(value - 1.128) < 2.0 * sd
    (row,) = (line for line in text.splitlines() if line.startswith("  materials.hard.remanence_T"))
    assert "±" not in row
    assert '"materials.hard.remanence_T" = ' in text  # how another one is declared


def test_a_tolerance_that_was_declared_is_taken_as_meant(weak):
    number, _ = remanence_of(weak, "declared")
    assert not number["held"]
    assert abs(number["value"] - 1.128) < 2.0 * number["sd_as_drawn"]
