"""One table however it is written, and for whatever bytes a table of finite numbers or a TableError."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from femfit.core.errors import TableError
from femfit.tables.coil_record import open_coil_record
from femfit.tables.foreign import import_table
from femfit.tables.foreign_forms import SWEPT, ImportOptions
from femfit.tables.header import parse_header
from femfit.tables.measurement_file import read_measurement
from femfit.tables.raw_table import parse_number
from femfit.tables.sweep_table import read_sweep_table, write_sweep_table
from femfit.tables.units import CHANNELS, UNITS, column_unit, unit_factor
from support.reference import REFERENCE, needs_reference

QUICK = settings(max_examples=20, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
ACCEPT_ALL = ("cells", "contradictions", "one-current", "one-distance", "suspected-unit", "reciprocity")
VALID = "\n".join(
    ["current_A;distance_mm;force_N;flux_linkage_Wb"]
    + [f"{i:g};{d:g};{(0.1 + i) / d:.8g};{1e-5 * (i + 1) / d:.8g}" for i in (0, 0.5, 1) for d in range(5, 17)]
)
NAMES = {"current": "current_A", "distance": "distance_m", "force": "force_N", "flux_linkage": "flux_linkage_Wb"}


def headed(quantity, unit, style):
    return style.format({"flux_linkage": "flux"}.get(quantity, quantity), unit)


@QUICK
@given(data=st.data())
def test_a_table_is_the_same_in_any_notation_and_order(tmp_path, make_law, data):
    """Delimiter, decimal mark, encoding, units, style of the header, order of columns and of rows."""
    table = make_law().table(currents=(0.0, 0.4, 0.8), distances=np.linspace(5e-3, 25e-3, 6))
    decimal = data.draw(st.sampled_from([".", ","]))
    delimiter = data.draw(st.sampled_from([one for one in (",", ";", "\t", "|", "   ") if one != decimal]))
    styles = ["{}_{}", "{} [{}]", "{} ({})", "{} / {}"]
    style = data.draw(st.sampled_from(styles[:1] if delimiter == "   " else styles))
    columns, header = [], []
    for quantity in data.draw(st.permutations(list(NAMES))):
        unit = data.draw(st.sampled_from({"current": ["A", "mA"], "distance": ["mm", "m", "um"], "force": ["N", "mN"],
                                          "flux_linkage": ["Wb", "uWb", "mWb"]}[quantity]))  # fmt: skip
        columns.append(table[NAMES[quantity]] / unit_factor(unit, column_unit(NAMES[quantity])[1]))
        header.append(headed(quantity, unit, style))
    rows = np.column_stack(columns)[data.draw(st.permutations(range(len(table))))]
    text = "\n".join([delimiter.join(header), *(delimiter.join(f"{x:.10g}" for x in row).replace(".", decimal)
                                                 for row in rows), ""])  # fmt: skip
    encoding = data.draw(st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "cp1252"]))
    (tmp_path / "t.csv").write_bytes(text.encode(encoding))
    imported = import_table([tmp_path / "t.csv"])
    for name in NAMES.values():
        # ten digits are printed
        np.testing.assert_allclose(imported.rows[name], table[name], rtol=3e-9, atol=1e-15)
    assert (imported.rows["status"] == "ok").all()
    write_sweep_table(imported, tmp_path / "out")
    again = import_table([tmp_path / "out" / "sweep.csv"])
    pd.testing.assert_frame_equal(again.rows, imported.rows, rtol=1e-12)


def test_rounding_makes_no_new_level(tmp_path, make_law):
    rows = make_law().table(distances=np.linspace(5e-3, 20e-3, 8)).sample(frac=1, random_state=1)
    rows["current_A"] += np.random.default_rng(1).uniform(-1e-9, 1e-9, len(rows))
    rows.to_csv(tmp_path / "t.csv", index=False)
    assert import_table([tmp_path / "t.csv"]).rows["current_A"].nunique() == 4


def outcome(tmp_path, content, options):
    """Rows of an import, or None for a TableError; anything else fails the test."""
    path = tmp_path / "t.csv"
    path.write_bytes(content)
    try:
        imported = import_table([path], **vars(options))
    except TableError:
        return
    rows = imported.valid_rows()
    assert len(rows) > 0
    assert np.isfinite(rows.drop(columns="status").to_numpy(dtype=float)).all()


@QUICK
@given(content=st.binary(max_size=400))
@example(content=b"PAR1")
@example(content=b"MATLAB 5.0")
@example(content=b"\xff\xfe\x00")
@example(content=b"\xff\xfe1\x00;\x00")
def test_random_bytes_give_an_error_or_a_table(tmp_path, content):
    outcome(tmp_path, content, ImportOptions(accept=ACCEPT_ALL))
    for name in ("sweep.csv", "sweep.parquet"):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(TableError):
            read_sweep_table(tmp_path / name)


@QUICK
@given(
    rows=st.lists(st.tuples(*[st.floats(allow_nan=True, allow_infinity=True, width=64)] * 4), min_size=1, max_size=12)
)
@example(rows=[(0.0, 1.0, 0.0, np.nan), (0.0, 1.0, 0.0, np.nan)])
@example(rows=[(0.0, 1.0, 0.0, 8.98846567431158e307)] * 2)
def test_random_numbers_give_an_error_or_finite_rows(tmp_path, rows):
    text = VALID.splitlines()[0] + "\n" + "\n".join(";".join(f"{value!r}" for value in row) for row in rows)
    outcome(tmp_path, text.encode(), ImportOptions(accept=ACCEPT_ALL))


@QUICK
@given(data=st.data())
def test_a_mutated_table_gives_an_error_or_finite_rows(tmp_path, data):
    content = bytearray(VALID, "utf-8")
    for _ in range(data.draw(st.integers(1, 6))):
        place = data.draw(st.integers(0, len(content) - 1))
        action, byte = data.draw(st.sampled_from(["replace", "insert", "cut"])), data.draw(st.integers(0, 255))
        if action == "cut":
            del content[place : place + data.draw(st.sampled_from([1, 50]))]
        else:
            content[place : place + (action == "replace")] = bytes([byte])
        content = content or bytearray(b";")
    outcome(tmp_path, bytes(content), ImportOptions(accept=data.draw(st.sampled_from([(), ACCEPT_ALL]))))
    (tmp_path / "sweep.csv").write_bytes(bytes(content).replace(b";", b",").replace(b"_mm", b"_m"))
    try:
        rows = read_sweep_table(tmp_path / "sweep.csv").valid_rows()
    except TableError:
        return
    assert np.isfinite(rows[["current_A", "distance_m", "force_N"]].to_numpy(dtype=float)).all()


@given(text=st.text(max_size=40))
@settings(deadline=None)
def test_headers_and_numbers_of_any_text_are_parsed_without_exception(text):
    assert isinstance(parse_header(text).words, tuple)
    value = parse_number(text, ".")
    assert np.isnan(value) or np.isfinite(value)


@pytest.mark.parametrize("column", SWEPT)
def test_every_unit_of_a_quantity_is_recognised_in_a_header(column):
    name, si_unit = CHANNELS[column].names[-1], column_unit(column)[1]
    for unit, factor in UNITS[si_unit].items():
        for text in (f"{name} [{unit}]", f"{name}({unit})"):
            unit_in_header = parse_header(text).unit
            assert unit_in_header is not None
            assert unit_factor(unit_in_header, si_unit) == factor


@pytest.mark.parametrize("read", [read_measurement, import_table, open_coil_record, read_sweep_table])
def test_an_absurd_width_is_refused(tmp_path, read):
    commas = "," * 200_000
    (tmp_path / "t.csv").write_text(f"current_A,distance_m,force_N{commas}\n1,2,3{commas}\n")
    with pytest.raises(TableError, match=r"columns|characters"):
        read(tmp_path / "t.csv")


@needs_reference
@pytest.mark.parametrize("column", ["force_N", "force_core_reaction_N", "force_selfsub_N"])
def test_a_field_solvers_table_is_reciprocal_and_complete(column):
    options = ImportOptions(columns={column: "force", "Bz_axis_face_T": "hall"})
    imported = import_table([REFERENCE / "emaws_xfemm_488.csv"], **vars(options))
    (finding,) = [one for one in imported.findings if one.code == "reciprocity"]
    assert finding.severity == "info"
    assert finding.size < 2e-3
    rows = imported.rows
    assert (rows["current_A"].nunique(), rows["distance_m"].nunique(), len(rows)) == (8, 61, 488)
    at = rows[(rows["current_A"] == 0) & np.isclose(rows["distance_m"], 0.02)]
    assert at["hall_T"].iloc[0] == pytest.approx(8.6864e-3, rel=0.05)  # constant B in each first-order element
