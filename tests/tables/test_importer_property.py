"""Whatever the bytes, the reader gives a table of finite numbers or a TableError."""

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from femfit.core.errors import TableError
from femfit.tables.column_names import COLUMN_NAMES
from femfit.tables.foreign.options import QUANTITIES, ImportOptions, si_unit
from femfit.tables.foreign.read import read_foreign_table
from femfit.tables.header import parse_header
from femfit.tables.number_text import parse_number
from femfit.tables.units import UNITS, unit_factor

QUICK = settings(max_examples=80, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
ACCEPT_ALL = ("cells", "contradictions", "one-current", "one-distance", "units", "reciprocity")

VALID = "\n".join(
    ["current_A;distance_mm;force_N;flux_linkage_Wb"]
    + [f"{i:g};{d:g};{(0.1 + i) / d:.8g};{1e-5 * (i + 1) / d:.8g}" for i in (0, 0.5, 1) for d in range(5, 17)]
)


def outcome(tmp_path, content, options):
    """Rows of an import, or None for a TableError; anything else fails the test."""
    path = tmp_path / "t.csv"
    path.write_bytes(content)
    try:
        imported = read_foreign_table([path], options)
    except TableError:
        return None
    rows = imported.valid_rows()
    assert len(rows) > 0
    numbers = rows.drop(columns="status").to_numpy(dtype=float)
    assert np.isfinite(numbers).all()
    return rows


@QUICK
@given(content=st.binary(max_size=400))
@example(content=b"PAR1")
@example(content=b"MATLAB 5.0")
@example(content=b"\xff\xfe\x00")
@example(content=b"\xff\xfe1\x00;\x00")
def test_random_bytes_give_an_error_or_a_table(tmp_path, content):
    outcome(tmp_path, content, ImportOptions(accept=ACCEPT_ALL))


@QUICK
@given(text=st.text(alphabet="0123456789.,;-+eE \t\n#%|\"'()[]ANmdisx/\\", max_size=300))
@example(text="0;1;2\n0;1;2")
@example(text='"1";"\n2;3')
def test_random_table_like_text_gives_an_error_or_a_table(tmp_path, text):
    for options in (ImportOptions(accept=ACCEPT_ALL), ImportOptions(form="matrix", accept=ACCEPT_ALL)):
        outcome(tmp_path, text.encode(), options)


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
        action = data.draw(st.sampled_from(["replace", "insert", "delete", "cut"]))
        byte = data.draw(st.integers(0, 255))
        if action == "replace":
            content[place] = byte
        elif action == "insert":
            content.insert(place, byte)
        elif action == "delete":
            del content[place]
        elif len(content) > place + 50:
            del content[place : place + 50]
    outcome(tmp_path, bytes(content), ImportOptions(accept=data.draw(st.sampled_from([(), ACCEPT_ALL]))))


@QUICK
@given(
    force=st.lists(st.floats(1e-6, 1e3), min_size=4, max_size=4),
    delimiter=st.sampled_from([";", "\t", "|", " "]),
    decimal=st.sampled_from([".", ","]),
    digits=st.integers(4, 17),
)
def test_numbers_survive_every_notation(tmp_path, force, delimiter, decimal, digits):
    grid = [(i, d) for i in ("0.25", "1.5") for d in ("0.0125", "0.02")]
    lines = [delimiter.join([i, d, f"{f:.{digits}g}"]) for (i, d), f in zip(grid, force, strict=True)]
    text = f"I_A{delimiter}d_m{delimiter}F_N\n" + "\n".join(lines).replace(".", decimal)
    rows = outcome(tmp_path, text.encode(), ImportOptions(force_sign="keep"))
    assert rows is not None
    np.testing.assert_allclose(rows["force_N"], [float(f"{f:.{digits}g}") for f in force], rtol=1e-15)


@given(text=st.text(max_size=40))
@settings(deadline=None)
def test_headers_and_numbers_of_any_text_are_parsed_without_exception(text):
    header = parse_header(text)
    assert isinstance(header.words, tuple)
    value = parse_number(text, ".")
    assert np.isnan(value) or np.isfinite(value)


@given(value=st.floats(-1e99, 1e99))
def test_a_printed_float_is_read_back(value):
    assert parse_number(repr(value), ".") == value
    assert parse_number(repr(value).replace(".", ","), ",") == value


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_every_unit_of_a_quantity_is_recognised_in_a_header(quantity):
    name = COLUMN_NAMES[QUANTITIES[quantity]][-1]
    for unit, factor in UNITS[si_unit(quantity)].items():
        for text in (f"{name} [{unit}]", f"{name}({unit})"):
            found = parse_header(text).unit
            assert found is not None
            assert unit_factor(found, si_unit(quantity)) == factor


def test_mega_is_not_read_as_milli():
    assert unit_factor("MN", "N") is None
    assert unit_factor("mN", "N") == 1e-3
    assert unit_factor("MM", "m") is None
    assert unit_factor("MA", "A") is None
