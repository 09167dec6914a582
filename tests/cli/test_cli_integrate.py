"""``femfit integrate`` as users type it."""

import json

import numpy as np
import pandas as pd
import pytest

from femfit.estimate.integrate.experiment import ExperimentInputs, synthesise
from support.command import femfit

AREA = "0.059394"


def table(experiment):
    record = experiment.record
    return pd.DataFrame(
        {
            "time_s": record.time,
            "coil_voltage_V": record.voltage,
            "hall_T": record.hall,
            "current_A": record.current,
        }
    )


@pytest.fixture(scope="module")
def experiment():
    inputs = ExperimentInputs(amplitudes=(320.0, 200.0), plateau=32.0, zero_reading=20.0)
    return synthesise(inputs, np.random.default_rng(1))


@pytest.fixture(scope="module")
def record(experiment, tmp_path_factory):
    path = tmp_path_factory.mktemp("record") / "coil.csv"
    table(experiment).to_csv(path, index=False)
    return path


def integrate(*arguments):
    return femfit("integrate", *arguments)


# What each may be off by on the last plateau: lags and drifts of 7 uV, and of cs2 the error of I / g.
@pytest.mark.parametrize(
    ("method", "allowed"), [("trapezoid", 0.05), ("ffa1", 0.02), ("ffa2", 0.02), ("cs1", 1e-3), ("cs2", 3e-3)]
)
def test_every_method_writes_field_uncertainty_and_offset(method, allowed, record, experiment, tmp_path):
    result = integrate(
        record, "--coil-area", AREA, "--method", method, "--zero-reading-s", 20, "-o", tmp_path / "o.parquet"
    )
    assert result.returncode == 0, result.stderr
    assert result.stderr == ""
    rows = pd.read_parquet(tmp_path / "o.parquet")
    assert list(rows) == [
        "time_s", "coil_voltage_V", "hall_T", "current_A", "field_T", "field_sigma_T", "offset_V"
    ]  # fmt: skip
    error = rows["field_T"].to_numpy()[-1] - experiment.field[-1]
    assert abs(error) < allowed


def test_the_default_is_the_filter_with_the_offset_state(record, experiment, tmp_path):
    result = integrate(
        record, "--coil-area", AREA, "--reference-gain-sigma", 1e-4, "-o", tmp_path / "o.csv", "--json",
        tmp_path / "o.json",
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    data = json.loads((tmp_path / "o.json").read_text())
    assert data["method"] == "cs1-offset"
    assert data["samples"] == len(experiment.record)
    assert data["findings"] == []
    assert data["end"]["expanded_uncertainty"] == 2.0 * data["end"]["standard_uncertainty"]
    # At rest the field is the probe's; a few microtesla still come from the coil.
    assert data["end"]["parts"]["reference_gain"] == pytest.approx(1e-4 * data["end"]["value"], rel=1e-2)
    rows = pd.read_csv(tmp_path / "o.csv")
    settled = rows["time_s"].between(35.0, 55.0).to_numpy()
    assert np.sqrt(np.mean((rows["field_T"].to_numpy() - experiment.field)[settled] ** 2)) < 10e-6


def test_the_identified_field_is_written_and_read_again(record, experiment, tmp_path):
    options = ("--coil-area", AREA, "--method", "cs2-identified", "--field-model", tmp_path / "field.json")
    first = integrate(record, *options, "--lab", record, "-o", tmp_path / "a.csv")
    assert first.returncode == 0, first.stderr
    again = integrate(record, *options, "-o", tmp_path / "b.csv")
    assert again.returncode == 0, again.stderr
    assert (tmp_path / "a.csv").read_text() == (tmp_path / "b.csv").read_text()


def test_without_an_area_the_result_is_a_flux_linkage(record, tmp_path):
    result = integrate(record, "-o", tmp_path / "o.csv")
    assert result.returncode == 0, result.stderr
    assert {"flux_linkage_Wb", "flux_linkage_sigma_Wb"} <= set(pd.read_csv(tmp_path / "o.csv"))


def test_a_raw_record_goes_in_and_comes_out(experiment, tmp_path):
    values = table(experiment)[["coil_voltage_V", "hall_T"]].to_numpy(np.float32)
    values.tofile(tmp_path / "coil.bin")
    (tmp_path / "coil.toml").write_text('sample_rate_Hz = 1000.0\ncolumns = ["coil_voltage_V", "hall_T"]\n')
    result = integrate(tmp_path / "coil.bin", "--coil-area", AREA, "-o", tmp_path / "o.f32")
    assert result.returncode == 0, result.stderr
    side = json.loads((tmp_path / "o.json").read_text())
    assert side["sample_rate_Hz"] == 1000.0
    rows = np.fromfile(tmp_path / "o.f32", "<f4").reshape(-1, len(side["columns"]))
    assert len(rows) == len(experiment.record)
    # float32 holds 1 T to 6e-8 T.
    assert abs(rows[-1, side["columns"].index("field_T")] - experiment.field[-1]) < 1e-5


def test_faults_are_printed_with_the_suspect(experiment, tmp_path):
    rows = table(experiment)
    rows["coil_voltage_V"] *= -1.0
    rows.to_csv(tmp_path / "coil.csv", index=False)
    result = integrate(tmp_path / "coil.csv", "--coil-area", AREA, "-o", tmp_path / "o.csv")
    assert result.returncode == 0, result.stderr
    assert "wrong way round" in result.stdout
    assert "Suspect: the sign of the coil's voltage." in result.stdout


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--coil-area", "0"), "area must be > 0 m2"),
        (("--method", "cs1"), "give --coil-area"),
        (("--method", "cs2-identified", "--coil-area", AREA), "give --lab RECORD"),
    ],
)
def test_what_is_missing_or_impossible_exits_1_with_the_remedy(options, message, record, tmp_path):
    result = integrate(record, *options, "-o", tmp_path / "o.csv")
    assert result.returncode == 1
    assert message in result.stderr
    assert "Traceback" not in result.stderr
    assert not (tmp_path / "o.csv").exists()


def test_the_record_is_never_replaced_and_outputs_have_a_format(record, tmp_path):
    before = record.read_bytes()
    assert "would replace the record" in integrate(record, "-o", record).stderr
    assert record.read_bytes() == before
    assert "or its sidecar" in integrate(record, "-o", record.with_suffix(".bin")).stderr
    clash = integrate(record, "-o", tmp_path / "o.bin", "--json", tmp_path / "o.json")
    assert "--json" in clash.stderr
    assert clash.returncode == 1
    assert "is written as .csv" in integrate(record, "-o", tmp_path / "o.xlsx").stderr
