"""Records over time, through integrate, simulate and observe."""

import json

import numpy as np
import pandas as pd
import pytest
from arpaia2022.experiment import ExperimentInputs, synthesise

from femfit.device.electrics import Drive
from femfit.integrate.integrate_coil import integrate_coil
from femfit.model.json_file import write_model
from support.actuators import GEOMETRY
from support.command import worked
from support.halves import cut_in_two
from support.replays import damped
from support.small_records import coil_record
from support.solenoids import solenoid


@pytest.fixture
def integrated(tmp_path):
    """What is written of a record, with the options of a line."""

    def rows(record, line):
        worked("integrate", record, "-o", tmp_path / "o.csv", *line.split())
        return pd.read_csv(tmp_path / "o.csv")

    return rows


def test_columns_units_and_table_of_a_record_can_be_said(tmp_path, integrated):
    rows = pd.read_csv(coil_record(tmp_path / "coil.csv", 2.0))[["time_s", "coil_voltage_V"]]
    strange = pd.DataFrame({"t": rows["time_s"], "ai0": 1e3 * rows["coil_voltage_V"]})
    with pd.ExcelWriter(tmp_path / "a.xlsx") as book:
        strange.to_excel(book, sheet_name="first", index=False)
        strange.iloc[:1000].to_excel(book, sheet_name="second", index=False)
    said = "--column t=time_s --column ai0=coil_voltage_V --unit ai0=mV --table second --method trapezoid"
    written = integrated(tmp_path / "a.xlsx", said)
    flux = integrate_coil(rows.iloc[:1000], method="trapezoid")
    assert written["flux_linkage_Wb"].iloc[-1] == pytest.approx(flux.value, rel=1e-6)  # without an area
    assert "flux_linkage_sigma_Wb" in written


@pytest.mark.nightly
def test_the_field_of_a_current_is_identified_from_a_lab_record(tmp_path, integrated):
    inputs = ExperimentInputs(amplitudes=(320.0, 200.0), plateau=32.0, zero_reading=20.0, sample_rate=100.0)
    experiment = synthesise(inputs, np.random.default_rng(1))
    record, lab = experiment.record, tmp_path / "coil.csv"
    columns = {"time_s": record.time, "coil_voltage_V": record.voltage, "hall_T": record.hall}
    pd.DataFrame(columns | {"current_A": record.current}).iloc[::3].to_csv(lab, index=False)
    rows = integrated(lab, f"--coil-area 0.059394 --method cs2-identified --lab {lab}")
    # The Hall probe of the lab record is 10 uT off in a reading, the model of the field tens of uT
    assert abs(rows["field_T"].iloc[-1] - experiment.field[-1]) < 1e-3


@pytest.mark.nightly
def test_the_default_compares_controllers_and_filters(model_file, tmp_path):
    result = worked("simulate", model_file, "--verbose", "--json", tmp_path / "result.json")
    for part in ("Held: 24 of 24 runs", "Steps", "are aimed at", "sensors: Hall 3.20 mV rms"):
        assert part in result.stdout
    data = json.loads((tmp_path / "result.json").read_text())
    assert {row["measurement"] for row in data["steps"]} == {"direct", "ukf"}


@pytest.fixture
def motion_of(tmp_path):
    """The table of a motion and its result, by a line of options."""
    write_model(solenoid(drive=Drive(diode_V=0.7)), tmp_path / "solenoid.json")
    write_model(cut_in_two(solenoid()), tmp_path / "halves.json")
    write_model(damped(), tmp_path / "damped.json")
    (tmp_path / "12V.csv").write_text("time_ms,voltage_V\n0,12\n70,0\n200,0\n")

    def moved(line):
        done = worked(*line.split(), "--csv", "motion.csv", "--json", "motion.json", cwd=tmp_path)
        return pd.read_csv(tmp_path / "motion.csv"), json.loads((tmp_path / "motion.json").read_text()), done.stdout

    return moved


def test_a_profile_gives_pull_in_and_drop_out_and_all_files(motion_of, tmp_path):
    rows, data, _ = motion_of("simulate solenoid.json --drive 12V.csv --picture motion.png")
    assert rows["time_s"].iloc[-1] == pytest.approx(0.2)
    assert rows["distance_m"].min() == pytest.approx(0.2e-3)
    assert [one["kind"] for one in data["switchings"]] == ["pull_in", "drop_out"]
    assert abs(data["energy"]["remainder_J"]) < 1e-6 * data["energy"]["supplied_J"]
    assert (tmp_path / "motion.png").read_bytes().startswith(b"\x89PNG")
    # Its own table is replaced, and a command beyond the supply is cut there
    said = [motion_of(f"simulate solenoid.json --voltage {volts}")[2].splitlines() for volts in (24, 12)]
    assert said[0][0] == said[1][0]
    assert len(said[0]) == len(said[1]) + 1


def test_start_duration_and_step_are_in_millimetres_and_milliseconds(motion_of):
    rows, *_ = motion_of("simulate solenoid.json --voltage 0 --start-mm 2 --duration-ms 5 --step-ms 0.05")
    assert (rows["distance_m"].iloc[0], rows["time_s"].iloc[-1]) == (pytest.approx(2e-3), pytest.approx(5e-3))
    np.testing.assert_allclose(np.diff(rows["time_s"]), 5e-5)


def test_each_of_several_circuits_takes_its_own_voltage(motion_of):
    rows, data, _ = motion_of("simulate halves.json --voltage inner=6,outer=6")
    assert data["switchings"][0]["kind"] == "pull_in"
    assert set(rows) >= {"current_inner_A", "voltage_outer_V", "flux_linkage_inner_Wb"}


def test_a_sensed_motion_replaces_its_own_table_and_picture(motion_of):
    for seed in (1, 2):
        rows, *_ = motion_of(f"sense damped.json --voltage 9 --runs 2 --seed {seed} --picture sensed.png")
    assert {"rms_m", "claimed_m", "bound_m"} < set(rows)


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
