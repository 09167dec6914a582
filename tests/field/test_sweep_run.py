"""The sweep as a run: table, journal, resumption, variants, workers that die; and what its summary says of errors."""

import dataclasses
import shutil
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest

from femfit.core.sweep_columns import COLUMNS
from femfit.device.load import actuator_from_tables, parse, read_actuator
from femfit.device.parts import NonlinearMaterial
from femfit.device.rewrite import variants_from_toml
from femfit.field import sweep_task
from femfit.field.sweep import run_sweep
from femfit.field.sweep_rows import summarise
from femfit.field.tolerance import SolverSettings
from femfit.tables.sweep_table import SweepTable, read_sweep_table
from support.actuators import GEOMETRY, rig_at, swept_at
from support.field import QUICK
from support.saturating import bobbin


@pytest.fixture(scope="module")
def few():
    return swept_at(read_actuator(GEOMETRY / "emaws-rig.toml"), (0.015, 0.02, 0.03, 0.045))


@pytest.fixture(scope="module")
def whole(few, tmp_path_factory):
    directory, states = tmp_path_factory.mktemp("whole"), []
    return directory, run_sweep(few, directory, workers=1, settings=QUICK, progress=states.append), states


@pytest.fixture
def solved(whole, tmp_path):
    shutil.copytree(whole[0], tmp_path, dirs_exist_ok=True)
    return tmp_path


def test_table_has_the_contracts_columns_one_row_a_point(few, whole):
    directory, table, states = whole
    assert list(table.rows.columns) == [name for name in COLUMNS if not name.startswith("newton_")]
    assert len(table.rows) == 4 * len(few.sweep.currents_A)
    assert not table.rows.duplicated(["current_A", "distance_m"]).any()
    again = read_sweep_table(directory)
    pd.testing.assert_frame_equal(again.rows, table.rows)
    assert again.manifest["actuator"]["mass_kg"] == few.mechanics.mass_kg
    assert again.manifest["versions"]["ngsolve"]
    csv = pd.read_csv(directory / "sweep.csv")
    np.testing.assert_array_equal(csv["force_N"], table.rows["force_N"])
    assert [(at.points_done, at.points) for at in states] == [(done, 32) for done in (0, 8, 16, 24, 32)]


def test_an_edited_drawing_is_solved_anew_in_the_same_directory_and_the_old_one_costs_nothing(
    few, whole, solved, monkeypatch
):
    states, back = [], []
    other = dataclasses.replace(few, coils=(dataclasses.replace(few.coil, turns=100),))
    edited = run_sweep(other, solved, workers=1, settings=QUICK, progress=states.append)
    assert not any(state.changed for state in whole[2])
    assert states[-1].changed == ("the drawing",)
    assert not edited.rows["force_N"].equals(whole[1].rows["force_N"])
    monkeypatch.setattr(sweep_task, "solve_task", lambda task: pytest.fail(f"{task.distance} solved again"))
    again = run_sweep(few, solved, workers=1, settings=QUICK, progress=back.append)
    assert back[0].points_done == back[0].points == len(again.rows)
    pd.testing.assert_frame_equal(whole[1].rows, again.rows, check_exact=True)


def test_a_script_without_a_main_guard_sweeps_in_processes_and_ends(tmp_path):
    script = tmp_path / "sweep.py"
    (tmp_path / "rig.toml").write_text(rig_at("[0, 1]", "[18, 20, 22]"), encoding="utf-8")
    script.write_text(
        "from femfit.device.load import read_actuator\n"
        "from femfit.field.sweep import run_sweep\n"
        "from femfit.field.tolerance import SolverSettings\n"
        "table = run_sweep(read_actuator('rig.toml'), 'out', workers=2, settings=SolverSettings(order=3))\n"
        "print(len(table.rows), (table.rows['status'] == 'ok').all())\n",
        encoding="utf-8",
    )
    result = subprocess.run(
        [sys.executable, str(script)], cwd=tmp_path, capture_output=True, text=True, check=False, timeout=300
    )
    assert (result.returncode, result.stderr) == (0, "")
    assert result.stdout.split() == ["6", "True"]


def test_points_beyond_the_end_of_a_curve_are_counted(tmp_path):
    short = NonlinearMaterial("short", (0.0, 0.5, 0.8), (0.0, 400.0, 2000.0))
    swept = run_sweep(bobbin(short, currents=(0.0, 8.0)), tmp_path, workers=1, settings=SolverSettings(order=3))
    assert swept.manifest["points_beyond_bh_curve"] == 1  # 8 A drive the sleeve far beyond 0.8 T, 0 A nowhere
    assert summarise(swept)["points_beyond_bh_curve"] == 1


def summary_of(currents, distances, forces, errors, tolerance=None):
    columns = {"current_A": currents, "distance_m": distances, "force_N": forces, "force_error_N": errors}
    rows = pd.DataFrame({name: np.broadcast_to(values, len(forces)) for name, values in columns.items()})
    return summarise(SweepTable(rows.assign(status="ok"), {"settings": {"tolerance": tolerance}}))


@pytest.mark.parametrize(
    ("currents", "distances", "forces", "errors", "largest"),
    [
        ([0.0, 1.0, 2.0], 0.01, [0.1, 1e-9, -0.2], [1e-5, 2e-5, 2e-5], 2e-4),  # over that of the weakest current
        ([0.0, 1.0, 2.0], 0.01, [0.0, 0.0, 0.0], [0.0, 0.0, 0.0], 0.0),
        ([0.0, 1.0, 2.0], 0.01, [0.0, 0.1, 0.4], [0.0, 1e-4, 2e-4], 1e-3),
        (1.0, [0.03, 0.01, 0.02], [-0.1, 0.2, 1e-9], [1e-5, 2e-5, 4e-5], 4e-4),  # over those on both sides of zero
        ([0.0, 0.0, 1.0, 1.0], [0.01, 0.02] * 2, [1e-9, 1e-9, 1.0, 0.5], [1e-8, 1e-8, 1e-4, 1e-4], 2e-4),  # by symmetry
    ],
)
def test_an_error_is_measured_by_a_force_that_there_is(currents, distances, forces, errors, largest):
    assert summary_of(currents, distances, forces, errors)["force_error_relative_max"] == pytest.approx(largest)


def test_rows_that_miss_the_tolerance_are_counted_at_each_distance_on_its_own():
    assert (
        summary_of(1.0, [0.03, 0.01, 0.02], [-0.1, 0.2, 1e-9], [1e-5, 2e-5, 4e-5], 1e-2)["rows_beyond_tolerance"] == 1
    )
    assert summary_of([0.0, 1.0, 2.0], 0.01, [0.1] * 3, [1e-5, 2e-5, 3e-5], 1.5e-4)["rows_beyond_tolerance"] == 2
    assert "rows_beyond_tolerance" not in summary_of([0.0, 1.0, 2.0], 0.01, [0.1] * 3, [1e-5, 2e-5, 3e-5])


VARIANTS = (GEOMETRY / "emaws-variants.toml").read_text(encoding="utf-8")
NAMES = ["coils.coil.turns", "magnet_temperature_C", "sleeve_radius_m"]


@pytest.fixture(scope="module")
def of_variants(tmp_path_factory):
    variants = variants_from_toml(VARIANTS.replace("stop = 45, step = 5", "stop = 25, step = 5"))
    return run_sweep(variants, tmp_path_factory.mktemp("whole"), workers=1, settings=QUICK)


def test_the_table_has_a_column_for_each_parameter_and_a_row_for_each_point(of_variants):
    names = [name for name in COLUMNS if not name.startswith("newton_")]
    assert list(of_variants.rows.columns) == [*names, "variant", *NAMES]
    assert len(of_variants.rows) == 3 * 3 * 3
    assert not of_variants.rows.duplicated(["current_A", "distance_m", "variant"]).any()
    assert of_variants.rows[["variant", *NAMES]].drop_duplicates().to_numpy().tolist() == [
        [1, 308, 20, 0.01],
        [2, 308, 80, 0.01],
        [3, 250, 20, 0.011],
    ]
    assert of_variants.manifest["parameters"] == NAMES


def test_each_variant_has_the_rows_that_its_own_file_gives(of_variants, tmp_path):
    for number, (turns, temperature, radius) in enumerate([(308, 20, 10), (308, 80, 10), (250, 20, 11)], 1):
        data = parse(VARIANTS.replace("stop = 45, step = 5", "stop = 25, step = 5"), "text")
        data["sweep"] = {key: data["sweep"][key] for key in ("current_A", "distance_mm")}
        data["coils"]["coil"] |= {"turns": turns, "r_mm": [radius, 20]}
        data["fixed"]["regions"]["sleeve"]["r_mm"] = [2.5, radius]
        data["moving"]["regions"]["magnet"]["temperature_C"] = temperature
        alone = run_sweep(actuator_from_tables(data, "text"), tmp_path / str(number), workers=1, settings=QUICK)
        own = (
            of_variants.rows[of_variants.rows["variant"] == number]
            .drop(columns=["variant", *NAMES])
            .reset_index(drop=True)
        )
        pd.testing.assert_frame_equal(own, alone.rows, check_exact=True)


MATERIALS = """[sweep.parameters]
"moving.regions.magnet.material" = ["n42", "n52"]
[sweep]
current_A = [0, 1]
distance_mm = [15, 20]
"""


def test_materials_are_columns_of_text_that_both_files_keep(tmp_path):
    swept = variants_from_toml(VARIANTS.split("[sweep]")[0] + MATERIALS)
    table = run_sweep(swept, tmp_path, workers=1, settings=QUICK)
    name = "moving.regions.magnet.material"
    assert table.rows[name].tolist() == ["n42"] * 4 + ["n52"] * 4
    assert [entry[name] for entry in table.manifest["variants"]] == ["n42", "n52"]
    force = table.rows[table.rows["current_A"] == 0.0].set_index([name, "distance_m"])["force_N"]
    # Quadratic in the remanence; the grades have one recoil permeability, so that the meshes' errors are alike too.
    np.testing.assert_allclose(force.loc["n42"] / force.loc["n52"], (1.312 / 1.464) ** 2, rtol=1e-9)
    for path in (tmp_path / "sweep.parquet", tmp_path / "sweep.csv"):
        pd.testing.assert_frame_equal(read_sweep_table(path).rows, table.rows, check_exact=True)
