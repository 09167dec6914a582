"""Bench files as people write them become tables in SI, and what is not used is said."""

import numpy as np
import pandas as pd
import pytest

from femfit.core.errors import TableError
from femfit.tables.measurement import CHANNELS, SETTINGS
from femfit.tables.measurement_file import read_bench_table


def written(path, text, sidecar=None, sidecar_name="bench.toml"):
    (path / "bench.csv").write_text(text, encoding="utf-8")
    if sidecar is not None:
        (path / sidecar_name).write_text(sidecar, encoding="utf-8")
    return path / "bench.csv"


CONTRACT = "run,current_A,distance_m,force_N\n1,0.5,0.02,0.03\n1,1.0,0.02,\n2,0.5,0.02,0.031\n"


def test_a_contract_file_has_every_column_and_says_which_were_given(tmp_path):
    table = read_bench_table(written(tmp_path, CONTRACT))
    assert tuple(table.rows) == (*SETTINGS, *CHANNELS)
    assert table.given == ("run", "current_A", "distance_m", "force_N")
    assert table.channels == ("force_N",)
    assert table.rows["mount"].tolist() == [1.0, 1.0, 2.0]
    assert table.rows["order"].tolist() == [0.0, 1.0, 0.0]
    assert np.isnan(table.rows["force_N"][1])
    assert table.findings == ()


def test_other_units_decimal_commas_and_words_are_converted_and_said(tmp_path):
    text = "# bench 3\nrun;Distance [mm];current_mA;branch;force_N\na;20,5;100;up;0,03\nb;21;200;falling;0,04\n"
    table = read_bench_table(written(tmp_path, text))
    assert table.rows["distance_m"].tolist() == pytest.approx([0.0205, 0.021])
    assert table.rows["current_A"].tolist() == pytest.approx([0.1, 0.2])
    assert table.rows["branch"].tolist() == [1.0, -1.0]
    assert table.rows["run"].tolist() == [1.0, 2.0]
    assert any("Distance [mm]" in str(said) and "times 0.001" in str(said) for said in table.findings)
    assert any("1 = a, 2 = b" in str(said) for said in table.findings)


def test_columns_that_are_not_used_are_named_with_what_they_may_mean(tmp_path):
    text = "current_A,distance_m,force_N,hall_T,hal_V\n1,0.02,0.03,0.01,2.5\n1,0.03,0.02,0.01,2.5\n"
    table = read_bench_table(written(tmp_path, text))
    assert any("'hall_T' is in T, where hall_V is needed" in str(said) for said in table.findings)
    assert any("did you mean hall_V?" in str(said) for said in table.findings)


def test_rows_follow_the_order_of_measuring_within_each_run(tmp_path):
    text = "run,order,current_A,distance_m,force_N\n2,1,1,0.02,4\n2,0,1,0.02,3\n1,5,1,0.02,2\n1,4,1,0.02,1\n"
    rows = read_bench_table(written(tmp_path, text)).rows
    assert rows["force_N"].tolist() == [3.0, 4.0, 1.0, 2.0]


@pytest.mark.parametrize("sidecar_name", ["bench.toml", "bench.csv.toml"])
@pytest.mark.parametrize("noise", ["force_N = 2e-4", "force_mN = 0.2", "[noise]\nforce_N = 2e-4"])
def test_a_sidecar_declares_noise_and_test_object(tmp_path, sidecar_name, noise):
    sidecar = f'test_object = "magnet 3"\nnotes = "Tuesday"\n{noise}\n'
    table = read_bench_table(written(tmp_path, CONTRACT, sidecar, sidecar_name))
    assert table.declared_noise == pytest.approx({"force_N": 2e-4})
    assert (table.test_object, table.notes) == ("magnet 3", "Tuesday")


@pytest.mark.parametrize(
    "noise", ["[noise.run]\nforce_mN = 0.5", "[noise]\nrun.force_N = 5e-4", "[noise]\nrun = {force_mN = 0.5}"]
)
def test_a_sidecar_declares_what_the_readings_of_a_run_share(tmp_path, noise):
    file = written(tmp_path, CONTRACT, f"{noise}\n")
    assert read_bench_table(file).declared_noise == pytest.approx({"run.force_N": 5e-4})
    assert read_bench_table(file, noise={"run.force_mN": 2.0}).declared_noise == pytest.approx({"run.force_N": 2e-3})


@pytest.mark.parametrize("noise", ["[noise]\nrun.distance_mm = 0.5", "[noise]\nrun = 3", "[noise.run]\nforce_N = 0"])
def test_what_runs_cannot_share_is_refused(tmp_path, noise):
    with pytest.raises(TableError, match="run"):
        read_bench_table(written(tmp_path, CONTRACT, f"{noise}\n"))


def test_csv_and_parquet_give_the_same_table(tmp_path):
    file = written(tmp_path, CONTRACT)
    pd.read_csv(file).to_parquet(tmp_path / "bench.parquet")
    pd.testing.assert_frame_equal(read_bench_table(file).rows, read_bench_table(tmp_path / "bench.parquet").rows)


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("", "empty"),
        ("current_A,force_N\n1,2\n", "lacks distance_m"),
        ("current_A,Tiefe [mm],force_N\n1,20,2\n", r"Tiefe \[mm\]"),
        ("current_A,distance_m\n1,0.02\n", "one of force_N"),
        ("current_A,distance_m,force_N\n1,0.02,\n", "one of force_N"),
        ("current_A,distance_m,distance_mm,force_N\n1,0.02,20,3\n", "Remove all but one"),
        ("current_A,distance_m,force_N\n1,0.02,3,4,5\n", "as many column names as columns"),
    ],
)
def test_a_table_that_cannot_be_used_says_what_it_needs(tmp_path, text, part):
    with pytest.raises(TableError, match=part):
        read_bench_table(written(tmp_path, text))


@pytest.mark.parametrize("noise", ["force_N = 0", 'force_N = "small"', "force_N = nan", "noise = 3", "force_N = "])
def test_a_noise_that_is_no_standard_deviation_is_refused(tmp_path, noise):
    with pytest.raises(TableError, match=r"force_N = 2e-4|standard deviation"):
        read_bench_table(written(tmp_path, CONTRACT, noise))


@pytest.mark.parametrize(
    "names",
    [
        "Lauf;Strom (mA);Luftspalt [mm];Kraft/mN;Hallspannung (V);Spulentemperatur (°C)",
        "Run #;I [mA];air gap (mm);F (mN);V_hall (V);T_coil (C)",
        "run;current_mA;distance_mm;Force in mN;hall_V;coil_temperature_C",
        "Serie;Strom / mA;Luftspalt / mm;Kraft / mN;Hallspannung / V;Spulentemperatur / °C",
    ],
)
def test_columns_are_known_by_what_benches_call_them(tmp_path, names):
    one = read_bench_table(written(tmp_path, f"{names}\n3;100;20,5;30;2,5;21\n3;200;20,5;40;2,6;21\n")).rows.iloc[0]
    assert one["run"] == 3.0
    assert one[["current_A", "distance_m", "force_N"]].tolist() == pytest.approx([0.1, 0.0205, 0.03])
    assert one[["hall_V", "coil_temperature_C"]].tolist() == [2.5, 21.0]


def test_one_letter_is_a_name_only_beside_a_unit_of_its_kind(tmp_path):
    table = read_bench_table(written(tmp_path, "i,d,current_A,distance_m,force_N\n7,8,1,0.02,0.03\n"))
    assert (table.rows["current_A"][0], table.rows["distance_m"][0]) == (1.0, 0.02)
    assert any("i, d" in str(said) for said in table.findings)


def test_what_a_measuring_program_writes_above_the_table_is_passed_over(tmp_path):
    above = "LabVIEW Measurement\nOperator;A. B.\n\n"
    table = read_bench_table(written(tmp_path, above + CONTRACT.replace(",", ";")))
    assert table.rows["force_N"].tolist()[::2] == [0.03, 0.031]


def test_a_line_of_units_below_the_names_counts(tmp_path):
    text = "run;Strom;Abstand;Kraft\n-;mA;mm;mN\n1;100;20,5;30\n1;200;20,5;40\n"
    rows = read_bench_table(written(tmp_path, text)).rows
    assert rows.loc[0, ["current_A", "distance_m", "force_N"]].tolist() == pytest.approx([0.1, 0.0205, 0.03])


def test_branches_are_told_in_german_too(tmp_path):
    text = "branch,current_A,distance_m,force_N\nauf,1,0.02,0.03\nab,0.5,0.02,0.03\n"
    assert read_bench_table(written(tmp_path, text)).rows["branch"].tolist() == [1.0, -1.0]


def test_a_delimiter_at_the_end_of_each_line_is_no_column(tmp_path):
    assert read_bench_table(written(tmp_path, CONTRACT.replace("\n", ",\n"))).findings == ()


def test_names_without_rows_are_said_to_be_that(tmp_path):
    with pytest.raises(TableError, match="column names and no row below them"):
        read_bench_table(written(tmp_path, "current_A,distance_m,force_N\n"))


@pytest.mark.parametrize(
    ("noise", "part"),
    [
        ("[noise]\nforce_n_N = 2e-4\n", "Did you mean force_N"),
        ("[noise]\nwibble = 1.0\n", "flux_linkage_Wb"),
        ("forceN = 2e-4\n", "Did you mean force_N"),
    ],
)
def test_a_noise_that_belongs_to_no_channel_is_refused_and_not_lost(tmp_path, noise, part):
    with pytest.raises(TableError, match=part):
        read_bench_table(written(tmp_path, CONTRACT, noise))


def test_a_noise_under_a_column_s_header_is_in_that_column_s_unit(tmp_path):
    text = "Strom (A);Luftspalt (mm);Kraft (mN)\n0,5;2;250\n1,0;2;480\n"
    for key in ("Kraft", '"Kraft (mN)"', "force_mN"):
        table = read_bench_table(written(tmp_path, text, f"[noise]\n{key} = 0.2\n"))
        assert table.declared_noise == {"force_N": pytest.approx(2e-4)}
    assert read_bench_table(written(tmp_path, text, "[noise]\nforce_N = 0.2\n")).declared_noise == {"force_N": 0.2}


def test_a_drawing_of_the_same_name_is_no_sidecar(tmp_path):
    table = read_bench_table(written(tmp_path, CONTRACT, "schema = 1\n[coil]\nturns = 100\n[hall]\nz_mm = 1.0\n"))
    assert not table.declared_noise
    assert not [one for one in table.findings if one.code == "unused-setting"]


def test_a_distance_in_volts_is_told_of_the_column_of_position_sensors(tmp_path):
    path = tmp_path / "bench.csv"
    path.write_text("current_A,laser_V,force_N\n1,2,3\n")
    with pytest.raises(TableError, match=r"--column HEADER=position_V"):
        read_bench_table(path, columns={"laser_V": "distance_m"})
