"""``femfit fit`` as users type it."""

import json

import pytest

from femfit.model.json_file import read_model
from femfit.tables.sweep_table import write_sweep_table
from support.command import femfit
from support.sweeps import full_table


@pytest.fixture(scope="module")
def sweep(tmp_path_factory):
    directory = tmp_path_factory.mktemp("sweep")
    write_sweep_table(full_table(), directory)
    return directory


def fit(*arguments):
    return femfit("fit", *arguments)


def test_a_law_is_written_where_asked_with_its_report_as_text_and_json(sweep, tmp_path):
    result = fit(sweep, "--model", "F1e", "-o", tmp_path / "deep" / "m.json", "--json", tmp_path / "r.json")
    assert result.returncode == 0, result.stderr
    assert result.stderr == ""
    first, *_, last = result.stdout.splitlines()
    assert "law F1e" in first
    assert last == f"written: {tmp_path / 'deep' / 'm.json'}"
    assert read_model(tmp_path / "deep" / "m.json").magnetics.law_name == "F1e"
    data = json.loads((tmp_path / "r.json").read_text())
    assert data["model"] == "F1e"
    assert data["model_file"] == str(tmp_path / "deep" / "m.json")


def test_the_coenergy_is_the_default_and_lies_beside_the_table(sweep):
    result = fit(sweep / "sweep.parquet")
    assert result.returncode == 0, result.stderr
    assert f"written: {sweep / 'model_coenergy.json'}" in result.stdout
    assert read_model(sweep / "model_coenergy.json").misfit.force_rms_relative < 1e-3


def test_single_bounds_and_functions_are_read(sweep, tmp_path):
    options = ["--bound", "d^-4=:1e-9", "--bound", "d^-2=0:", "--functions", "constant,through-origin"]
    result = fit(sweep, "--model", "F1e", *options, "-o", tmp_path / "m.json")
    assert result.returncode == 0, result.stderr
    assert read_model(tmp_path / "m.json").magnetics.coefficients[0].bounds[1] == 1e-9


@pytest.mark.parametrize("text", ["d^-4", "d^-4=1", "d^-4=a:b", "d^-4=nan:1"])
def test_a_bound_that_cannot_be_read_says_how_to_write_it(sweep, tmp_path, text):
    result = fit(sweep, "--model", "F1e", "--bound", text, "-o", tmp_path / "m.json")
    assert result.returncode == 2
    assert f"A bound must read COLUMN=LOW:HIGH, for example d^-4=0:1e-8; instead received '{text}'" in result.stderr


def test_a_missing_table_is_an_error_and_a_missing_argument_a_usage_error(tmp_path):
    assert fit(tmp_path / "absent.csv").returncode == 1
    assert fit().returncode == 2
