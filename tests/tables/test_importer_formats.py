"""Every kind of table that FEMM users have gives the same sweep table."""

import numpy as np
import pandas as pd
import pytest

from femfit.core.errors import TableError
from femfit.tables.foreign.options import ImportOptions
from femfit.tables.foreign.read import read_foreign_table
from femfit.tables.sweep_table import read_sweep_table, write_sweep_table

DIGITS = 3e-9  # tables below are printed with nine significant digits or more


def write(path, header, rows, delimiter=";", decimal=".", before=(), encoding="utf-8"):
    """A text table with numbers of ten digits."""
    lines = [*before, *([delimiter.join(header)] if header else [])]
    lines += [delimiter.join(f"{value:.10g}".replace(".", decimal) for value in row) for row in rows]
    path.write_text("\n".join(lines) + "\n", encoding=encoding)
    return path


def assert_same(imported, table, columns=("force", "flux_linkage")):
    """The imported rows are the law's, in SI and in order."""
    rows = imported.rows
    expected = table.sort_values(["current", "distance"]).reset_index(drop=True)
    assert len(rows) == len(expected)
    names = {"current": "current_A", "distance": "distance_m", "force": "force_N", "flux_linkage": "flux_linkage_Wb"}
    for name in ("current", "distance", *columns):
        np.testing.assert_allclose(rows[names[name]], expected[name], rtol=DIGITS, atol=1e-15)
    assert (rows["status"] == "ok").all()


def rows_of(table, *scaled):
    """Columns of a table times factors: ("distance", 1e3)."""
    return np.column_stack([table[name] * factor for name, factor in scaled])


def test_blank_separated_text_with_free_text_lines_and_inches(tmp_path, law):
    table = law.table()
    header = ["Z(inch)", "Current(A)", "Resistance(mO)", "ForceOnSlug(N)"]
    body = rows_of(table, ("distance", 1 / 0.0254), ("current", 1), ("current", 0), ("force", 1))
    before = ["Solenoid sweep of the long coil,", "made with a Lua script on a Friday"]
    path = write(tmp_path / "slug.txt", header, body, delimiter="  ", before=before)
    imported = read_foreign_table([path])
    assert_same(imported, table, columns=("force",))
    assert any("is text" in finding.text or "are text" in finding.text for finding in imported.findings)


def test_semicolons_with_decimal_commas_and_a_two_word_header(tmp_path, law):
    table = law.table()
    body = rows_of(table, ("current", 1), ("distance", 1e3), ("force", 1e3), ("flux_linkage", 1e6))
    path = write(
        tmp_path / "a.csv", ["Current [A]", "Distance [mm]", "Force [mN]", "Flux linkage [uWb]"], body, decimal=","
    )
    assert_same(read_foreign_table([path]), table)


@pytest.mark.parametrize("delimiter", [",", ";", "\t", "|", "   "])
@pytest.mark.parametrize("decimal", [".", ","])
def test_delimiter_and_decimal_mark_are_found_together(tmp_path, law, delimiter, decimal):
    if delimiter == decimal:
        pytest.skip("a comma cannot be both")
    table = law.table()
    body = rows_of(table, ("current", 1), ("distance", 1), ("force", 1), ("flux_linkage", 1))
    header = ["Current_A", "distance_m", "F_em_N", "flux_Wb"]
    assert_same(read_foreign_table([write(tmp_path / "t.csv", header, body, delimiter, decimal)]), table)


HEADERS = [
    ["Strom (A)", "Luftspalt (mm)", "Kraft (N)", "verketteter Fluss (Wb)"],
    ["I / A", "Abstand / mm", "Magnetkraft / N", "Flussverkettung / Wb"],
    ["Strom in A", "Abstand in mm", "Kraft in N", "Psi in Wb"],
    ["Stromstärke_A", "Luftspalt_mm", "Zugkraft_N", "Spulenfluss_Vs"],
    ["i", "d (mm)", "Fz", "λ"],
]


@pytest.mark.parametrize(
    ("header", "encoding"),
    [
        *((header, "utf-8") for header in HEADERS),
        *((HEADERS[3], encoding) for encoding in ("utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "cp1252")),
    ],
)
def test_english_and_german_headers_are_understood_in_every_encoding(tmp_path, law, header, encoding):
    table = law.table()
    body = rows_of(table, ("current", 1), ("distance", 1e3), ("force", 1), ("flux_linkage", 1))
    assert_same(read_foreign_table([write(tmp_path / "t.csv", header, body, encoding=encoding)]), table)


def test_headers_without_units_take_them_from_the_options(tmp_path, law):
    table = law.table()
    body = rows_of(table, ("current", 1), ("distance", 1e3), ("force", 1))
    path = write(tmp_path / "t.csv", ["Strom", "Position", "Kraft"], body, delimiter=",")
    with pytest.raises(TableError, match="distance_m=mm"):
        read_foreign_table([path])
    imported = read_foreign_table([path], ImportOptions(units={"distance": "mm"}))
    assert_same(imported, table, columns=("force",))


def test_units_in_a_line_of_their_own_below_the_header(tmp_path, law):
    table = law.table()
    body = rows_of(table, ("current", 1e3), ("distance", 1e3), ("force", 1))
    path = write(tmp_path / "t.csv", None, body, before=["Strom;Weg;Kraft", "[mA];[mm];[N]"])
    assert_same(read_foreign_table([path]), table, columns=("force",))


def test_a_header_behind_a_comment_mark_is_the_header(tmp_path, law):
    table = law.table()
    body = rows_of(table, ("current", 1), ("distance", 1e3), ("force", 1))
    path = write(tmp_path / "t.dat", None, body, " ", before=["% made by a script", "% current_A distance_mm force_N"])
    assert_same(read_foreign_table([path]), table, columns=("force",))


def test_thousands_marks_do_not_change_the_numbers(tmp_path):
    rows = [f"{current};{d};{force}" for current, force in (("0", "0,5"), ("1.400,0", "2,5")) for d in ("5,0", "9,5")]
    (tmp_path / "t.csv").write_text("\n".join(["current_mA;distance_mm;force_N", *rows]))
    table = read_foreign_table([tmp_path / "t.csv"]).rows
    assert table["current_A"].tolist() == [0, 0, 1.4, 1.4]
    assert table["distance_m"].tolist() == [5e-3, 9.5e-3, 5e-3, 9.5e-3]
    assert table["force_N"].tolist() == [0.5, 0.5, 2.5, 2.5]


@pytest.mark.parametrize("label", ["{:g}", "{:g} A", "I={:g}", "F @ {:g} A", "i = {:g} A", "current_{:g}A"])
def test_a_matrix_with_axes_in_its_first_row_and_column(tmp_path, law, label):
    table = law.table()
    matrix = table.pivot_table(index="distance", columns="current", values="force")
    header = ["d [mm]", *(label.format(current) for current in matrix.columns)]
    body = np.column_stack([matrix.index * 1e3, matrix.to_numpy()])
    imported = read_foreign_table([write(tmp_path / "m.csv", header, body)])
    assert_same(imported, table, columns=("force",))


def test_the_corner_of_a_matrix_names_its_units(tmp_path, law):
    table = law.table()
    matrix = table.pivot_table(index="distance", columns="current", values="force") * 1e3
    header = ["F [mN] d [mm] \\ I [A]", *(f"{current:g}" for current in matrix.columns)]
    path = write(tmp_path / "m.csv", header, np.column_stack([matrix.index * 1e3, matrix.to_numpy()]))
    assert_same(read_foreign_table([path]), table, columns=("force",))


@pytest.mark.parametrize("header", ["i_A;d_mm;F_N;psi_Wb", "i_A;d_mm;F_N;psi_Wb;"])
def test_a_delimiter_at_the_end_of_each_line_is_no_column(tmp_path, law, header):
    table = law.table()
    body = rows_of(table, ("current", 1), ("distance", 1e3), ("force", 1), ("flux_linkage", 1))
    path = write(tmp_path / "t.csv", None, body, before=[header])
    path.write_text("\n".join([header, *(f"{line};" for line in path.read_text().splitlines()[1:])]))
    assert_same(read_foreign_table([path]), table)


def test_an_empty_last_cell_is_a_gap_of_its_column_only(tmp_path, law):
    table = law.table()
    body = rows_of(table, ("current", 1), ("distance", 1e3), ("force", 1), ("flux_linkage", 1))
    path = write(tmp_path / "t.csv", ["i_A", "d_mm", "F_N", "psi_Wb"], body)
    lines = path.read_text().splitlines()
    lines[7] = lines[7].rsplit(";", 1)[0] + ";"
    path.write_text("\n".join(lines))
    imported = read_foreign_table([path])
    assert_same(imported, table, columns=("force",))
    assert any(finding.code == "gaps" and "line 8" in finding.text for finding in imported.findings)


def test_a_matrix_with_currents_down_is_recognised_by_its_zero(tmp_path, law):
    table = law.table()
    matrix = table.pivot_table(index="current", columns="distance", values="force")
    body = np.column_stack([matrix.index, matrix.to_numpy()])
    path = write(tmp_path / "m.csv", ["", *(f"{distance * 1e3:g}" for distance in matrix.columns)], body)
    imported = read_foreign_table([path], ImportOptions(units={"distance": "mm"}))
    assert_same(imported, table, columns=("force",))


def test_a_blank_separated_matrix_without_corner(tmp_path, law):
    table = law.table()
    matrix = table.pivot_table(index="distance", columns="current", values="force")
    head = "        " + " ".join(f"{current:g}" for current in matrix.columns)
    body = np.column_stack([matrix.index * 1e3, matrix.to_numpy()])
    path = write(tmp_path / "m.txt", None, body, "  ", before=[head])
    assert_same(read_foreign_table([path], ImportOptions(units={"distance": "mm"})), table, columns=("force",))


def test_one_file_a_current_named_after_it(tmp_path, law):
    table = law.table()
    for current, group in table.groupby("current"):
        body = rows_of(group, ("distance", 1e3), ("force", 1), ("flux_linkage", 1))
        name = f"force_{current:g}A.csv".replace("0.8", "0p8")
        write(tmp_path / name, ["z_mm", "Fz_N", "psi_Wb"], body, delimiter=",")
    imported = read_foreign_table([tmp_path])
    assert_same(imported, table)
    assert len(imported.manifest["sources"]) == 4


def test_one_file_a_current_with_the_currents_given(tmp_path, law):
    table = law.table()
    paths = [
        write(tmp_path / f"run{letter}.csv", ["z_mm", "Fz_N"], rows_of(group, ("distance", 1e3), ("force", 1)))
        for letter, (_, group) in zip("abcd", table.groupby("current"), strict=True)
    ]
    options = ImportOptions(file_currents_A=tuple(table["current"].unique()))
    assert_same(read_foreign_table(paths, options), table, columns=("force",))
    with pytest.raises(TableError, match="one a file"):
        read_foreign_table(paths, ImportOptions(file_currents_A=(1.0,)))


def test_one_file_a_distance_named_after_it(tmp_path, law):
    table = law.table(distances=[0.01, 0.015, 0.02])
    for distance, group in table.groupby("distance"):
        body = rows_of(group, ("current", 1), ("force", 1))
        write(tmp_path / f"sweep_gap{distance * 1e3:g}mm.csv", ["Current_A", "F_em_N"], body, delimiter=",")
    assert_same(read_foreign_table([tmp_path]), table, columns=("force",))


def test_displacement_as_step_count(tmp_path, law):
    table = law.table()
    body = rows_of(table, ("current", 1), ("distance", 1e3), ("force", 1))
    body[:, 1] -= 5
    path = write(tmp_path / "t.csv", ["current", "step", "force"], body)
    with pytest.raises(TableError, match="--distance-step-mm"):
        read_foreign_table([path])
    options = ImportOptions(distance_step_m=1e-3, distance_start_m=5e-3)
    assert_same(read_foreign_table([path], options), table, columns=("force",))


def test_positions_that_count_towards_the_magnet(tmp_path, law):
    table = law.table()
    body = rows_of(table, ("current", 1), ("distance", -1e3), ("force", 1))
    path = write(tmp_path / "t.csv", ["I_A", "position_mm", "Fz_N"], body)
    with pytest.raises(TableError, match="--flip-distance"):
        read_foreign_table([path])
    assert_same(read_foreign_table([path], ImportOptions(flip_distance=True)), table, columns=("force",))


def test_a_table_without_header_needs_names(tmp_path, law):
    table = law.table()
    path = write(tmp_path / "t.txt", None, rows_of(table, ("distance", 1e3), ("current", 1), ("force", 1)), " ")
    with pytest.raises(TableError, match="--columns"):
        read_foreign_table([path])
    options = ImportOptions(column_names=("distance_mm", "current", "force"))
    assert_same(read_foreign_table([path], options), table, columns=("force",))


def test_parquet_is_read_like_text(tmp_path, law):
    table = law.table()
    table.rename(columns={"force": "Kraft_N", "current": "Strom_A", "distance": "gap_m"}).to_parquet(
        tmp_path / "t.parquet"
    )
    assert_same(read_foreign_table([tmp_path / "t.parquet"]), table)


def test_the_sweep_table_that_was_imported_can_be_imported_again(tmp_path, law):
    table = law.table()
    body = rows_of(table, ("current", 1), ("distance", 1e3), ("force", 1), ("flux_linkage", 1))
    first = read_foreign_table([write(tmp_path / "t.csv", ["i_A", "d_mm", "F_N", "psi_Wb"], body)])
    write_sweep_table(first, tmp_path / "out")
    again = read_foreign_table([tmp_path / "out" / "sweep.csv"])
    pd.testing.assert_frame_equal(again.rows, first.rows, rtol=1e-12)
    assert read_sweep_table(tmp_path / "out").manifest["kind"] == "import"


def test_two_columns_for_one_quantity_are_left_to_the_user(tmp_path, law):
    table = law.table()
    body = rows_of(table, ("distance", 1), ("current", 1), ("force", 1), ("flux_linkage", 1), ("flux_linkage", 2))
    path = write(tmp_path / "t.csv", ["z", "ni_scale", "Fz", "flux_lo", "flux_hi"], body, ",")
    with pytest.raises(TableError, match="--column HEADER=current"):
        read_foreign_table([path])
    imported = read_foreign_table([path], ImportOptions(columns={"ni_scale": "current"}, units={"current": "1.0"}))
    assert "flux_linkage_Wb" not in imported.rows
    assert any(finding.code == "choice" and "flux_hi" in finding.text for finding in imported.findings)
    chosen = ImportOptions(columns={"ni_scale": "current", "flux_lo": "flux_linkage"})
    decided = read_foreign_table([path], chosen)
    assert_same(decided, table)
    assert not any(finding.code == "choice" for finding in decided.findings)
    assert any(finding.text == "Not used: flux_hi." for finding in decided.findings)
    wrong = ImportOptions(columns={"ni_scale": "current", "flux_hi": "flux_linkage"})
    with pytest.raises(TableError, match="reciprocity"):
        read_foreign_table([path], wrong)


def test_an_unknown_unit_names_the_option(tmp_path, law):
    body = rows_of(law.table(), ("current", 1), ("distance", 1), ("force", 1))
    path = write(tmp_path / "t.csv", ["I(A)", "Z(furlng)", "F(N)"], body)
    with pytest.raises(TableError, match="--unit distance"):
        read_foreign_table([path])
    assert_same(read_foreign_table([path], ImportOptions(units={"distance": "m"})), law.table(), columns=("force",))


def test_the_manifest_says_how_the_table_was_read(tmp_path, law):
    body = rows_of(law.table(), ("current", 1), ("distance", 1e3), ("force", 1))
    path = write(tmp_path / "t.csv", ["i_A", "d_mm", "F_N"], body)
    manifest = read_foreign_table([path]).manifest
    assert manifest["kind"] == "import"
    assert len(manifest["sources"][0]["sha256"]) == 64
    assert {entry["header"]: entry["factor_to_SI"] for entry in manifest["mapping"]} == {
        "i_A": 1,
        "d_mm": 1e-3,
        "F_N": 1,
    }
    assert manifest["versions"]["femfit"]


def test_a_first_row_that_goes_on_as_the_others_is_not_taken_for_the_currents(tmp_path):
    """Forces of even round numbers, with distances 1, 2, 3 mm beside them and no row of currents."""
    (tmp_path / "m.csv").write_text("1,30,20,10\n2,15,10,5\n3,7,5,2\n")
    with pytest.raises(TableError, match="row of forces"):
        read_foreign_table([tmp_path / "m.csv"], ImportOptions(form="matrix", units={"distance": "mm"}))
    (tmp_path / "m.csv").write_text("0,0.5,1,1.5\n1,30,40,50\n2,15,20,25\n")
    options = ImportOptions(form="matrix", units={"distance": "mm"})
    assert len(read_foreign_table([tmp_path / "m.csv"], options).rows) == 6
