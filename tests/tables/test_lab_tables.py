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
    number = read_measurement(path, columns=columns, units={"Kanal 2": 1e-3, "force_N": 0.00980665})
    assert number.rows["force_N"].tolist() == pytest.approx(read.rows["force_N"].tolist())
    timed = read_measurement(path, columns=columns | {"Kanal 1": "time_s"})
    assert isinstance(timed, TimeSeries)


def test_a_sidecar_says_columns_units_and_noise_and_options_count_before_it(tmp_path):
    path = written(tmp_path / "a.csv", "Kanal 1;Kanal 2;Kanal 3")
    lines = ['"Kanal 1" = "current_A"', '"Kanal 2" = "distance_m"', '"Kanal 3" = "force_N"']
    units = ['"Kanal 2" = "mm"', '"Kanal 3" = "gf"']
    noise = ["force_N = 0.01", "current_A = 0.002"]
    text = "\n".join(["[columns]", *lines, "[units]", *units, "[noise]", *noise])
    (tmp_path / "a.toml").write_text(text)
    read = read_measurement(path)
    assert read.rows["force_N"].tolist() == pytest.approx([GRAM_N * x for x in (250, 480, 70, 130)])
    assert read.declared_noise == {"force_N": 0.01, "current_A": 0.002}
    given = read_measurement(path, units={"Kanal 3": "mN"}, noise={"force_mN": 3.0})
    assert given.rows["force_N"].max() == pytest.approx(0.48)
    assert given.declared_noise == pytest.approx({"force_N": 0.003, "current_A": 0.002})
    with pytest.raises(TableError, match="standard deviation"):
        read_measurement(path, noise={"force_N": -1.0})
    (tmp_path / "a.toml").write_text("units = 3")
    with pytest.raises(TableError, match="units"):
        read_measurement(path)


def test_a_unit_alone_belongs_to_the_only_column_of_its_kind(tmp_path):
    path = written(tmp_path / "a.csv", "Strom;Luftspalt;Kraft")
    read = read_measurement(path, units={"gf": "gf", "mm": "mm"}).rows
    assert read["force_N"].tolist() == pytest.approx([GRAM_N * x for x in (250, 480, 70, 130)])
    assert read["distance_m"].tolist() == [0.002, 0.002, 0.004, 0.004]
    imported = import_table(path, units={"gf": "gf", "distance": "mm"}).rows
    assert imported["force_N"].max() == pytest.approx(GRAM_N * 480)


def test_a_unit_alone_that_two_columns_may_have_is_refused(tmp_path):
    rows = [f"{row};1" for row in ("0,5;2;2,5", "1,0;2;4,8", "0,5;4;0,7", "1,0;4;1,3")]
    path = written(tmp_path / "a.csv", "Strom [A];Luftspalt [mm];Hallspannung;Spannung", rows)
    with pytest.raises(TableError, match=r"Hallspannung, Spannung.*--unit HEADER=mV"):
        read_measurement(path, units={"mV": "mV"})
    with pytest.raises(TableError, match="none"):
        read_measurement(path, units={"gf": "gf"})


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


POINTS = [(2, 0.5, 25.4), (2, 1, 48.1), (4, 0.5, 7.2), (4, 1, 13)]


def force_of(path):
    """The forces that both readers take from a file, which must agree, in cN."""
    read, imported = read_measurement(path).rows, import_table(path).rows
    assert sorted(read["force_N"]) == pytest.approx(sorted(imported["force_N"]))
    assert sorted(read["distance_m"]) == pytest.approx(sorted(imported["distance_m"]))
    return (100 * read["force_N"]).tolist()


@pytest.mark.parametrize(
    ("unit", "factor"), [("cN", 0.01), ("daN", 10), ("dN", 0.1), ("hN", 100), ("µN", 1e-6), ("pN", 1e-12), ("kN", 1e3)]
)
@pytest.mark.parametrize("header", ["Strom;Luftspalt;Kraft\nA;mm;{}", "Strom (A);Luftspalt (mm);Kraft ({})"])
def test_every_usual_prefix_is_known_in_a_header_and_in_a_line_of_units(tmp_path, unit, factor, header):
    path = tmp_path / "a.csv"
    path.write_text(header.format(unit) + "\n0,5;2;250\n1,0;2;480\n0,5;4;70\n1,0;4;130\n", encoding="utf-8")
    expected = [factor * x for x in (250, 480, 70, 130)]
    assert read_measurement(path).rows["force_N"].tolist() == pytest.approx(expected)


def test_symbols_that_are_units_too_are_names_beside_other_names(tmp_path):
    path = written(tmp_path / "a.csv", "s;t;F", ["1;2;3", "2;2;3"])
    assert (
        import_table(path, columns={"t": "current"}, units={"s": "mm"}, accept=("one-current",)).mapping[1].header
        == "s"
    )


def test_a_name_of_one_letter_counts_with_the_unit_that_the_user_gives(tmp_path):
    path = written(tmp_path / "a.csv", "i;d;F [N]", ["500;2;3", "1000;2;3"])
    rows = read_measurement(path, units={"i": "mA", "d": "mm"}).rows
    assert rows[["current_A", "distance_m"]].iloc[0].tolist() == [0.5, 0.002]


def test_a_matrix_without_units_says_that_they_were_assumed(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("d;0.5;1;1.5\n0.002;1;2;3\n0.004;0.5;1;1.5\n0.006;0.2;0.4;0.6\n", encoding="utf-8")
    said = [one.text for one in import_table(path).findings if one.code == "assumed-units"]
    assert len(said) == 1
    assert all(name in said[0] for name in ("first column in m", "first row in A", "matrix in N"))


def test_the_number_of_a_channel_in_brackets_is_no_factor(tmp_path):
    path = written(tmp_path / "a.csv", "Strom [A];Luftspalt [mm];Kraft [2]", ["0.5;2;3", "1;2;4", "0.5;4;1", "1;4;2"])
    assert sorted(import_table(path).rows["force_N"]) == [1, 2, 3, 4]
    assert sorted(read_measurement(path, columns={"Kraft [2]": "force_N"}).rows["force_N"]) == [1, 2, 3, 4]


def test_an_unknown_unit_is_named_and_not_taken_for_newtons(tmp_path):
    path = written(tmp_path / "a.csv", "Strom;Luftspalt;Kraft\nA;mm;furlong")
    for read in (read_measurement, import_table):
        with pytest.raises(TableError, match="furlong"):
            read(path)


def test_a_spreadsheet_with_title_lines_and_units_in_centinewtons_is_read(tmp_path):
    lines = [f"{k};{d},0;{i:.2f};{f:.1f}".replace(".", ",") for k, (d, i, f) in enumerate(POINTS, 1)]
    above = "Prüfprotokoll HM-12;;;\nPrüfer: Müller;Datum: 12.03.2026;;\n;;;\nNr.;Luftspalt;Strom;Zugkraft\n"
    path = written(tmp_path / "a.csv", ";mm;A;cN", [*lines, ";;;"], above=above)
    assert force_of(path) == pytest.approx([25.4, 48.1, 7.2, 13])


def test_repeated_headers_footnotes_and_a_line_of_means_are_no_readings(tmp_path):
    header = "Nr\tGap [mm]\tCurrent [A]\tForce [cN]"
    lines = [f"{k}\t{d},0\t{i:.2f}\t{f:.1f}".replace(".", ",") for k, (d, i, f) in enumerate(POINTS, 1)]
    rows = [*lines[:2], header, *lines[2:], "Mean\t3,0\t0,75\t23,4", "* at room temperature", "1) balance zeroed"]
    path = written(tmp_path / "a.txt", header, rows)
    assert force_of(path) == pytest.approx([25.4, 48.1, 7.2, 13])
    assert any("Mean" in str(said) for said in read_measurement(path).findings)


def test_a_word_beside_the_last_reading_is_no_line_of_means(tmp_path):
    rows = [f"{d};{i};{f};{'max' if d == 4 else 'ok'}" for d, i, f in POINTS]
    assert (
        len(read_measurement(written(tmp_path / "a.csv", "Luftspalt [mm];Strom [A];Kraft [cN];Status", rows)).rows) == 4
    )


@pytest.mark.parametrize("below", ["actual\tmean\tmean", "mm\tA\tcN"])
def test_a_second_line_of_the_header_is_used_or_said(tmp_path, below):
    path = written(tmp_path / "a.csv", "air gap\tcurrent\tpull\n" + below, ["2\t0.5\t25.4", "2\t1\t48.1", "4\t1\t13"])
    table = read_measurement(path)
    assert table.rows["force_N"].iloc[0] == pytest.approx(0.254 if "cN" in below else 25.4)
    assert ("line 2" in str(table).lower()) == ("cN" not in below)


def test_columns_under_one_heading_are_told_apart(tmp_path):
    path = written(
        tmp_path / "a.csv", "Luftspalt [mm];Strom [A];;Kraft [N];\n;Soll;Ist;Mittel;s", ["2;0,5;0,51;2,54;0,1"] * 2
    )
    with pytest.raises(TableError, match="force_N"):
        read_measurement(path)
    columns = {"Strom [A] Ist": "current_A", "Kraft [N] Mittel": "force_N"}
    rows = read_measurement(path, columns=columns).rows
    assert rows[["current_A", "force_N"]].iloc[0].tolist() == [0.51, 2.54]


@pytest.mark.parametrize(
    "moment", ["12:34:56,{:03d}", "2026-03-12T12:34:56.{:03d}", "12.03.2026 12:34:56,{:03d}", "12:34:56.{:03d}"]
)
def test_a_logger_s_clock_counts_seconds_from_its_first_moment(tmp_path, moment):
    rows = [f"{moment.format(50 * k)};2,{k:03d};0,{k:02d};{'OK' if k % 7 else 'WARN'}" for k in range(20)]
    table = read_measurement(written(tmp_path / "a.csv", "Uhrzeit;Weg [mm];Strom [A];Status", rows))
    assert isinstance(table, TimeSeries)
    assert table.rows["time_s"].to_numpy() == pytest.approx([0.05 * k for k in range(20)])
    assert "Status" in str(table)


def test_a_clock_runs_on_over_midnight(tmp_path):
    rows = [f"{moment};2,1;0,5" for moment in ("23:59:59,8", "23:59:59,9", "00:00:00,0", "00:00:00,1")]
    table = read_measurement(written(tmp_path / "a.csv", "Zeit;Weg [mm];Strom [A]", rows))
    assert table.rows["time_s"].to_numpy() == pytest.approx([0.0, 0.1, 0.2, 0.3])


def test_the_time_of_day_beside_each_reading_of_a_protocol_is_its_order(tmp_path):
    rows = [f"12:{k:02d}:05;2,{k};0,5;1,{k}" for k in (3, 1, 2, 0)]
    table = read_measurement(written(tmp_path / "a.csv", "Uhrzeit;Luftspalt [mm];Strom [A];Kraft [N]", rows))
    assert isinstance(table, BenchTable)
    assert table.rows["force_N"].tolist() == [1.0, 1.1, 1.2, 1.3]
    (said,) = (one for one in table.findings if one.code == "protocol")
    assert "60 s apart" in said.text
    assert "--column Uhrzeit=time_s" in said.text


def test_minutes_beside_each_reading_of_a_protocol_are_its_order(tmp_path):
    rows = [f"{k};2,{k};0,5;1,{k}" for k in (3, 1, 2, 0)]
    table = read_measurement(written(tmp_path / "a.csv", "t [min];Luftspalt [mm];Strom [A];Kraft [N]", rows))
    assert isinstance(table, BenchTable)
    assert table.rows["force_N"].tolist() == [1.0, 1.1, 1.2, 1.3]
    assert {one.code for one in table.findings} & {"protocol", "suspected-unit"} == {"protocol"}


def test_a_column_of_times_without_a_number_says_what_it_holds(tmp_path):
    rows = [f"soon;2,{k};0,5;1,{k}" for k in range(4)]
    with pytest.raises(TableError, match=r"lacks time_s .* hold no number \('soon'\)"):
        read_measurement(written(tmp_path / "a.csv", "time_s;Luftspalt [mm];Strom [A];Kraft [N]", rows))


@pytest.mark.parametrize("damaged", ["2,0;0,x;bad", "??;??;1,0", "2,0;0,5"])
def test_a_first_row_that_cannot_be_read_is_called_a_row(tmp_path, damaged):
    rows = [damaged, *(f"2,{k};0,5;1,{k}" for k in range(4))]
    table = read_measurement(written(tmp_path / "a.csv", "Luftspalt [mm];Strom [A];Kraft [N]", rows))
    texts = [one.text for one in table.findings]
    assert any(text.startswith("Line 2 was left out, a row") and damaged in text for text in texts)
    assert not any("ignored" in text for text in texts)


def test_a_line_of_words_below_the_names_is_text(tmp_path):
    rows = ["gemessen;gestellt;gemessen", *(f"2,{k};0,5;1,{k}" for k in range(4))]
    table = read_measurement(written(tmp_path / "a.csv", "Luftspalt [mm];Strom [A];Kraft [N]", rows))
    assert any("ine 2 above the readings is text" in one.text for one in table.findings)


def test_dates_that_may_be_read_two_ways_are_refused(tmp_path):
    rows = [f"0{k}/04/2026 12:34:56,1;2,1;0,5" for k in (3, 4)]
    with pytest.raises(TableError, match="2026-03-12"):
        read_measurement(written(tmp_path / "a.csv", "Zeit;Weg [mm];Strom [A]", rows))
