"""``femfit integrate`` as users type it."""

import json

import numpy as np
import pandas as pd
import pytest
from arpaia2022.experiment import ExperimentInputs, synthesise

from femfit.integrate.field_of_current import FieldModel, FieldTerms, write_field_model
from femfit.integrate.integrate_coil import integrate_coil
from femfit.model.json_file import write_model
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
    inputs = ExperimentInputs(amplitudes=(320.0, 200.0), plateau=32.0, zero_reading=20.0, sample_rate=500.0)
    return synthesise(inputs, np.random.default_rng(1))


@pytest.fixture(scope="module")
def record(experiment, tmp_path_factory):
    path = tmp_path_factory.mktemp("record") / "coil.csv"
    table(experiment).to_csv(path, index=False)
    return path


def integrate(*arguments):
    return femfit("integrate", *arguments)


def test_columns_units_and_table_of_a_record_can_be_said(tmp_path, experiment):
    rows = table(experiment)
    strange = pd.DataFrame({"t": rows["time_s"], "ai0": 1e3 * rows["coil_voltage_V"]})
    with pd.ExcelWriter(tmp_path / "a.xlsx") as book:
        strange.iloc[:2000].to_excel(book, sheet_name="first", index=False)
        strange.iloc[:1000].to_excel(book, sheet_name="second", index=False)
    said = ("--column", "t=time_s", "--column", "ai0=coil_voltage_V", "--unit", "mV", "--table", "second")
    result = integrate(tmp_path / "a.xlsx", *said, "--method", "trapezoid", "-o", tmp_path / "o.csv")
    assert result.returncode == 0, result.stderr
    flux = integrate_coil(rows[["time_s", "coil_voltage_V"]].iloc[:1000], method="trapezoid")
    written = pd.read_csv(tmp_path / "o.csv")["flux_linkage_Wb"]
    assert written.to_numpy()[-1] == pytest.approx(flux.value, rel=1e-6)


# What each may be off by on the last plateau: lags and drifts of 7 uV, and of cs2 the error of I / g.
@pytest.mark.parametrize(("method", "allowed"), [("trapezoid", 0.05), ("ffa1", 0.02), ("ffa2", 0.02), ("cs2", 3e-3)])
def test_every_method_writes_field_uncertainty_and_offset(method, allowed, record, experiment, tmp_path):
    ratio = ("--current-to-field", 316.0, "--reference-gain-sigma", 1e-3)
    more = {"ffa1": ("--zero-reading-s", 20), "ffa2": ("--settling-s", 25), "cs2": ratio}.get(method, ())
    result = integrate(record, "--coil-area", AREA, "--method", method, *more, "-o", tmp_path / "o.parquet")
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


def test_the_identified_field_is_written_and_read_again(experiment, tmp_path):
    record = tmp_path / "coil.csv"
    table(experiment).iloc[::3].to_csv(record, index=False)
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
    (tmp_path / "coil.toml").write_text('sample_rate_Hz = 500.0\ncolumns = ["coil_voltage_V", "hall_T"]\n')
    result = integrate(tmp_path / "coil.bin", "--coil-area", AREA, "-o", tmp_path / "o.f32")
    assert result.returncode == 0, result.stderr
    side = json.loads((tmp_path / "o.json").read_text())
    assert side["sample_rate_Hz"] == 500.0
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


def test_smoothing_lowers_the_error_and_keeps_the_systematics(record, experiment, tmp_path):
    rms = {}
    for name, more in (("filtered", ()), ("smoothed", ("--smooth",))):
        result = integrate(
            record, "--coil-area", AREA, "--reference-offset-sigma-T", 5e-5, "-o", tmp_path / "o.parquet", "--json",
            tmp_path / "o.json", *more,
        )  # fmt: skip
        assert result.returncode == 0, result.stderr
        assert ("smoothed" in result.stdout) == (name == "smoothed")
        rows = pd.read_parquet(tmp_path / "o.parquet")
        # At the record's begin the filter knows the offset voltage least.
        early = rows["time_s"].between(1.0, 19.0).to_numpy()
        rms[name] = np.sqrt(np.mean((rows["field_T"].to_numpy() - experiment.field)[early] ** 2))
        # A probe's zero is no noise: neither filter nor smoother averages it away.
        assert rows["field_sigma_T"].to_numpy()[early].min() > 4.9e-5
        data = json.loads((tmp_path / "o.json").read_text())
        assert data["end"]["parts"]["reference_offset"] == pytest.approx(5e-5, rel=0.02)
    assert rms["smoothed"] < 0.7 * rms["filtered"]


def test_smoothing_needs_a_kalman_filter(record, tmp_path):
    result = integrate(record, "--coil-area", AREA, "--method", "ffa2", "--smooth", "-o", tmp_path / "o.csv")
    assert result.returncode == 1
    assert "--smooth is for" in result.stderr


def test_a_record_without_a_plateau_is_said_to_be_plainly_integrated(experiment, tmp_path):
    rows = table(experiment).query("20.0 < time_s < 23.0")  # on the ramp
    rows.to_csv(tmp_path / "ramp.csv", index=False)
    options = (tmp_path / "ramp.csv", "--coil-area", AREA, "--method", "ffa2", "-o", tmp_path / "o.csv")
    assert "ffa2 found no settled plateau" in integrate(*options).stdout
    assert "ffa2 found no settled plateau" not in integrate(*options, "--still-A", 500, "--settling-s", 0).stdout


DISTANCE = 0.022
SENSING = 0.01
"""m2."""


@pytest.fixture(scope="module")
def held_magnet(levitation_model, tmp_path_factory):
    """Coil records with a body held: field at the Hall element, and flux linkage; the truth is 0.3 % off the model."""
    folder = tmp_path_factory.mktemp("held")
    write_model(levitation_model, folder / "model.json")
    time = np.arange(0.0, 60.0, 5e-3)
    current = 0.6 * (1.0 - np.cos(2.0 * np.pi * time / 12.0))
    at = np.full(len(time), DISTANCE)
    rng = np.random.default_rng(3)
    truths = {
        "field": 1.003 * levitation_model.sensor.field.field(at, current),
        "flux_linkage": 1.003 * levitation_model.magnetics.flux_linkage(at, current),
    }
    for name, area in (("field", SENSING), ("flux_linkage", 1.0)):
        # Each trapezoid of the voltage is the truth's step.
        induced = 2.0 * np.diff(truths[name]) / 5e-3 * area
        voltage = np.zeros(len(time))
        for k, step in enumerate(induced):
            voltage[k + 1] = step - voltage[k]
        voltage += 7e-6 + 1e-6 * rng.normal(size=len(time))
        rows = pd.DataFrame({"time_s": time, "coil_voltage_V": voltage, "current_A": current})
        rows.to_csv(folder / f"{name}.csv", index=False)
    return folder, truths


@pytest.mark.parametrize(("name", "area"), [("field", ("--coil-area", SENSING)), ("flux_linkage", ())])
def test_a_swept_model_takes_the_place_of_an_identified_field(name, area, held_magnet, tmp_path):
    folder, truths = held_magnet
    options = ("--method", "cs2-identified", "--model", folder / "model.json", "--distance-mm", 1e3 * DISTANCE)
    result = integrate(folder / f"{name}.csv", *area, *options, "-o", tmp_path / "o.parquet")
    assert result.returncode == 0, result.stderr
    # Nothing is wrong with the record, whichever way the field at the element grows with the current.
    assert "wrong way round" not in result.stdout
    assert "extrapolates" not in result.stdout
    rows = pd.read_parquet(tmp_path / "o.parquet")
    value, sigma = (rows[column].to_numpy() for column in list(rows)[-3:-1])
    error = value - truths[name]
    late = rows["time_s"].to_numpy() > 20.0
    # The model's 0.3 % is within its default of 1 %.
    assert np.all(np.abs(error[late]) < 2.0 * sigma[late])
    assert np.abs(error[late]).max() < 0.01 * np.ptp(truths[name]) + 0.003 * np.abs(truths[name]).max()


def test_currents_beyond_the_model_are_said(held_magnet, tmp_path):
    folder, _ = held_magnet
    rows = pd.read_csv(folder / "field.csv").assign(current_A=lambda frame: 50.0 * frame["current_A"])
    rows.to_csv(tmp_path / "r.csv", index=False)
    options = ("--coil-area", SENSING, "--method", "cs2-identified", "--model", folder / "model.json")
    result = integrate(tmp_path / "r.csv", *options, "--distance-mm", 1e3 * DISTANCE, "-o", tmp_path / "o.csv")
    assert "outside of what the field model was made for" in result.stdout
    assert "--model goes with" in integrate(tmp_path / "r.csv", *options, "-o", tmp_path / "o.csv").stderr
    far = integrate(tmp_path / "r.csv", *options, "--distance-mm", 500, "-o", tmp_path / "o.csv")
    assert far.returncode == 1
    assert "where the model was fitted" in far.stderr


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--coil-area", "0"), "area must be > 0 m2"),
        (("--method", "cs1-offset"), "give --coil-area"),
        (("--method", "cs2-identified", "--coil-area", AREA), "give --lab RECORD"),
        (("--method", "cs2", "--coil-area", AREA), "--current-to-field"),
        (("--method", "ffa1"), "--zero-reading-s"),
        (("--method", "ffa2", "--lab", "lab.csv", "--field-model", "f.json"), "does not use it"),
    ],
)
def test_what_is_missing_or_impossible_exits_1_with_the_remedy(options, message, record, tmp_path):
    result = integrate(record, *options, "-o", tmp_path / "o.csv")
    assert result.returncode == 1
    assert message in result.stderr
    assert "Traceback" not in result.stderr
    assert not (tmp_path / "o.csv").exists()


def test_a_sidecar_of_a_raw_record_is_never_replaced(experiment, tmp_path):
    table(experiment)[["coil_voltage_V"]].to_numpy(np.float32).tofile(tmp_path / "coil.bin")
    side = tmp_path / "coil.json"
    side.write_text('{"sample_rate_Hz": 500.0, "columns": ["coil_voltage_V"]}')
    before = side.read_text()
    for options in (("-o", tmp_path / "coil.f32"), ("-o", tmp_path / "o.csv", "--json", side)):
        assert integrate(tmp_path / "coil.bin", "--method", "trapezoid", *options).returncode == 1
        assert side.read_text() == before


@pytest.mark.parametrize(
    "damage",
    [
        {"rms_T": -5.0},
        {"rms_T": float("nan")},
        {"rms_T": "0.1"},
        {"coefficients_T": float("inf")},
        {"degree": 1e400},
        {"degree": int("9" * 300)},
        {"degree": True},
        {"current_max_A": 0.0},
        {"play_radii_A": [float("nan")]},
        {"lag_times_s": "none"},
    ],
    ids=str,
)
def test_a_field_model_with_a_number_that_none_has_is_refused(damage, record, tmp_path):
    terms = FieldTerms(320.0, 2, (5.0,), (3.0,))
    write_field_model(FieldModel(terms, np.full(len(terms.names), 0.1), 1e-4), tmp_path / "field.json")
    data = json.loads((tmp_path / "field.json").read_text())
    ((key, value),) = damage.items()
    if key == "coefficients_T":
        data[key]["polynomial 0"] = value
    else:
        data["terms" if key in data["terms"] else key] = data["terms"] | damage if key in data["terms"] else value
    (tmp_path / "field.json").write_text(json.dumps(data))
    options = ("--coil-area", AREA, "--method", "cs2-identified", "--field-model", tmp_path / "field.json")
    result = integrate(record, *options, "-o", tmp_path / "o.csv")
    assert result.returncode == 1
    assert "field of current" in result.stderr
    assert not (tmp_path / "o.csv").exists()


def test_the_library_keeps_the_rows_and_prints_what_the_command_prints(experiment, record, tmp_path):
    result = integrate_coil(table(experiment), coil_area_m2=float(AREA))
    assert len(result.rows) == len(experiment.record)
    assert result.rows["field_T"].iloc[-1] == result.value
    said = integrate(record, "--coil-area", AREA, "-o", tmp_path / "o.csv").stdout
    assert str(result).splitlines() == said.splitlines()[:-1]  # and what was written
    assert "<pre>" in result._repr_html_()


def test_the_record_is_never_replaced_and_outputs_have_a_format(record, tmp_path):
    before = record.read_bytes()
    assert "would replace it" in integrate(record, "-o", record).stderr
    assert record.read_bytes() == before
    clash = integrate(record, "-o", tmp_path / "o.csv", "--json", tmp_path / "o.csv")
    assert clash.returncode == 1
    assert not (tmp_path / "o.csv").exists()
    assert "is written as .csv" in integrate(record, "-o", tmp_path / "o.xlsx").stderr


def test_a_hall_probe_that_reads_one_value_throughout_is_said_to_stand_still(experiment, tmp_path):
    rows = table(experiment).iloc[:30_000].assign(hall_T=0.25)
    rows.to_csv(tmp_path / "stuck.csv", index=False)
    words = ("--coil-area", AREA, "--json", tmp_path / "s.json")
    result = integrate(tmp_path / "stuck.csv", "-o", tmp_path / "o.csv", *words)
    assert result.returncode == 0, result.stderr
    codes = {one["code"] for one in json.loads((tmp_path / "s.json").read_text())["findings"]}
    assert codes & {"stuck", "saturated"}
    assert len(pd.read_csv(tmp_path / "o.csv")) == len(rows)


@pytest.mark.parametrize(
    ("columns", "factors"),
    [
        (["coil_voltage_mV", "hall_mT"], [1e3, 1e3]),
        (["coil_voltage [uV]", "hall [G]"], [1e6, 1e4]),
        (["coil_voltage_V", "hall_T"], [1.0, 1.0]),
    ],
)
def test_the_units_of_a_raw_records_columns_are_read(experiment, tmp_path, columns, factors):
    rows = table(experiment).iloc[:5000]
    values = rows[["coil_voltage_V", "hall_T"]].to_numpy() * factors
    values.astype("<f4").tofile(tmp_path / "r.bin")
    rate = 1.0 / (rows["time_s"].iloc[1] - rows["time_s"].iloc[0])
    (tmp_path / "r.toml").write_text(f"sample_rate_Hz = {rate}\ncolumns = {json.dumps(columns)}\n")
    result = integrate(tmp_path / "r.bin", "--coil-area", AREA, "-o", tmp_path / "o.csv", "--method", "cs1-offset")
    assert result.returncode == 0, result.stderr
    written = pd.read_csv(tmp_path / "o.csv")
    plain = integrate_coil(rows, coil_area_m2=float(AREA), method="cs1-offset").rows
    scale = float(np.ptp(rows["hall_T"]))  # float32 has 7 digits
    np.testing.assert_allclose(written["field_T"], plain["field_T"], atol=1e-5 * scale)
