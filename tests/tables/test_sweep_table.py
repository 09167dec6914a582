"""The sweep table, read and written with nothing silent and nothing lost, and one variant out of several."""

import json
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from femfit.core.errors import TableError
from femfit.tables.sweep_table import SweepTable, choose_variant, read_sweep_table, write_sweep_table
from support.expected import unmentioned

SWEEPS = Path(__file__).parents[1] / "golden/inputs/sweeps"


def test_a_table_comes_back_bit_for_bit_with_its_manifest(tmp_path):
    grid = {"current_A": [0.0, 0.0, 1.0, 1.0], "distance_m": [0.01, 0.02, 0.01, 0.02]}
    rows = pd.DataFrame(grid | {"force_N": [0.1, 1.0 / 3.0, 0.2, 0.06], "status": [*3 * ["ok"], "failed: no mesh"]})
    write_sweep_table(SweepTable(rows, {"kind": "sweep", "name": "a"}), tmp_path)
    for path in (tmp_path, tmp_path / "sweep.parquet", tmp_path / "sweep.csv"):
        table = read_sweep_table(path)
        pd.testing.assert_frame_equal(table.rows, rows, check_exact=True)
        assert table.manifest == {"kind": "sweep", "name": "a"}
    assert json.loads((tmp_path / "manifest.json").read_text()) == {"kind": "sweep", "name": "a"}


VARIED = pd.DataFrame(
    {
        "current_A": [0.0, 1.0] * 4,
        "distance_m": 0.01,
        "force_N": 0.1 * np.arange(1, 9),
        "status": "ok",
        "variant": np.repeat([1, 2, 3, 4], 2),
        "coil.turns": [250.0] * 4 + [308.123456789] * 4,
        "sleeve_radius_m": [0.009, 0.009, 0.01, 0.01] * 2,
    }
)
MANIFEST = {
    "name": "rig",
    "actuator": {"turns": 300},
    "inputs": {"coil": {"turns": 300}},
    "parameters": ["coil.turns", "sleeve_radius_m"],
    "variants": [
        {"variant": n, "actuator": {"turns": turns}, "inputs": {"coil": {"turns": turns}}}
        for n, turns in ((1, 250), (2, 250), (3, 308), (4, 308))
    ],
}
TABLE = SweepTable(VARIED, MANIFEST)
MATERIALS = SweepTable(VARIED.assign(core=["steel_1010"] * 4 + ["ferrite"] * 4))
PLAIN = SweepTable(VARIED[["current_A", "distance_m", "force_N"]], {"name": "rig"})


@pytest.mark.parametrize(
    "where",
    [{"variant": 3.0}, {"coil.turns": 308.1235, "sleeve_radius_m": 0.009}, {"variant": 3.0, "coil.turns": 308.1235}],
)
def test_a_variant_is_chosen_by_its_number_or_its_values(where):
    chosen = choose_variant(TABLE, where)
    assert chosen.rows["force_N"].tolist() == pytest.approx([0.5, 0.6])
    assert list(chosen.rows.columns) == ["current_A", "distance_m", "force_N", "status"]
    assert chosen.manifest["actuator"] == {"turns": 308}
    assert chosen.manifest["inputs"] == {"coil": {"turns": 308}}
    assert chosen.manifest["variant"] == {"variant": 3, "coil.turns": 308.123456789, "sleeve_radius_m": 0.009}
    assert "variants" not in chosen.manifest


def test_a_variant_of_a_material_or_without_its_manifest_is_chosen():
    chosen = choose_variant(SweepTable(VARIED), {"variant": 4.0})
    assert chosen.rows["force_N"].tolist() == pytest.approx([0.7, 0.8])
    assert "actuator" not in chosen.manifest
    chosen = choose_variant(MATERIALS, {"core": "ferrite", "sleeve_radius_m": 0.01})
    assert chosen.rows["force_N"].tolist() == pytest.approx([0.7, 0.8])
    assert chosen.manifest["variant"]["core"] == "ferrite"
    assert choose_variant(PLAIN, {}) is PLAIN


@pytest.mark.parametrize(
    ("table", "where", "mentions"),
    [
        (MATERIALS, {"core": "steel"}, ["core = steel", "ferrite, steel_1010"]),
        (MATERIALS, {"coil.turns": "many"}, ["coil.turns = many"]),
        (TABLE, {}, ["4 variants", "1, 2, 3, 4", "250, 308.123", "sleeve_radius_m", "--where variant=1"]),
        (TABLE, {"turns": 250.0}, ["'turns'", "coil.turns"]),
        (TABLE, {"variant": 1.0, "coil.turns": 308.1235}, ["coil.turns = 308.123"]),
        (PLAIN, {"variant": 1.0}, ["--where"]),
    ],
)
def test_a_choice_that_leaves_several_or_none_says_what_there_is(table, where, mentions):
    with pytest.raises(TableError) as refused:
        choose_variant(table, where)
    assert not unmentioned(mentions, str(refused.value))


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("manifest.json", '"fixed": [', '"fixed": [7, '),
        ("signatures.json", '"key": "fixed.regions.upper_flange.r_mm[1]"', '"key": "fixed.regions.upper.r_mm"'),
        ("signatures.json", '"tolerance": ', '"tolerance": 1e999, "was": '),
        ("manifest.json", '"kind": ', '"note": Infinity, "kind": '),
    ],
)
def test_a_file_beside_a_sweep_that_no_longer_fits_it_is_refused(tmp_path, name, old, new):
    shutil.copytree(SWEEPS / "rig", tmp_path / "run")
    text = (tmp_path / "run" / name).read_text()
    assert old in text
    (tmp_path / "run" / name).write_text(text.replace(old, new, 1))
    with pytest.raises(TableError, match=rf"{name.partition('.')[0]}.*(damaged|no number)"):
        read_sweep_table(tmp_path / "run")


@pytest.mark.parametrize(
    "change", [lambda force: force[:, 1:], lambda force: np.where(force == force.max(), np.nan, force)]
)
def test_eddy_currents_whose_arrays_do_not_fit_together_or_are_not_finite_are_refused(tmp_path, change):
    shutil.copytree(SWEEPS / "pot", tmp_path / "run")
    with np.load(tmp_path / "run/eddy.npz") as held:
        np.savez(tmp_path / "run/eddy.npz", **dict(held) | {"force": change(held["force"])})
    with pytest.raises(TableError, match=r"eddy.npz.*damaged"):
        read_sweep_table(tmp_path / "run")
