"""One variant out of a table of several."""

import pandas as pd
import pytest

from femfit.core.errors import TableError
from femfit.tables.sweep_table import SweepTable
from femfit.tables.variant_choice import choose_variant

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


def test_a_table_without_parameters_passes_unchanged():
    plain = SweepTable(ROWS[["current_A", "distance_m", "force_N"]], {"name": "rig"})
    assert choose_variant(plain, {}) is plain


def test_a_table_that_lost_its_manifest_still_gives_its_rows():
    chosen = choose_variant(SweepTable(ROWS), {"variant": 4.0})
    assert chosen.rows["force_N"].tolist() == [0.7, 0.8]
    assert "actuator" not in chosen.manifest


MATERIALS = SweepTable(ROWS.assign(core=["steel_1010"] * 4 + ["ferrite"] * 4))


def test_a_material_is_chosen_by_its_name():
    chosen = choose_variant(MATERIALS, {"core": "ferrite", "sleeve_radius_m": 0.01})
    assert chosen.rows["force_N"].tolist() == [0.7, 0.8]
    assert chosen.manifest["variant"]["core"] == "ferrite"


@pytest.mark.parametrize(
    ("where", "message"),
    [
        ({"core": "steel"}, "No row has core = steel with what else was chosen; core is ferrite, steel_1010 there"),
        ({"core": 3.0}, "No row has core = 3 with"),
        ({"coil.turns": "many"}, "No row has coil.turns = many with"),
        ({"core": "ferrite"}, r"holds 2 variants \(variant is 3, 4; .*--where core=ferrite; repeat"),
    ],
)
def test_a_material_that_is_not_there_or_does_not_suffice_says_what_there_is(where, message):
    with pytest.raises(TableError, match=message):
        choose_variant(MATERIALS, where)


@pytest.mark.parametrize(
    ("where", "message"),
    [
        ({}, r"holds 4 variants \(variant is 1, 2, 3, 4; coil.turns is 250, 308.123; sleeve.*--where variant=1"),
        ({"coil.turns": 250.0}, r"holds 2 variants \(variant is 1, 2; sleeve_radius_m is 0.009, 0.01\)"),
        ({"turns": 250.0}, "'turns' is no parameter.*Did you mean 'coil.turns'"),
        ({"coil.turns": 251.0}, "No row has coil.turns = 251.*coil.turns is 250, 308.123 there"),
        ({"variant": 1.0, "coil.turns": 308.1235}, "No row has coil.turns = 308.123 with what else was chosen"),
    ],
)
def test_a_choice_that_leaves_several_or_none_says_what_there_is(where, message):
    with pytest.raises(TableError, match=message):
        choose_variant(TABLE, where)


def test_a_choice_in_a_table_without_parameters_is_refused():
    with pytest.raises(TableError, match="it has none: leave --where out"):
        choose_variant(SweepTable(ROWS[["current_A", "distance_m", "force_N"]]), {"variant": 1.0})
