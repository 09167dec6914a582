"""Parameter sweeps as runs: columns, rows of each variant, failures, resumption, fit of one variant."""

import numpy as np
import pandas as pd
import pytest

from femfit.core.sweep_columns import COLUMNS
from femfit.device.load import actuator_from_tables, parse
from femfit.device.rewrite import variants_from_toml
from femfit.field.sweep import run_sweep
from femfit.tables.sweep_table import read_sweep_table
from support.actuators import GEOMETRY
from support.field import QUICK

TEXT = (GEOMETRY / "emaws-variants.toml").read_text(encoding="utf-8")
NAMES = ["coils.coil.turns", "magnet_temperature_C", "sleeve_radius_m"]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    variants = variants_from_toml(TEXT.replace("stop = 45, step = 5", "stop = 25, step = 5"))
    return run_sweep(variants, tmp_path_factory.mktemp("whole"), workers=1, settings=QUICK)


def test_the_table_has_a_column_for_each_parameter_and_a_row_for_each_point(whole):
    names = [name for name in COLUMNS if not name.startswith("newton_")]
    assert list(whole.rows.columns) == [*names, "variant", *NAMES]
    assert len(whole.rows) == 3 * 3 * 3
    assert not whole.rows.duplicated(["current_A", "distance_m", "variant"]).any()
    assert whole.rows[["variant", *NAMES]].drop_duplicates().to_numpy().tolist() == [
        [1, 308, 20, 0.01],
        [2, 308, 80, 0.01],
        [3, 250, 20, 0.011],
    ]
    assert whole.manifest["parameters"] == NAMES


def test_each_variant_has_the_rows_that_its_own_file_gives(whole, tmp_path):
    for number, (turns, temperature, radius) in enumerate([(308, 20, 10), (308, 80, 10), (250, 20, 11)], 1):
        data = parse(TEXT.replace("stop = 45, step = 5", "stop = 25, step = 5"), "text")
        data["sweep"] = {key: data["sweep"][key] for key in ("current_A", "distance_mm")}
        data["coils"]["coil"] |= {"turns": turns, "r_mm": [radius, 20]}
        data["fixed"]["regions"]["sleeve"]["r_mm"] = [2.5, radius]
        data["moving"]["regions"]["magnet"]["temperature_C"] = temperature
        alone = run_sweep(actuator_from_tables(data, "text"), tmp_path / str(number), workers=1, settings=QUICK)
        own = whole.rows[whole.rows["variant"] == number].drop(columns=["variant", *NAMES]).reset_index(drop=True)
        pd.testing.assert_frame_equal(own, alone.rows, check_exact=True)


MATERIALS = """[sweep.parameters]
"moving.regions.magnet.material" = ["n42", "n52"]
[sweep]
current_A = [0, 1]
distance_mm = [15, 20]
"""


def test_materials_are_columns_of_text_that_both_files_keep(tmp_path):
    swept = variants_from_toml(TEXT.split("[sweep]")[0] + MATERIALS)
    table = run_sweep(swept, tmp_path, workers=1, settings=QUICK)
    name = "moving.regions.magnet.material"
    assert table.rows[name].tolist() == ["n42"] * 4 + ["n52"] * 4
    assert [entry[name] for entry in table.manifest["variants"]] == ["n42", "n52"]
    force = table.rows[table.rows["current_A"] == 0.0].set_index([name, "distance_m"])["force_N"]
    # Quadratic in the remanence; the grades have one recoil permeability, so that the meshes' errors are alike too.
    np.testing.assert_allclose(force.loc["n42"] / force.loc["n52"], (1.312 / 1.464) ** 2, rtol=1e-9)
    for path in (tmp_path / "sweep.parquet", tmp_path / "sweep.csv"):
        pd.testing.assert_frame_equal(read_sweep_table(path).rows, table.rows, check_exact=True)
