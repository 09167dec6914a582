"""Records over time, through integrate, simulate and observe."""

import json

import numpy as np
import pandas as pd
import pytest
from arpaia2022.experiment import ExperimentInputs, synthesise

from femfit.core.errors import FemfitError
from femfit.device.electrics import Drive
from femfit.integrate.field_of_current import FieldModel, FieldTerms, read_field_model, write_field_model
from femfit.integrate.integrate_coil import integrate_coil
from femfit.model.json_file import write_model
from support.actuators import GEOMETRY
from support.command import femfit, worked
from support.halves import cut_in_two
from support.solenoids import solenoid

AREA = "0.059394"


def table(experiment):
    record = experiment.record
    columns = {"time_s": record.time, "coil_voltage_V": record.voltage, "hall_T": record.hall}
    return pd.DataFrame(columns | {"current_A": record.current})


@pytest.fixture(scope="module")
def experiment():
    inputs = ExperimentInputs(amplitudes=(320.0, 200.0), plateau=32.0, zero_reading=20.0, sample_rate=500.0)
    return synthesise(inputs, np.random.default_rng(1))


@pytest.fixture(scope="module")
def record(experiment, tmp_path_factory):
    path = tmp_path_factory.mktemp("record") / "coil.csv"
    table(experiment).to_csv(path, index=False)
    return path


def integrated(record, output, *options):
    """The written rows and the findings' codes."""
    worked("integrate", record, "-o", output, "--json", output.with_suffix(".result.json"), *options)
    data = json.loads(output.with_suffix(".result.json").read_text())
    rows = pd.read_parquet(output) if output.suffix == ".parquet" else pd.read_csv(output)
    return rows, data, {one["code"] for one in data["findings"]}


def test_columns_units_and_table_of_a_record_can_be_said(tmp_path, experiment):
    rows = table(experiment)
    strange = pd.DataFrame({"t": rows["time_s"], "ai0": 1e3 * rows["coil_voltage_V"]})
    with pd.ExcelWriter(tmp_path / "a.xlsx") as book:
        strange.iloc[:2000].to_excel(book, sheet_name="first", index=False)
        strange.iloc[:1000].to_excel(book, sheet_name="second", index=False)
    said = ("--column", "t=time_s", "--column", "ai0=coil_voltage_V", "--unit", "ai0=mV", "--table", "second")
    written, _, _ = integrated(tmp_path / "a.xlsx", tmp_path / "o.csv", *said, "--method", "trapezoid")
    flux = integrate_coil(rows[["time_s", "coil_voltage_V"]].iloc[:1000], method="trapezoid")
    assert written["flux_linkage_Wb"].iloc[-1] == pytest.approx(flux.value, rel=1e-6)  # without an area
    assert "flux_linkage_sigma_Wb" in written


# What each may be off by on the last plateau: lags and drifts of 7 uV, and of cs2 the error of I / g.
@pytest.mark.parametrize(("method", "allowed"), [("trapezoid", 0.05), ("ffa1", 0.02), ("ffa2", 0.02), ("cs2", 3e-3)])
def test_every_method_writes_field_uncertainty_and_offset(method, allowed, record, experiment, tmp_path):
    ratio = ("--current-to-field", 316.0, "--reference-gain-sigma", 1e-3)
    more = {"ffa1": ("--zero-reading-s", 20), "ffa2": ("--settling-s", 25), "cs2": ratio}.get(method, ())
    options = ("--coil-area", AREA, "--method", method, *more)
    rows, _, _ = integrated(record, tmp_path / "o.parquet", *options)
    assert list(rows)[-3:] == ["field_T", "field_sigma_T", "offset_V"]
    assert abs(rows["field_T"].iloc[-1] - experiment.field[-1]) < allowed


def test_the_default_is_the_filter_with_the_offset_state_and_the_library_keeps_its_rows(record, experiment, tmp_path):
    rows, data, codes = integrated(record, tmp_path / "o.csv", "--coil-area", AREA, "--reference-gain-sigma", 1e-4)
    assert (data["method"], data["samples"], codes) == ("cs1-offset", len(experiment.record), set())
    # At rest the field is the probe's; a few microtesla still come from the coil.
    assert data["end"]["parts"]["reference_gain"] == pytest.approx(1e-4 * data["end"]["value"], rel=1e-2)
    settled = rows["time_s"].between(35.0, 55.0).to_numpy()
    assert np.sqrt(np.mean((rows["field_T"].to_numpy() - experiment.field)[settled] ** 2)) < 10e-6
    result = integrate_coil(table(experiment), coil_area_m2=float(AREA))
    assert len(result.rows) == len(experiment.record)
    assert result.rows["field_T"].iloc[-1] == result.value


@pytest.mark.nightly
def test_the_identified_field_is_written_and_read_again(experiment, tmp_path):
    record = tmp_path / "coil.csv"
    table(experiment).iloc[::3].to_csv(record, index=False)
    options = ("--coil-area", AREA, "--method", "cs2-identified", "--field-model", tmp_path / "field.json")
    worked("integrate", record, *options, "--lab", record, "-o", tmp_path / "a.csv")
    worked("integrate", record, *options, "-o", tmp_path / "b.csv")
    assert (tmp_path / "a.csv").read_text() == (tmp_path / "b.csv").read_text()


def test_a_raw_record_goes_in_and_comes_out_and_its_sidecar_is_never_replaced(experiment, tmp_path):
    values = table(experiment)[["coil_voltage_V", "hall_T"]].to_numpy(np.float32)
    values.tofile(tmp_path / "coil.bin")
    side = tmp_path / "coil.toml"
    side.write_text('sample_rate_Hz = 500.0\ncolumns = ["coil_voltage_V", "hall_T"]\n')
    worked("integrate", tmp_path / "coil.bin", "--coil-area", AREA, "-o", tmp_path / "o.f32")
    written = json.loads((tmp_path / "o.json").read_text())
    assert written["sample_rate_Hz"] == 500.0
    rows = np.fromfile(tmp_path / "o.f32", "<f4").reshape(-1, len(written["columns"]))
    assert len(rows) == len(experiment.record)
    # float32 holds 1 T to 6e-8 T.
    assert abs(rows[-1, written["columns"].index("field_T")] - experiment.field[-1]) < 1e-5
    side.unlink()
    side = tmp_path / "coil.json"
    side.write_text('{"sample_rate_Hz": 500.0, "columns": ["coil_voltage_V", "hall_T"]}')
    before = side.read_text()
    for options in (("-o", tmp_path / "coil.f32"), ("-o", tmp_path / "o.csv", "--json", side)):
        assert femfit("integrate", tmp_path / "coil.bin", "--method", "trapezoid", *options).returncode == 1
        assert side.read_text() == before


@pytest.mark.parametrize(
    ("columns", "factors"),
    [(["coil_voltage_mV", "hall_mT"], [1e3, 1e3]), (["coil_voltage [uV]", "hall [G]"], [1e6, 1e4])],
)
def test_the_units_of_a_raw_records_columns_are_read(experiment, tmp_path, columns, factors):
    rows = table(experiment).iloc[:5000]
    values = rows[["coil_voltage_V", "hall_T"]].to_numpy() * factors
    values.astype("<f4").tofile(tmp_path / "r.bin")
    rate = 1.0 / (rows["time_s"].iloc[1] - rows["time_s"].iloc[0])
    (tmp_path / "r.toml").write_text(f"sample_rate_Hz = {rate}\ncolumns = {json.dumps(columns)}\n")
    written, _, _ = integrated(tmp_path / "r.bin", tmp_path / "o.csv", "--coil-area", AREA, "--method", "cs1-offset")
    plain = integrate_coil(rows, coil_area_m2=float(AREA), method="cs1-offset").rows
    scale = float(np.ptp(rows["hall_T"]))  # float32 has 7 digits
    np.testing.assert_allclose(written["field_T"], plain["field_T"], atol=1e-5 * scale)


@pytest.mark.parametrize(
    ("change", "codes"),
    [({"coil_voltage_V": lambda v: -v}, {"sign"}), ({"hall_T": lambda v: 0.0 * v + 0.25}, {"stuck", "saturated"})],
)
def test_a_fault_of_a_record_has_its_code(experiment, tmp_path, change, codes):
    rows = table(experiment).iloc[:30_000]
    rows.assign(**{name: turned(rows[name]) for name, turned in change.items()}).to_csv(tmp_path / "r.csv", index=False)
    written, _, said = integrated(tmp_path / "r.csv", tmp_path / "o.csv", "--coil-area", AREA)
    assert said & codes
    assert len(written) == len(rows)


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
def test_a_field_model_with_a_number_that_none_has_is_refused(damage, tmp_path):
    terms, path = FieldTerms(320.0, 2, (5.0,), (3.0,)), tmp_path / "field.json"
    write_field_model(FieldModel(terms, np.full(len(terms.names), 0.1), 1e-4), path)
    data = json.loads(path.read_text())
    ((key, value),) = damage.items()
    if key == "coefficients_T":
        data[key]["polynomial 0"] = value
    else:
        (data["terms"] if key in data["terms"] else data)[key] = value
    path.write_text(json.dumps(data))
    with pytest.raises(FemfitError, match="field of current"):
        read_field_model(path)


@pytest.mark.nightly
def test_the_default_compares_controllers_and_filters(model_file, tmp_path):
    result = worked("simulate", model_file, "--json", tmp_path / "result.json")
    for part in ("held the body", "bound", "pulled in", "Hall offset", "force +1 %"):
        assert part in result.stdout
    data = json.loads((tmp_path / "result.json").read_text())
    assert {row["measurement"] for row in data["steps"]} == {"direct", "ukf"}


@pytest.fixture
def solenoid_file(tmp_path):
    write_model(solenoid(drive=Drive(diode_V=0.7)), tmp_path / "solenoid.json")
    return tmp_path / "solenoid.json"


def motion_of(path, *options):
    """The table of a motion, and its result."""
    files = ("--csv", path.with_name("motion.csv"), "--json", path.with_name("motion.json"))
    worked("simulate", path, *files, *options)
    return pd.read_csv(path.with_name("motion.csv")), json.loads(path.with_name("motion.json").read_text())


def test_a_profile_gives_pull_in_and_drop_out_and_all_files(solenoid_file, tmp_path):
    (tmp_path / "12V.csv").write_text("time_ms,voltage_V\n0,12\n70,0\n200,0\n")
    rows, data = motion_of(solenoid_file, "--drive", tmp_path / "12V.csv", "--picture", tmp_path / "motion.png")
    assert rows["time_s"].iloc[-1] == pytest.approx(0.2)
    assert rows["distance_m"].min() == pytest.approx(0.2e-3)
    assert [one["kind"] for one in data["switchings"]] == ["pull_in", "drop_out"]
    assert abs(data["energy"]["remainder_J"]) < 1e-6 * data["energy"]["supplied_J"]
    assert (tmp_path / "motion.png").read_bytes().startswith(b"\x89PNG")
    motion_of(solenoid_file, "--voltage", 12)  # its own table is replaced


def test_start_duration_and_step_are_in_millimetres_and_milliseconds_and_a_command_is_cut_at_the_supply(solenoid_file):
    rows, _ = motion_of(solenoid_file, "--voltage", 0, "--start-mm", 2, "--duration-ms", 5, "--step-ms", 0.05)
    assert (rows["distance_m"].iloc[0], rows["time_s"].iloc[-1]) == (pytest.approx(2e-3), pytest.approx(5e-3))
    np.testing.assert_allclose(np.diff(rows["time_s"]), 5e-5)
    said = [worked("simulate", solenoid_file, "--voltage", volts).stdout.splitlines() for volts in (24, 12)]
    assert said[0][0] == said[1][0]
    assert len(said[0]) == len(said[1]) + 1


def test_each_of_several_circuits_takes_its_own_voltage(tmp_path):
    write_model(cut_in_two(solenoid()), tmp_path / "halves.json")
    rows, data = motion_of(tmp_path / "halves.json", "--voltage", "inner=6,outer=6")
    assert data["switchings"][0]["kind"] == "pull_in"
    assert set(rows) >= {"current_inner_A", "voltage_outer_V", "flux_linkage_inner_Wb"}


@pytest.mark.nightly
def test_a_device_is_tried_from_its_drawing_alone(tmp_path):
    text = (GEOMETRY / "emaws-rig.toml").read_text(encoding="utf-8")
    drawing = tmp_path / "rig.toml"
    drawing.write_text(text.replace("stop = 45, step = 0.5", "stop = 45, step = 1.5"), encoding="utf-8")
    done = worked("trial", "--drawing", drawing, "-o", tmp_path / "trial", "--cases", 6, "--seed", 3)
    assert done.stdout.startswith("Nothing hidden: an effect was named in 0 of")
    results = json.loads((tmp_path / "trial" / "results.json").read_text())
    assert [one["number"] for one in results["cases"]] == [1, 2, 3, 4, 5, 6]
    said = json.loads((tmp_path / "trial" / "campaigns" / "0001" / "diagnosis.json").read_text())
    assert said["verdict"] == results["cases"][0]["verdict"]


@pytest.mark.parametrize(("kind", "has"), [("magnet-pair", "0 coils"), ("bearing", "2 coils in 2 circuits")])
def test_a_drawing_that_the_virtual_bench_cannot_measure_is_refused_before_anything_is_solved(kind, has, tmp_path):
    worked("new", kind, "-o", tmp_path / "drawing.toml")
    done = femfit("trial", "--drawing", tmp_path / "drawing.toml", "-o", tmp_path / "trial")
    assert done.returncode != 0
    assert has in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert not (tmp_path / "trial").exists()
