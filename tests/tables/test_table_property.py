"""One table however it is written, and a header of whatever text."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from femfit.core.errors import TableError
from femfit.tables.coil_record import open_coil_record
from femfit.tables.foreign import import_table
from femfit.tables.foreign_forms import SWEPT
from femfit.tables.header import parse_header
from femfit.tables.measurement_file import read_measurement
from femfit.tables.raw_table import parse_number
from femfit.tables.sweep_table import read_sweep_table, write_sweep_table
from femfit.tables.units import CHANNELS, UNITS, column_unit, unit_factor
from support.force_law import Law
from support.reference import REFERENCE, needs_reference

QUICK = settings(max_examples=20, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
ACCEPT_ALL = ("cells", "contradictions", "one-current", "one-distance", "suspected-unit", "reciprocity")
WRITTEN_AS = {
    "current_A": ("current", ["A", "mA"]),
    "distance_m": ("distance", ["mm", "m", "um"]),
    "force_N": ("force", ["N", "mN"]),
    "flux_linkage_Wb": ("flux", ["Wb", "uWb", "mWb"]),
}


@QUICK
@given(data=st.data())
def test_a_table_is_the_same_in_any_notation_and_order(tmp_path, data):
    """Delimiter, decimal mark, encoding, units, style of the header, order of columns and of rows."""
    table = Law().table(currents=(0.0, 0.4, 0.8), distances=np.linspace(5e-3, 25e-3, 6))
    decimal = data.draw(st.sampled_from([".", ","]))
    delimiter = data.draw(st.sampled_from([one for one in (",", ";", "\t", "|", "   ") if one != decimal]))
    style = data.draw(st.sampled_from(["{}_{}", "{} [{}]", "{} ({})", "{} / {}"][: 1 if delimiter == "   " else 4]))
    columns = {}
    for name in data.draw(st.permutations(list(WRITTEN_AS))):
        quantity, units = WRITTEN_AS[name]
        unit = data.draw(st.sampled_from(units))
        columns[style.format(quantity, unit)] = table[name] / unit_factor(unit, column_unit(name)[1])
    rows = pd.DataFrame(columns).iloc[data.draw(st.permutations(range(len(table))))]
    encoding = data.draw(st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "cp1252"]))
    cells = [[f"{x:.10g}".replace(".", decimal) for x in row] for row in rows.to_numpy()]
    text = "\n".join([*map(delimiter.join, [columns, *cells]), ""])
    (tmp_path / "t.csv").write_bytes(text.encode(encoding))
    imported = import_table([tmp_path / "t.csv"])
    for name in WRITTEN_AS:
        np.testing.assert_allclose(imported.rows[name], table[name], rtol=3e-9, atol=1e-15)  # ten digits are printed
    assert (imported.rows["status"] == "ok").all()
    write_sweep_table(imported, tmp_path / "out")
    again = import_table([tmp_path / "out" / "sweep.csv"])
    pd.testing.assert_frame_equal(again.rows, imported.rows, rtol=1e-12)


def test_rounding_makes_no_new_level(tmp_path):
    rows = Law().table(distances=np.linspace(5e-3, 20e-3, 8)).sample(frac=1, random_state=1)
    rows["current_A"] += np.random.default_rng(1).uniform(-1e-9, 1e-9, len(rows))
    rows.to_csv(tmp_path / "t.csv", index=False)
    assert import_table([tmp_path / "t.csv"]).rows["current_A"].nunique() == 4


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
            assert unit_factor(parse_header(text).unit or "", si_unit) == factor


@pytest.mark.parametrize("read", [read_measurement, import_table, open_coil_record, read_sweep_table])
def test_an_absurd_width_is_refused(tmp_path, read):
    commas = "," * 200_000
    (tmp_path / "t.csv").write_text(f"current_A,distance_m,force_N{commas}\n1,2,3{commas}\n")
    with pytest.raises(TableError, match=r"columns|characters"):
        read(tmp_path / "t.csv")


@needs_reference
@pytest.mark.parametrize("column", ["force_N", "force_core_reaction_N", "force_selfsub_N"])
def test_a_field_solvers_table_is_reciprocal_and_complete(column):
    columns = {column: "force", "Bz_axis_face_T": "hall"}
    imported = import_table([REFERENCE / "emaws_xfemm_488.csv"], columns=columns)
    (finding,) = [one for one in imported.findings if one.code == "reciprocity"]
    assert finding.severity == "info"
    assert finding.size < 2e-3
    rows = imported.rows
    assert (rows["current_A"].nunique(), rows["distance_m"].nunique(), len(rows)) == (8, 61, 488)
    at = rows[(rows["current_A"] == 0) & np.isclose(rows["distance_m"], 0.02)]
    assert at["hall_T"].iloc[0] == pytest.approx(8.6864e-3, rel=0.05)  # constant B in each first-order element
