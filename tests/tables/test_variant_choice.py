"""One variant out of a table of several."""

import pandas as pd
import pytest

from femfit.core.errors import TableError
from femfit.tables.sweep_table import SweepTable
from femfit.tables.variant_choice import choose_variant
from support.expected import unmentioned

ROWS = pd.DataFrame(
    {
        "current_A": [0.0, 1.0] * 4,
        "distance_m": 0.01,
        "force_N": [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8],
        "status": "ok",
        "variant": [1, 1, 2, 2, 3, 3, 4, 4],
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
TABLE = SweepTable(ROWS, MANIFEST)


@pytest.mark.parametrize(
    "where",
    [{"variant": 3.0}, {"coil.turns": 308.1235, "sleeve_radius_m": 0.009}, {"variant": 3.0, "coil.turns": 308.1235}],
)
def test_a_variant_is_chosen_by_its_number_or_its_values(where):
    chosen = choose_variant(TABLE, where)
    assert chosen.rows["force_N"].tolist() == [0.5, 0.6]
    assert list(chosen.rows.columns) == ["current_A", "distance_m", "force_N", "status"]
    assert chosen.manifest["actuator"] == {"turns": 308}
    assert chosen.manifest["inputs"] == {"coil": {"turns": 308}}
    assert chosen.manifest["variant"] == {"variant": 3, "coil.turns": 308.123456789, "sleeve_radius_m": 0.009}
    assert "variants" not in chosen.manifest


def test_a_table_that_lost_its_manifest_still_gives_its_rows():
    chosen = choose_variant(SweepTable(ROWS), {"variant": 4.0})
    assert chosen.rows["force_N"].tolist() == [0.7, 0.8]
    assert "actuator" not in chosen.manifest


MATERIALS = SweepTable(ROWS.assign(core=["steel_1010"] * 4 + ["ferrite"] * 4))


def test_a_material_is_chosen_by_its_name():
    chosen = choose_variant(MATERIALS, {"core": "ferrite", "sleeve_radius_m": 0.01})
    assert chosen.rows["force_N"].tolist() == [0.7, 0.8]
    assert chosen.manifest["variant"]["core"] == "ferrite"


PLAIN = SweepTable(ROWS[["current_A", "distance_m", "force_N"]], {"name": "rig"})


@pytest.mark.parametrize(
    ("table", "where", "mentions"),
    [
        (MATERIALS, {"core": "steel"}, ["core = steel", "ferrite, steel_1010"]),
        (MATERIALS, {"core": 3.0}, ["core = 3"]),
        (MATERIALS, {"coil.turns": "many"}, ["coil.turns = many"]),
        (MATERIALS, {"core": "ferrite"}, ["2 variants", "3, 4", "--where core=ferrite"]),
        (TABLE, {}, ["4 variants", "1, 2, 3, 4", "250, 308.123", "sleeve_radius_m", "--where variant=1"]),
        (TABLE, {"coil.turns": 250.0}, ["2 variants", "1, 2", "0.009, 0.01"]),
        (TABLE, {"turns": 250.0}, ["'turns'", "'coil.turns'"]),
        (TABLE, {"coil.turns": 251.0}, ["coil.turns = 251", "250, 308.123"]),
        (TABLE, {"variant": 1.0, "coil.turns": 308.1235}, ["coil.turns = 308.123"]),
        (PLAIN, {"variant": 1.0}, ["--where"]),
    ],
)
def test_a_choice_that_leaves_several_or_none_says_what_there_is(table, where, mentions):
    with pytest.raises(TableError) as refused:
        choose_variant(table, where)
    assert not unmentioned(mentions, str(refused.value))


def test_a_table_without_parameters_passes_unchanged():
    assert choose_variant(PLAIN, {}) is PLAIN
