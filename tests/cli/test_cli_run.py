"""What ``femfit run`` says of its stages, and of which devices it closes no loop."""

import re
from dataclasses import replace
from pathlib import Path
from time import sleep

import pytest

from femfit.cli import output
from femfit.cli.run import _close_loop, _Steps
from femfit.device.sensors import CurrentSensor, PositionSensor
from support.command import femfit
from support.page import Page
from support.small_drawing import SLEEVED

SHUNT = CurrentSensor(name="shunt", circuit="coil", noise=0.004)
LASER = PositionSensor(name="laser", noise=4e-5, distances_m=(0.0, 1.0), readings=(0.0, 1.0), unit="m")


def studied(monkeypatch, model):
    """Whether a loop is simulated, and why not."""
    calls = []
    monkeypatch.setattr("femfit.simulation.study.closed_loop_study", lambda model, seed: calls.append(model))
    _, why = _close_loop(model, 1, Path("runs/valve/model.json"))
    return bool(calls), why


def test_no_loop_is_closed_where_no_sensor_reads_the_distance(monkeypatch, levitation_model):
    blind = replace(levitation_model, sensor=None, other_sensors=(SHUNT,))
    done, why = studied(monkeypatch, blind)
    assert not done
    assert "femfit simulate runs/valve/model.json" in why
    assert "shunt" in why
    for seeing in (levitation_model, replace(blind, other_sensors=(SHUNT, LASER))):
        assert studied(monkeypatch, seeing) == (True, "")


def test_a_long_stage_says_that_it_goes_on(monkeypatch, capsys):
    monkeypatch.setattr(output, "INTERVAL_S", 0.01)
    with _Steps().timed("rank laws"):
        sleep(0.2)
    assert capsys.readouterr().err.startswith("rank laws, ")


SLOPES = "signatures.parquet"


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    """A directory with a sweep and its signatures, and what the slopes were."""
    directory = tmp_path_factory.mktemp("run")
    (directory / "sleeved.toml").write_text(SLEEVED)
    first = femfit("sweep", "sleeved.toml", "--signatures", "--workers", 1, cwd=directory)
    assert first.returncode == 0, first.stderr
    return directory, (directory / "runs/sleeved" / SLOPES).read_bytes()


@pytest.fixture(scope="module")
def run(swept):
    """What the run said in that directory, and its report."""
    directory, _ = swept
    result = femfit("run", "sleeved.toml", "--workers", 1, cwd=directory)
    assert result.returncode == 0, result.stderr
    return result, Page((directory / "runs/sleeved/report.html").read_text(encoding="utf-8"))


def test_a_run_goes_on_with_the_sweep_that_is_there_and_keeps_its_signatures(swept, run):
    directory, slopes = swept
    result, _ = run
    assert "15 of 15 points were there already" in result.stderr
    assert "anew" not in result.stderr
    assert (directory / "runs/sleeved" / SLOPES).read_bytes() == slopes


def test_only_what_changed_is_said_to_have_changed(swept, run, tmp_path):
    directory, slopes = swept
    text = f"{SLEEVED}[tolerances]\nlength_mm = 0.1\n"
    for drawing, changed in (
        (text, None),
        (text.replace("mass_g = 2", "mass_g = 3"), "the drawing"),
        (text, None),  # whose results were kept
    ):
        (directory / "sleeved.toml").write_text(drawing)
        result = femfit("sweep", "sleeved.toml", "--workers", 1, cwd=directory)
        assert result.returncode == 0, result.stderr
        assert ("anew" in result.stderr) == (changed is not None)
        if changed is not None:
            assert f"last sweep: {changed}" in result.stderr
    assert (directory / "runs/sleeved" / SLOPES).read_bytes() == slopes
    (tmp_path / "sleeved.toml").write_text(SLEEVED)
    for more, said in (((), False), (("--signatures",), True)):
        result = femfit("sweep", "sleeved.toml", "-o", "run", "--workers", 1, *more, cwd=tmp_path)
        assert ("last sweep: the signatures asked for;" in result.stderr) == said


def cells(source, name):
    """The rows of a page's table, as texts."""
    (table,) = re.findall(rf'data-name="{name}">(.*?)</table>', source, re.DOTALL)
    body = table.partition("<tbody>")[2]
    return [re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row) for row in re.findall(r"<tr>(.*?)</tr>", body, re.DOTALL)]


def test_every_part_gives_its_heat_to_the_air_and_none_takes_it_from_there(run):
    """A part that touches the winding alone gives the air none; in the steady state all heat ends there."""
    _, page = run
    rows = {name: values for name, *values in cells(page.source, "heat")}
    heat, given = ([float(values[column]) for values in rows.values()] for column in (2, 4))
    assert rows["sleeve"][4] == "0"
    assert min(given) >= 0.0
    assert sum(given) == pytest.approx(sum(heat), rel=0.01)  # of three digits each


def test_the_report_gives_the_warm_coil_one_temperature_and_the_limit_to_its_hottest_strand(run):
    _, page = run
    (settled,) = set(re.findall(r"the winding settles at ([0-9.]+) °C", page.text))
    assert f"in the coil at {settled} °C give" in page.text
    assert f"the warm one at {settled} °C" in page.text
    (mean, hottest), *_ = (values[:2] for name, *values in cells(page.source, "heat") if name == "coil")
    assert float(mean) < float(hottest) == 130.0
    assert "the hottest strand of coil is then at its limit of 130 °C" in page.text
    rated = {name: values for name, *values in cells(page.source, "coil")}["rated current"]
    assert rated[0] == mean
