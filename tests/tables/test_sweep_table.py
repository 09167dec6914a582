"""Reading and writing the sweep table: nothing silent, nothing lost."""

import json

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from femfit.core.errors import TableError
from femfit.tables.eddy_table import EddyTable, write_eddy
from femfit.tables.sweep_table import SweepTable, read_sweep_table, write_sweep_table

ROWS = pd.DataFrame(
    {
        "current_A": [0.0, 0.0, 1.0, 1.0],
        "distance_m": [0.01, 0.02, 0.01, 0.02],
        "force_N": [0.1, 1.0 / 3.0, 0.2, 0.06],
        "status": ["ok", "ok", "ok", "failed: no mesh"],
    }
)


def test_a_table_comes_back_bit_for_bit_with_its_manifest(tmp_path):
    write_sweep_table(SweepTable(ROWS, {"kind": "sweep", "name": "a"}), tmp_path)
    for path in (tmp_path, tmp_path / "sweep.parquet", tmp_path / "sweep.csv"):
        table = read_sweep_table(path)
        pd.testing.assert_frame_equal(table.rows, ROWS, check_exact=True)
        assert table.manifest == {"kind": "sweep", "name": "a"}


def test_valid_rows_are_those_that_were_solved(tmp_path):
    write_sweep_table(SweepTable(ROWS), tmp_path)
    assert len(read_sweep_table(tmp_path).valid_rows()) == 3


def test_a_failed_write_leaves_the_earlier_table(tmp_path, monkeypatch):
    write_sweep_table(SweepTable(ROWS), tmp_path)

    def full(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(pd.DataFrame, "to_parquet", full)
    with pytest.raises(OSError, match="No space left"):
        write_sweep_table(SweepTable(ROWS.iloc[:1]), tmp_path)
    pd.testing.assert_frame_equal(read_sweep_table(tmp_path).rows, ROWS)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda rows: rows.drop(columns="force_N"), "force_N missing.*femfit import"),
        (lambda rows: rows.iloc[:0], "no rows"),
        (lambda rows: rows.assign(status="failed: x"), "no row with status ok"),
        (lambda rows: rows.assign(force_N="many"), "force_N.*must be numeric"),
        (lambda rows: rows.assign(force_N=np.nan), "no finite number"),
        (lambda rows: rows.assign(force_N=[0.1, np.inf, 0.2, 0.3]), "no finite number"),
        (lambda rows: rows.assign(distance_m=-0.01), "must be > 0"),
    ],
)
def test_a_table_that_cannot_be_used_is_refused_with_the_remedy(change, message, tmp_path):
    change(ROWS).to_csv(tmp_path / "sweep.csv", index=False)
    with pytest.raises(TableError, match=message):
        read_sweep_table(tmp_path)


def test_a_damaged_manifest_is_named(tmp_path):
    write_sweep_table(SweepTable(ROWS), tmp_path)
    (tmp_path / "manifest.json").write_text("{")
    with pytest.raises(TableError, match="must be JSON"):
        read_sweep_table(tmp_path)


def test_a_directory_without_a_table_says_how_to_make_one(tmp_path):
    with pytest.raises(TableError, match="femfit sweep"):
        read_sweep_table(tmp_path)


@settings(max_examples=80, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(content=st.binary(max_size=300), suffix=st.sampled_from([".csv", ".parquet"]))
def test_random_bytes_give_a_table_error(tmp_path, content, suffix):
    path = tmp_path / f"sweep{suffix}"
    path.write_bytes(content)
    with pytest.raises(TableError):
        read_sweep_table(path)


@settings(max_examples=80, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_a_mutated_table_gives_finite_rows_or_a_table_error(tmp_path, data):
    text = bytearray(ROWS.to_csv(index=False).encode())
    for _ in range(data.draw(st.integers(1, 5))):
        text[data.draw(st.integers(0, len(text) - 1))] = data.draw(st.integers(0, 255))
    path = tmp_path / "sweep.csv"
    path.write_bytes(bytes(text))
    try:
        rows = read_sweep_table(path).valid_rows()
    except TableError:
        return
    numbers = rows[["current_A", "distance_m", "force_N"]].to_numpy(dtype=float)
    assert np.isfinite(numbers).all()


def test_the_manifest_is_readable_json(tmp_path):
    write_sweep_table(SweepTable(ROWS, {"kind": "import"}), tmp_path)
    assert json.loads((tmp_path / "manifest.json").read_text()) == {"kind": "import"}


def eddy_of(circuits, distances_m):
    """One pattern."""
    places, sources = len(distances_m), 2 + len(circuits)
    return EddyTable(
        circuits=circuits,
        distances_m=np.array(distances_m),
        frequencies_Hz=np.array([100.0]),
        force=np.zeros((places, sources, sources)),
        flux_linkage=np.ones((places, sources - 1, sources)),
        hall=None,
        checked_Hz=np.array([100.0]),
        errors=np.zeros((1, 3)),
        braking_error=0.0,
        materials=("iron",),
        conductivities_S_per_m=np.array([5e6]),
        resistances=np.ones((1, 1, 1)),
        asked_error=0.01,
    )


OF_ONE = SweepTable(ROWS, {"kind": "sweep", "actuator": {"circuits": [{"name": "coil"}]}})
OF_TWO = SweepTable(ROWS.rename(columns={"current_A": "current_a_A"}).assign(current_b_A=0.0), {"kind": "sweep"})
NO_MANIFEST = SweepTable(ROWS, {})


@pytest.mark.parametrize(
    ("table", "circuits", "distances", "words"),
    [
        (OF_ONE, ("coil",), [0.01, 0.015], "at its distances \\(10, 20 mm\\).*15 mm"),
        (OF_ONE, ("coil",), [0.03], "30 mm"),
        (OF_ONE, ("other",), [0.01, 0.02], "circuits \\(coil\\).*of other"),
        (OF_ONE, (), [0.01, 0.02], "circuits \\(coil\\).*of none"),
        (OF_TWO, ("coil",), [0.01, 0.02], "circuits \\(a, b\\).*of coil"),
        (OF_TWO, ("b", "a"), [0.01, 0.02], "circuits \\(a, b\\).*of b, a"),
        (NO_MANIFEST, ("a", "b"), [0.01, 0.02], "of a, b"),
    ],
)
def test_eddy_currents_of_another_sweep_are_refused(tmp_path, table, circuits, distances, words):
    write_sweep_table(table, tmp_path)
    write_eddy(eddy_of(circuits, distances), tmp_path)
    with pytest.raises(TableError, match=f"{words}.*Sweep the drawing again"):
        read_sweep_table(tmp_path)


@pytest.mark.parametrize(
    ("table", "circuits"), [(OF_ONE, ("coil",)), (OF_TWO, ("a", "b")), (NO_MANIFEST, ("coil",)), (NO_MANIFEST, ())]
)
@pytest.mark.parametrize("distances", [[0.01, 0.02], [0.01 * (1.0 + 1e-15)]])
def test_eddy_currents_at_some_of_a_sweeps_distances_are_its_own(tmp_path, table, circuits, distances):
    write_sweep_table(table, tmp_path)
    write_eddy(eddy_of(circuits, distances), tmp_path)
    assert read_sweep_table(tmp_path).eddy.circuits == circuits
