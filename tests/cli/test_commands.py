"""Every command from end to end once: what it exits with, what it prints, which files it writes, and their facts."""

import json
import re
import shlex
import tomllib
from itertools import pairwise

import pandas as pd
import pytest

import femfit as ff
from femfit.cli.main import COMMANDS
from femfit.device.load import read_actuator
from femfit.model.json_file import read_model
from femfit.tables.sweep_table import read_sweep_table
from support.cli_case import DRAWN, FACE, ONCE, SLOW
from support.command import worked
from support.page import Page
from support.snapshot import FOLDER, check_snapshot

MORE = re.compile(r"(\d+) more lines? with --verbose\.")
OUTPUTS = {"-o", "--json", "--csv", "--picture", "--report", "--write-noise"}


def result(case, name):
    case.run(name)
    return json.loads((case.folder / f"{name}.json").read_text())


def test_every_command_is_run():
    assert {*ONCE, "trial"} == set(COMMANDS)


@pytest.mark.parametrize("name", [pytest.param(one, marks=[pytest.mark.nightly] * (one in SLOW)) for one in ONCE])
def test_a_command_prints_what_it_printed_and_writes_its_files(case, name, renew):
    done = case.run(name)
    assert "Traceback" not in done.stderr
    assert not {"\x1b", "\r"} & set(done.stdout + done.stderr)  # lines of text where there is no terminal
    for option, written in pairwise(shlex.split(ONCE[name])):
        path = case.folder / written
        if option not in OUTPUTS:
            continue
        assert any(path.iterdir()) if path.is_dir() else path.stat().st_size > 100, written
    if f"--json {name}.json" in ONCE[name]:
        assert result(case, name)["written_by"].startswith("femfit ")
    check_snapshot(f"femfit-{name}", done.stdout, renew=renew)


def test_no_command_prints_more_than_its_answer_and_twelve_lines():
    for path in FOLDER.glob("femfit-*.txt"):
        lines = [line for line in path.read_text().splitlines() if not line.startswith(("written: ", "Next: femfit "))]
        assert len(lines) - bool(MORE.fullmatch(lines[-1])) <= 13, path.name


@pytest.mark.parametrize("name", ["heat", "observe", "diagnose"])
def test_verbose_prints_what_is_left_out_and_changes_nothing_else(case, name):
    short = case.run(name).stdout.splitlines()
    whole = worked(*shlex.split(ONCE[name]), "--verbose", cwd=case.folder).stdout.splitlines()
    cut = [k for k, line in enumerate(short) if MORE.fullmatch(line)]
    assert len(cut) == (name != "heat")
    for k in cut:
        left_out = whole[k : len(whole) - len(short) + k + 1]
        assert (int(MORE.fullmatch(short[k])[1]), left_out[0][0] != " ") == (len(left_out), True)
        short[k : k + 1] = left_out
    assert short == whole


def test_a_sweep_with_signatures_sorts_them_by_what_they_change_and_the_fit_keeps_them(case):
    case.run("fit")
    numbers = json.loads((case.folder / "fit.json").read_text())["drawn"]
    assert {"key", "also", "subject", "value", "unit", "tolerance", "magnetics"} == set(numbers[0])
    assert json.loads((case.folder / "fitted.json").read_text())["model_file"] == "fit.json"
    assert read_model(case.folder / "fit.json").misfit.force_rms_relative < 1e-3
    assert result(case, "sweep")["failed"] == 0


def test_a_point_is_drawn_with_the_sweeps_force(case):
    case.run("sweep")
    data = result(case, "view")
    row = read_sweep_table(case.folder / "runs/small").rows.iloc[1]
    assert (data["distance_m"], data["current_A"]) == (row["distance_m"], row["current_A"])
    assert data["force_N"] == pytest.approx(row["force_N"], rel=5e-4)  # another mesh


def test_a_fem_model_becomes_an_actuator_file_that_says_where_it_comes_from(case):
    data = result(case, "import-fem")
    actuator = read_actuator(case.folder / "pull.toml")
    assert (actuator.name, actuator.sweep.currents_A, len(actuator.sweep.distances_m)) == ("pull-magnet", (2,), 1)
    text = (case.folder / "pull.toml").read_text()
    assert "# block 'Pure Steel' at (r, z) = (2, 9) mm, group 1" in text
    assert "# circuit 'coil': block 'Copper'" in text
    assert (data["kind"], data["current_A"], data["distance_m"], data["mirrored"]) == ("import-fem", 2, 0.004, True)
    assert {finding["code"] for finding in data["findings"]} >= {"mover", "frame", "one-point", "assumed-wire"}


def test_an_export_lists_its_files(case):
    data = result(case, "export")
    assert data["target"] == "estimator"
    assert {"model.json", "estimator.py", "README.md"} <= set(data["files"])
    assert all((case.folder / "package" / name).is_file() for name in data["files"])


def test_a_loop_is_summed_up_and_its_series_written(case):
    data = result(case, "simulate")
    assert (data["outcomes"], data["experiment"]["offset"]) == ({"HELD": 2}, 0.02)
    table = pd.read_csv(case.folder / "loop.csv")
    assert len(table) == 2 * 600
    assert {"run", "time_s", "voltage_V", "true_current_A", "true_distance_m", "hall_V"} <= set(table)


def test_an_observed_log_gives_estimates_of_each_filter_and_a_model_with_its_noise(case):
    assert [one["name"] for one in result(case, "observe")["filters"]] == ["ukf", "ekf"]
    header = (case.folder / "seen.csv").read_text().splitlines()[0]
    assert {"ukf_distance_m", "ekf_deviation_distance_m", "ukf_innovation_laser"} <= set(header.split(","))
    tuned = read_model(case.folder / "tuned.json")
    assert ff.observe(tuned, case.folder / "log.csv", find=False).filters[0].trusted


def test_the_new_model_remembers_its_measurement(case):
    case.run("add")
    model = read_model(case.folder / "more.json")
    assert [one.effect.name for one in model.effects] == ["hall_offset", "distance_offset"]
    assert model.provenance["added"][0]["data"] == "bench.csv"


@pytest.mark.nightly
def test_a_calibrated_drawing_says_above_it_what_was_changed_and_the_next_command_finds_sweep_and_model(case):
    (number,) = result(case, "calibrate")["numbers"]
    text = (case.folder / "calibrated.toml").read_text()
    first, second, blank, rest = text.split("\n", 3)
    assert first == "# Calibrated by femfit from drawn.toml and taller.csv:"
    assert f"[{FACE}] = 4.0" in second
    assert (blank, len(rest.splitlines())) == ("", len(DRAWN.splitlines()))
    written = tomllib.loads(text)["moving"]["regions"]["magnet"]["z_mm"][1]
    assert number["value"] == written
    assert abs(written - 4.05) < 3.0 * number["sd_as_drawn"] < 0.03
    assert number["sd"] > number["sd_as_drawn"]
    line = case.run("calibrate").stdout.splitlines()[-1].partition("femfit ")[2]
    assert line == "compare runs/calibration/calibrated/model.json taller.csv"
    runs = case.folder / "runs/calibration"
    assert (runs / "calibrated/manifest.json").is_file()
    assert json.loads((runs / "calibrated/model.json").read_text())["effects"]
    assert not json.loads((runs / "drawn/model.json").read_text()).get("effects")


def test_a_bench_table_has_one_row_a_plateau_with_branch_noise_and_what_was_assumed(case):
    assert result(case, "bench")["findings"] == []
    rows = ff.read_measurement(case.folder / "flux.csv").rows
    assert len(rows) == 3 * 8 * (2 * 6 - 1)  # the top of a cycle is held twice as long: one plateau
    assert set(rows["branch"]) == {-1.0, 0.0, 1.0}
    notes = tomllib.loads((case.folder / "flux.toml").read_text())
    assert "model.json" in notes["notes"]
    assert notes["noise"]["flux_linkage_Wb"] > 0.0 if "noise" in notes else notes["flux_linkage_Wb"] > 0.0


def test_a_run_goes_on_with_a_sweep_that_is_there_and_keeps_its_signatures(case):
    case.run("slopes")
    path = case.folder / "runs/sleeved/signatures.parquet"
    slopes = path.read_bytes()
    assert "15 of 15 points were there already" in case.run("run").stderr
    assert path.read_bytes() == slopes
    assert len(ff.read_sweep(case.folder / "runs/sleeved").signatures.rows) > 0


def cells(page, name):
    """The rows of a page's table by their first cell, as texts."""
    (table,) = re.findall(rf'data-name="{name}">(.*?)</table>', page.source, re.DOTALL)
    body = re.findall(r"<tr>(.*?)</tr>", table.partition("<tbody>")[2], re.DOTALL)
    rows = [re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row) for row in body]
    return {first: rest for first, *rest in rows}


def test_the_report_gives_the_warm_coil_one_temperature_and_the_limit_to_its_hottest_strand(case):
    case.run("run")
    report = Page((case.folder / "runs/sleeved/report.html").read_text(encoding="utf-8"))
    (settled,) = set(re.findall(r"the winding settles at ([0-9.]+) °C", report.text))
    assert report.text.count(f" at {settled} °C") > 2
    mean, hottest = map(float, cells(report, "heat")["coil"][:2])
    assert mean < hottest == 130.0
