"""Impedances as users type them: compare, diagnose and suggest with what the file does not say."""

import json

import pandas as pd
import pytest

from femfit.effects.catalogue import all_effects
from femfit.effects.effect import AddedEffect
from femfit.model.json_file import write_model
from support.command import femfit
from support.impedances import impedance_file


@pytest.fixture(scope="module")
def folder(levitation_model, tmp_path_factory):
    path = tmp_path_factory.mktemp("impedance")
    write_model(levitation_model, path / "model.json")
    lag = AddedEffect(all_effects()["eddy_current_lag"], {"ring_share": 0.2, "diffusion_share": 0.0, "time_s": 2e-3})
    impedance_file(levitation_model, path / "z.csv", [lag])
    return path


def test_compare_says_where_and_draws_it(folder):
    files = ("--json", folder / "c.json", "--pictures", folder / "pictures")
    done = femfit("compare", folder / "model.json", folder / "z.csv", *files)
    assert done.returncode == 0, done.stderr
    assert "above" in done.stdout
    assert "% of |Z|" in done.stdout
    data = json.loads((folder / "c.json").read_text())
    assert {one["largest"]["frequency_Hz"] is not None for one in data["channels"]} == {True}
    assert len(list((folder / "pictures").iterdir())) > 2


def test_diagnose_names_the_lag_and_reports_it(folder):
    done = femfit(
        "diagnose", folder / "model.json", folder / "z.csv", "--bootstrap", "0", "--report", folder / "d.html"
    )
    assert done.returncode == 0, done.stderr
    assert "Missing: eddy_current_lag" in done.stdout
    assert "eddy_current_lag" in (folder / "d.html").read_text()


def test_add_puts_it_into_the_model(folder):
    done = femfit("add", folder / "model.json", "eddy_current_lag", folder / "z.csv", "-o", folder / "more.json")
    assert done.returncode == 0, done.stderr
    again = femfit("compare", folder / "more.json", folder / "z.csv")
    assert "agrees with these data within their noise" in again.stdout


def test_a_sweep_without_a_column_of_the_distance_takes_it_from_an_option(folder):
    rows = pd.read_csv(folder / "z.csv")
    rows = rows[(rows["gap [mm]"] == rows["gap [mm]"].min()) & (rows["Bias [A]"] == 0.0)]
    distance = rows["gap [mm]"].iloc[0]
    rows.drop(columns=["gap [mm]", "Bias [A]"]).to_csv(folder / "one.csv", index=False)
    refused = femfit("compare", folder / "model.json", folder / "one.csv")
    assert refused.returncode == 1
    assert "--setting distance_mm" in refused.stderr
    done = femfit("compare", folder / "model.json", folder / "one.csv", "--setting", f"distance_mm={distance}")
    assert done.returncode == 0, done.stderr
    assert "taken for 0 A" in done.stdout
    wrong = femfit("compare", folder / "model.json", folder / "one.csv", "--setting", "distance_mm=two")
    assert wrong.returncode == 2
    assert "must be a number" in wrong.stderr
