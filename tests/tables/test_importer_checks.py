"""Bad cells, duplicates, holes, order, magnitudes: each a finding with its rows and remedy."""

import numpy as np
import pytest

from femfit.core.errors import TableError
from femfit.tables.foreign.options import ImportOptions
from femfit.tables.foreign.read import read_foreign_table
from femfit.tables.sweep_table import read_sweep_table, write_sweep_table


def write(path, table, header="current_A;distance_mm;force_N;flux_linkage_Wb"):
    rows = [f"{i:.10g};{1e3 * d:.10g};{f:.10g};{p:.10g}" for i, d, f, p in table.to_numpy()]
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


def finding(imported, code):
    (found,) = [finding for finding in imported.findings if finding.code == code]
    return found


@pytest.fixture
def table(law):
    return law.table(distances=np.linspace(5e-3, 20e-3, 16))


@pytest.mark.parametrize(
    "text", ["", "\n\n", "# only a comment\n", "current_A;distance_mm;force_N\n", "hello\nworld\n"]
)
def test_a_table_without_rows_is_an_error(tmp_path, text):
    (tmp_path / "t.csv").write_text(text)
    with pytest.raises(TableError, match=r"needs|no row"):
        read_foreign_table([tmp_path / "t.csv"])


@pytest.mark.parametrize("cell", ["NaN", "", "n/a", "inf", "1.#QNAN", "failed", "--"])
def test_a_cell_that_is_no_number_is_named_by_its_line(tmp_path, table, cell):
    path = write(tmp_path / "t.csv", table)
    lines = path.read_text().splitlines()
    fields = lines[10].split(";")
    lines[10] = ";".join([*fields[:2], cell, fields[3]])
    path.write_text("\n".join(lines))
    with pytest.raises(TableError, match=r"line 11.*\[cells\]"):
        read_foreign_table([path])
    imported = read_foreign_table([path], ImportOptions(accept=("cells",)))
    assert len(imported.valid_rows()) == len(table) - 1
    assert (imported.rows["status"] != "ok").sum() == 1
    write_sweep_table(imported, tmp_path / "out")
    assert len(read_sweep_table(tmp_path / "out").valid_rows()) == len(table) - 1


def test_a_line_with_a_field_too_many_is_not_shifted_into_other_columns(tmp_path, table):
    path = write(tmp_path / "t.csv", table)
    lines = path.read_text().splitlines()
    lines[5] = "0.1;" + lines[5]
    path.write_text("\n".join(lines))
    with pytest.raises(TableError, match=r"line 6"):
        read_foreign_table([path])


def test_an_optional_column_with_gaps_is_left_out_and_said(tmp_path, table):
    table.loc[3, "flux_linkage"] = np.nan
    imported = read_foreign_table([write(tmp_path / "t.csv", table)])
    assert "flux_linkage_Wb" not in imported.rows
    assert "line 5" in finding(imported, "gaps").text


def test_identical_rows_are_dropped_and_said(tmp_path, table):
    doubled = table.iloc[[*range(len(table)), 4, 9]]
    imported = read_foreign_table([write(tmp_path / "t.csv", doubled)])
    assert len(imported.rows) == len(table)
    assert finding(imported, "duplicates").size == 2


def test_contradictory_rows_are_an_error_that_names_them(tmp_path, table):
    doubled = table.iloc[[*range(len(table)), 4]].reset_index(drop=True)
    doubled.loc[len(table), "force"] *= 1.01
    path = write(tmp_path / "t.csv", doubled)
    with pytest.raises(TableError, match=rf"line 6, {len(table) + 2}"):
        read_foreign_table([path])
    rows = read_foreign_table([path], ImportOptions(accept=("contradictions",))).rows
    assert len(rows) == len(table)
    assert rows["force_N"][4] == pytest.approx(1.005 * table["force"][4])


def test_holes_are_named(tmp_path, table):
    imported = read_foreign_table([write(tmp_path / "t.csv", table.drop(index=[5, 20]))])
    assert finding(imported, "holes").size == 2
    assert "(0 A, 10 mm)" in finding(imported, "holes").text


def test_scattered_points_are_called_scattered(tmp_path, law):
    points = np.random.default_rng(1).uniform([0, 5e-3], [1, 2e-2], (30, 2))
    table = law.table()[:30].assign(current=points[:, 0], distance=points[:, 1])
    table = table.assign(force=law.force(table["distance"], table["current"]))
    imported = read_foreign_table([write(tmp_path / "t.csv", table)], ImportOptions(without=("flux_linkage",)))
    assert finding(imported, "scattered").severity == "warning"


def test_rows_in_disorder_are_sorted_and_said(tmp_path, table):
    imported = read_foreign_table([write(tmp_path / "t.csv", table.sample(frac=1, random_state=1))])
    np.testing.assert_allclose(imported.rows["force_N"], table["force"], rtol=1e-9)
    assert finding(imported, "order").severity == "info"


@pytest.mark.parametrize("keys", [["distance", "current"], ["current", "distance"]])
@pytest.mark.parametrize("rising", [True, False])
def test_loops_in_either_order_are_no_disorder(tmp_path, table, keys, rising):
    imported = read_foreign_table([write(tmp_path / "t.csv", table.sort_values(keys, ascending=rising))])
    assert all(finding.code != "order" for finding in imported.findings)


def test_currents_that_differ_by_rounding_are_one_level(tmp_path, table):
    table["current"] += np.random.default_rng(1).uniform(-1e-9, 1e-9, len(table))
    imported = read_foreign_table([write(tmp_path / "t.csv", table)])
    assert imported.rows["current_A"].nunique() == 4


@pytest.mark.parametrize(("axis", "code"), [("current", "one-current"), ("distance", "one-distance")])
def test_one_level_of_an_axis_is_an_error_unless_accepted(tmp_path, table, axis, code):
    path = write(tmp_path / "t.csv", table[table[axis] == table[axis].iloc[-1]])
    with pytest.raises(TableError, match=code):
        read_foreign_table([path])
    assert finding(read_foreign_table([path], ImportOptions(accept=(code,))), code).severity == "warning"


def test_distances_down_to_zero_are_an_error(tmp_path, table):
    with pytest.raises(TableError, match="must be > 0"):
        read_foreign_table([write(tmp_path / "t.csv", table.assign(distance=table["distance"] - 5e-3))])
    with pytest.raises(TableError, match="must be > 0"):  # no model is defined there: nothing to accept
        read_foreign_table([tmp_path / "t.csv"], ImportOptions(accept=("distance",)))


@pytest.mark.parametrize("distance", ["distance", "distance_m"])
def test_millimetres_read_as_metres_are_an_error(tmp_path, table, distance):
    header = f"current_A;{distance};force_N;flux_linkage_Wb"
    with pytest.raises(TableError, match="--unit distance_m=mm"):
        read_foreign_table([write(tmp_path / "t.csv", table, header)])


def test_metres_read_as_millimetres_are_an_error(tmp_path, table):
    with pytest.raises(TableError, match="micrometres"):
        read_foreign_table([write(tmp_path / "t.csv", table.assign(distance=table["distance"] / 1e3))])


def test_a_reversed_polarity_is_turned_with_its_flux(tmp_path, table):
    reversed_table = table.assign(current=-table["current"], flux_linkage=-table["flux_linkage"])
    path = write(tmp_path / "t.csv", reversed_table)
    rows = read_foreign_table([path], ImportOptions(flip_current=True)).rows
    np.testing.assert_allclose(rows["force_N"], table["force"], rtol=1e-9)
    np.testing.assert_allclose(rows["flux_linkage_Wb"], table["flux_linkage"], rtol=1e-9)


def test_a_missing_file_and_an_empty_directory_are_errors(tmp_path):
    with pytest.raises(TableError, match="does not exist"):
        read_foreign_table([tmp_path / "no.csv"])
    with pytest.raises(TableError, match="holds no table"):
        read_foreign_table([tmp_path])
    with pytest.raises(TableError, match="at least one"):
        read_foreign_table([])


def test_a_spreadsheet_and_a_binary_file_are_refused(tmp_path):
    (tmp_path / "t.csv").write_bytes(b"PK\x03\x04rest")
    with pytest.raises(TableError, match="spreadsheet"):
        read_foreign_table([tmp_path / "t.csv"])
    (tmp_path / "t.csv").write_bytes(b"a\x00\x00b\x00c\x01")
    with pytest.raises(TableError, match="no text table"):
        read_foreign_table([tmp_path / "t.csv"])
    (tmp_path / "t.parquet").write_bytes(b"PAR1 and nothing of it")
    with pytest.raises(TableError, match="Parquet"):
        read_foreign_table([tmp_path / "t.parquet"])
