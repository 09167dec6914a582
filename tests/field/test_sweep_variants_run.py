"""Parameter sweeps as runs: columns, rows of each variant, failures, resumption, fit of one variant."""

import json
import shutil

import numpy as np
import pandas as pd
import pytest

from femfit.core.errors import FieldSolverError
from femfit.core.sweep_columns import COLUMNS
from femfit.device.load import actuator_from_tables, actuator_from_toml, parse
from femfit.device.rewrite import variants_from_toml
from femfit.field import sweep as sweep_module
from femfit.field.sweep import run_sweep
from femfit.field.sweep_rows import summarise
from femfit.field.tolerance import SolverSettings
from femfit.tables.sweep_table import read_sweep_table
from support.actuators import GEOMETRY
from support.saturating import STEEL

QUICK = SolverSettings(order=3)
TEXT = (GEOMETRY / "emaws-variants.toml").read_text(encoding="utf-8")
NAMES = ["coils.coil.turns", "magnet_temperature_C", "sleeve_radius_m"]


@pytest.fixture(scope="module")
def variants():
    return variants_from_toml(TEXT.replace("stop = 45, step = 5", "stop = 25, step = 5"))


@pytest.fixture(scope="module")
def directory(tmp_path_factory):
    return tmp_path_factory.mktemp("whole")


@pytest.fixture(scope="module")
def whole(variants, directory):
    return run_sweep(variants, directory, workers=1, settings=QUICK)


def test_the_table_has_a_column_for_each_parameter_and_a_row_for_each_point(whole, variants):
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


def test_a_warm_magnet_pulls_with_the_square_of_its_remanence(whole):
    rows = whole.rows[whole.rows["current_A"] == 0.0].set_index(["variant", "distance_m"])["force_N"]
    # Without current the force is quadratic in the remanence, which falls by 0.12 % a kelvin; solved to rounding.
    np.testing.assert_allclose(rows.loc[2] / rows.loc[1], (1.0 - 1.2e-3 * 60.0) ** 2, rtol=1e-9)


def test_a_variant_that_cannot_be_built_is_rows_with_its_reason_and_the_others_go_on(variants, whole, tmp_path):
    broken = variants_from_toml(
        TEXT.replace("stop = 45, step = 5", "stop = 25, step = 5").replace("[10, 10, 11]", "[10, 21, 11]")
    )
    table = run_sweep(broken, tmp_path, workers=1, settings=QUICK)
    status = table.rows.groupby("variant")["status"].unique()
    assert [list(status[n]) for n in (1, 3)] == [["ok"], ["ok"]]
    assert status[2][0].startswith("failed: coil")
    assert summarise(table)["failed"] == 9
    good = table.rows[table.rows["variant"] != 2].reset_index(drop=True)
    expected = whole.rows[whole.rows["variant"] != 2].reset_index(drop=True)
    pd.testing.assert_frame_equal(good, expected, check_exact=True)
    assert json.loads((tmp_path / "manifest.json").read_text())["variants"][1]["actuator"] is None


def test_a_variant_whose_meshes_cannot_be_planned_is_rows_with_its_reason(
    variants, whole, directory, tmp_path, monkeypatch
):
    shutil.copytree(directory, tmp_path, dirs_exist_ok=True)
    plan = sweep_module.plan_sweep

    def refuse_the_second(actuator, settings, variant):
        if variant == 2:
            raise FieldSolverError("refused")
        return plan(actuator, settings, variant)

    monkeypatch.setattr(sweep_module, "plan_sweep", refuse_the_second)
    assert len(whole.rows) == 27
    assert summarise(run_sweep(variants, tmp_path, workers=1, settings=QUICK))["failures"] == {"failed: refused": 9}


def test_other_values_of_a_parameter_are_another_configuration(whole, directory, tmp_path):
    shutil.copytree(directory, tmp_path, dirs_exist_ok=True)
    other = variants_from_toml(
        TEXT.replace("stop = 45, step = 5", "stop = 25, step = 5").replace("20, 80, 20", "20, 81, 20")
    )
    states = []

    def stop(state):
        states.append(state)
        raise InterruptedError

    with pytest.raises(InterruptedError):
        run_sweep(other, tmp_path, workers=1, settings=QUICK, progress=stop)
    assert states[0].changed == ("the drawing",)
    assert states[0].points_done == 0


def test_a_table_of_variants_comes_back_from_both_files(whole, directory):
    for path in (directory / "sweep.parquet", directory / "sweep.csv"):
        again = read_sweep_table(path)
        pd.testing.assert_frame_equal(again.rows, whole.rows, check_exact=True)
        assert [entry["actuator"]["turns"] for entry in again.manifest["variants"]] == [308, 308, 250]


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


def test_points_drawn_over_current_distance_and_turns_are_one_row_a_sample(tmp_path):
    head, tail = TEXT.split("[sweep]")[0], "current_A = { min = 0, max = 1.4 }\ndistance_mm = { min = 15, max = 45 }\n"
    text = f'{head}[sweep]\ndesign = "latin_hypercube"\nsamples = 4\n[sweep.parameters]\n{tail}'
    drawn = variants_from_toml(text)
    table = run_sweep(drawn, tmp_path, workers=1, settings=QUICK)
    assert len(table.rows) == 4
    assert "variant" not in table.rows  # one actuator, at points that are no grid: a fit takes it as it is
    assert (table.rows["status"] == "ok").all()
    alone = actuator_from_toml(text)
    grid = run_sweep(alone, tmp_path / "grid", workers=1, settings=QUICK).rows.set_index(["current_A", "distance_m"])
    for row in table.rows.itertuples():
        # The same point in another mesh: equal within the meshes' errors, of which the row has an estimate.
        both = row.force_error_N + grid.loc[row.current_A, row.distance_m]["force_error_N"]
        assert abs(row.force_N - grid.loc[row.current_A, row.distance_m]["force_N"]) < both


@pytest.mark.nightly
def test_a_saturating_core_can_be_swept_too(tmp_path):
    text = TEXT.replace('material = "ferrite"', 'material = "steel_1010"').replace(
        "stop = 45, step = 5", "stop = 20, step = 5"
    )
    swept = variants_from_toml(text)
    assert swept.actuator.fixed[0].material == STEEL
    rows = run_sweep(swept, tmp_path, workers=1, settings=QUICK).rows
    assert (rows["status"] == "ok").all()
    assert rows.groupby("variant")["newton_iterations"].max().gt(1).all()
