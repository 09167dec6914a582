"""Tables as labs write them: any header, a kitchen scale for the force, title lines, columns named by the user."""

import pytest

from femfit.core.errors import TableError
from femfit.tables.foreign.read import import_table
from femfit.tables.measurement import BenchTable, TimeSeries
from femfit.tables.measurement_file import read_measurement

GRAM_N = 9.80665e-3
TITLE = "Messprotokoll Hubmagnet\nDatum: 12.03.2024;Prüfer: Müller;\n"


def written(path, header, rows=("0,5;2;250", "1,0;2;480", "0,5;4;70", "1,0;4;130"), above=""):
    path.write_bytes((above + "\n".join([header, *rows]) + "\n").encode("cp1252"))
    return path


@pytest.mark.parametrize(
    "force",
    ["Kraft [g]", "force (gram)", "Waage [g]", "Kraft [gf]", "Kraft in g", "scale (grams)", "mass [g]", "F [g]"],
)
def test_the_grams_of_a_kitchen_scale_are_a_force(tmp_path, force):
    table = read_measurement(written(tmp_path / "a.csv", f"Strom [A];Luftspalt [mm];{force}"))
    assert isinstance(table, BenchTable)
    assert table.rows["force_N"].tolist() == pytest.approx([GRAM_N * x for x in (250, 480, 70, 130)])


def test_a_mass_beside_a_force_is_not_taken_for_it(tmp_path):
    rows = [f"{row};12" for row in ("0,5;2;2,5", "1,0;2;4,8", "0,5;4;0,7", "1,0;4;1,3")]
    path = written(tmp_path / "a.csv", "Strom [A];Luftspalt [mm];Kraft [N];mass [g]", rows)
    assert read_measurement(path).rows["force_N"].tolist() == [2.5, 4.8, 0.7, 1.3]
    assert import_table(path).rows["force_N"].tolist() == [2.5, 0.7, 4.8, 1.3]


@pytest.mark.parametrize("above", [TITLE, "Messung 3\n\n" + TITLE, "Charge;17;4\n" + TITLE])
@pytest.mark.parametrize("header", ["Strom [A];Luftspalt [mm];Kraft [g]", "Strom;Luftspalt;Kraft\nA;mm;g"])
def test_title_lines_are_passed_over_wherever_a_table_is_read(tmp_path, header, above):
    path = written(tmp_path / "a.csv", header, above=above)
    read, imported = read_measurement(path).rows, import_table(path).rows
    assert sorted(read["force_N"]) == sorted(imported["force_N"]) == [GRAM_N * x for x in (70, 130, 250, 480)]
    assert sorted(read["distance_m"]) == sorted(imported["distance_m"]) == [0.002, 0.002, 0.004, 0.004]


def test_columns_and_units_can_be_said(tmp_path):
    path = written(tmp_path / "a.csv", "Kanal 1;Kanal 2;Kanal 3")
    columns = {"Kanal 1": "current_A", "kanal 2": "distance_m", "Kanal 3": "force_N"}
    units = {"Kanal 2": "mm", "force_N": "gf"}
    read = read_measurement(path, columns=columns, units=units)
    imported = import_table(path, columns=columns, units=units)
    for table in (read, imported):
        assert sorted(table.rows["distance_m"]) == [0.002, 0.002, 0.004, 0.004]
        assert sorted(table.rows["force_N"]) == pytest.approx([GRAM_N * x for x in (70, 130, 250, 480)])
    factor = read_measurement(path, columns=columns, units={"Kanal 2": "1e-3", "Kanal 3": "0.00980665"})
    assert factor.rows["force_N"].tolist() == pytest.approx(read.rows["force_N"].tolist())
    timed = read_measurement(path, columns=columns | {"Kanal 1": "time_s"})
    assert isinstance(timed, TimeSeries)


@pytest.mark.parametrize(
    ("said", "part"),
    [
        ({"columns": {"Kanal 9": "force_N"}}, "Kanal 9"),
        ({"columns": {"Kraft [g]": "torque_Nm"}}, "torque_Nm"),
        ({"units": {"Kraft": "furlong"}}, "furlong"),
        ({"units": {"Kanal": "mm"}}, "Kanal"),
        ({"units": {"Kraft": "nan"}}, "nan"),
    ],
)
def test_what_is_said_wrongly_is_refused_with_what_the_file_has(tmp_path, said, part):
    with pytest.raises(TableError, match=part):
        read_measurement(written(tmp_path / "a.csv", "Strom [A];Luftspalt [mm];Kraft [g]"), **said)


def test_a_measurement_says_what_must_be_looked_at_first(tmp_path):
    table = read_measurement(written(tmp_path / "a.csv", "Strom [A];Luftspalt [m];Kraft [N]"))
    assert str(table).splitlines()[0].startswith("check first: distance_m seems to be in mm")
    assert "4 readings" in str(table)
