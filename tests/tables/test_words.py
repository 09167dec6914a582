"""What a user says of a table, in a sidecar, an option or a call, holds for every reader; what cannot be is refused."""

import numpy as np
import pandas as pd
import pytest

from femfit.core.errors import TableError
from femfit.integrate.bench_table import make_bench_table
from femfit.integrate.integrate_coil import integrate_coil
from femfit.tables.coil_record import open_coil_record
from femfit.tables.foreign import import_table
from femfit.tables.measurement_file import read_measurement

TIME = np.arange(0.0, 2.0, 1e-3)
COIL = pd.DataFrame({"time_s": TIME, "coil_voltage_V": 0.05 * np.cos(TIME), "current_A": np.sin(TIME)})
ROWS = "".join(f"{d},{0.2 * i:g},{(1 + i) / d:.6g}\n" for i in range(3) for d in range(5, 17))


def written(path, text):
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("header", "column"),
    [
        *(
            (name, "voltage_V")
            for name in ("U_Klemme [V]", "U_Kl", "Klemmenspannung", "V_term [V]", "Terminal voltage")
        ),
        *((name, "current_A") for name in ("I_Spule [A]", "I_coil")),
        *((name, "force_N") for name in ("F", "F [N]", "f [N]", "Fz")),
    ],
)
def test_a_column_is_what_benches_call_it(tmp_path, header, column):
    others = {"current_A", "distance_m", "force_N"} - {column}
    rows = pd.DataFrame({name: np.linspace(0.01, 0.02, 9) for name in others}).assign(**{header: np.linspace(1, 2, 9)})
    rows.to_csv(tmp_path / "bench.csv", index=False)
    assert read_measurement(tmp_path / "bench.csv").rows[column].tolist() == pytest.approx(np.linspace(1, 2, 9))


def test_a_lone_f_is_the_frequency_of_an_impedance(tmp_path):
    text = "distance_mm,f,Ls [mH],Rs\n" + "".join(f"2,{f},3.1,1.{f}\n" for f in (100, 200, 400))
    assert "frequency_Hz" in read_measurement(written(tmp_path / "lcr.csv", text)).given


SIDECAR = (
    '[columns]\n"Kanal 1" = "distance_m"\n"Kanal 2" = "current_A"\n"Kanal 3" = "force_N"\n[units]\n"Kanal 1" = "mm"\n'
)


def test_a_sidecar_an_option_and_a_keyword_are_one_thing_for_an_import(tmp_path):
    named = import_table(written(tmp_path / "named.csv", "distance_mm,current_A,force_N\n" + ROWS))
    path = written(tmp_path / "t.csv", "Kanal 1,Kanal 2,Kanal 3\n" + ROWS)
    columns = {"Kanal 1": "distance_m", "Kanal 2": "current_A", "Kanal 3": "force_N"}
    called = import_table(path, columns=columns, units={"Kanal 1": "mm"})
    written(tmp_path / "t.toml", SIDECAR)
    for table in (called, import_table(path)):
        pd.testing.assert_frame_equal(table.rows, named.rows)
    with pytest.raises(TableError, match="lacks distance_m"):
        import_table(path, columns={"Kanal 1": "hall_T"}, units={"Kanal 1": "T"})  # the call counts before the sidecar


def test_what_was_the_same_throughout_is_said_of_an_import_too(tmp_path):
    rows = "d_mm,F_N\n" + "".join(f"{d},{1 / d:.5g}\n" for d in range(5, 17))
    table = import_table(written(tmp_path / "t.csv", rows), settings={"current_mA": 500}, accept=("one-current",))
    assert set(table.rows["current_A"]) == {0.5}


def test_a_coil_record_has_a_sidecar_and_one_in_memory_takes_the_same_words(tmp_path):
    named = COIL.rename(columns={"coil_voltage_V": "Kanal 1"}).assign(**{"Kanal 1": 1e3 * COIL["coil_voltage_V"]})
    named.to_csv(tmp_path / "r.csv", index=False)
    words = {"columns": {"Kanal 1": "coil_voltage_V"}, "units": {"Kanal 1": "mV"}}
    value = integrate_coil(COIL, method="trapezoid").value
    assert integrate_coil(named, method="trapezoid", **words).value == pytest.approx(value)
    assert integrate_coil(tmp_path / "r.csv", method="trapezoid", **words).value == pytest.approx(value)
    written(tmp_path / "r.toml", '[columns]\n"Kanal 1" = "coil_voltage_V"\n[units]\n"Kanal 1" = "mV"\n')
    (block,) = open_coil_record(tmp_path / "r.csv").blocks()
    np.testing.assert_allclose(block.voltage, COIL["coil_voltage_V"])
    named.assign(distance_mm=5.0).to_csv(tmp_path / "r.csv", index=False)
    with pytest.raises(TableError, match="The current changes slowly"):  # it found its columns
        make_bench_table(tmp_path / "r.csv")


@pytest.mark.parametrize(
    ("read", "options", "mentions"),
    [
        (import_table, {"decimal": "x"}, "decimal must be one of"),
        (import_table, {"decimal": ""}, "decimal must be one of"),
        (import_table, {"matrix_rows": "force"}, "matrix_rows must be one of"),
        (import_table, {"units": 3}, "units must hold lines like"),
        (read_measurement, {"columns": ["force_N"]}, "columns must hold lines like"),
        (read_measurement, {"units": {3: "mm"}}, "units must hold lines like"),
        (read_measurement, {"units": {"force_N": "1e300"}}, "is not a unit of column"),
        (read_measurement, {"noise": {1: 2.0}}, "noise must hold lines like"),
        (read_measurement, {"settings": {"coil_temperature_C": -500.0}}, "must be possible, -273.15 to 2000"),
        (open_coil_record, {"units": {"time_s": 1e-300}}, "lacks time_s|is not a unit of column"),
    ],
)
def test_words_of_another_kind_are_refused_with_what_is_needed(tmp_path, read, options, mentions):
    path = written(tmp_path / "t.csv", "distance_mm,current_A,force_N\n" + ROWS)
    if read is open_coil_record:
        COIL.to_csv(path, index=False)
    with pytest.raises(TableError, match=mentions):
        read(path, **options)


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("initial_field_T", np.nan),
        ("initial_field_T", -1e300),
        ("coil_area_m2", 1e-300),
        ("coil_area_sigma_m2", -1.0),
        ("offset_sigma_V", 1e300),
        ("offset_sigma_V", "x"),
        ("coverage", 0.0),
    ],
)
def test_an_option_of_an_integral_that_is_no_such_number_is_refused(option, value):
    with pytest.raises(TableError, match="must be"):
        integrate_coil(COIL, method="ffa2", **{option: value})


def test_two_columns_of_one_name_and_steps_of_no_clock_are_refused_by_the_name_of_the_record():
    doubled = pd.concat([COIL, COIL[["current_A"]]], axis=1)
    with pytest.raises(TableError, match="the table has more than one column named current_A"):
        integrate_coil(doubled, method="trapezoid")
    with pytest.raises(TableError, match="the table jumps back"):
        integrate_coil(COIL.assign(time_s=1e-320 * np.arange(len(COIL))), method="trapezoid")
