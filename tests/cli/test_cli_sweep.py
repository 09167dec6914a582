"""``femfit sweep`` with parameters, the fit of one variant, and what ``femfit run`` refuses before it sweeps."""

import json

import numpy as np
import pytest

import femfit as ff
from femfit.field import current_path, sweep_task
from femfit.field.nonlinear_point import NonlinearActuator
from support.actuators import GEOMETRY
from support.command import femfit
from support.small_drawing import SLEEVED

TEXT = (GEOMETRY / "emaws-variants.toml").read_text(encoding="utf-8")
SMALL = TEXT.replace("{ start = 15, stop = 45, step = 5 }", "[15, 19, 24, 31, 45]")


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    directory = tmp_path_factory.mktemp("sweep")
    path = directory / "variants.toml"
    path.write_text(SMALL.replace("values = [10, 10, 11]", "values = [10, 21, 11]"), encoding="utf-8")
    return directory, femfit(
        "sweep", path, "-o", directory / "run", "--workers", 1, "--json", directory / "summary.json"
    )


def test_a_sweep_says_how_many_variants_there_are_and_what_failed(swept):
    directory, result = swept
    assert "45 points of 3 variants, 15 failed" in result.stdout
    assert "15 points failed: coils.coil.r_mm must ascend" in result.stdout
    assert json.loads((directory / "summary.json").read_text())["failed"] == 15


def test_a_variant_without_a_point_ends_the_sweep_as_an_error_that_numbers_it(swept):
    _, result = swept
    assert result.returncode == 1
    assert "1 variant of 3 (2)" in result.stderr


def test_a_fit_is_of_the_variant_that_is_chosen(swept, tmp_path):
    directory, _ = swept
    result = femfit("fit", directory / "run", "--where", "variant=3", "-o", tmp_path / "model.json")
    assert result.returncode == 0, result.stderr
    by_values = ("--where", "coils.coil.turns=250", "--where", "sleeve_radius_m=0.011")
    again = femfit("fit", directory / "run", *by_values, "-o", tmp_path / "again.json")
    assert again.returncode == 0, again.stderr
    models = [json.loads((tmp_path / name).read_text()) for name in ("model.json", "again.json")]
    assert models[0]["magnetics"] == models[1]["magnetics"]


@pytest.mark.parametrize(
    ("where", "message", "code"),
    [
        ((), "Choose one with --where variant=1", 1),
        (("--where", "variant=7"), "No row has variant = 7", 1),
        (("--where", "variant"), "--where must read COLUMN=VALUE", 2),
        (("--where", "variant=2"), "rows with status ok", 1),
    ],
)
def test_a_fit_of_no_variant_or_several_says_what_to_do(swept, where, message, code):
    result = femfit("fit", swept[0] / "run", *where)
    assert result.returncode == code
    assert message in result.stderr


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("current_A = [0, 0.7, 1.4]", "current_A = [0.7]", "needs at least 3 currents and 5 distances"),
        ("[15, 19, 24, 31, 45]", "[15, 19, 24]", "instead received 3 currents and 3 distances"),
        ("", "", "sweep.parameters make 3 variants, and a run is of one actuator"),
    ],
)
def test_a_run_refuses_what_it_could_not_fit_before_it_sweeps(old, new, message, tmp_path):
    text = SMALL.replace(old, new)
    if old:
        text = text[: text.index("\n[sweep.parameters]\n")].replace('design = "list"', "#")
    (tmp_path / "a.toml").write_text(text, encoding="utf-8")
    result = femfit("run", "a.toml", "-o", "run", cwd=tmp_path)
    assert result.returncode == 1
    assert message in result.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["a.toml"]


def test_a_scheduler_that_does_not_exist_is_refused_in_one_message(tmp_path):
    result = femfit("sweep", GEOMETRY / "emaws.toml", "-o", tmp_path / "run", "--scheduler", "nonsense://host:1")
    assert result.returncode == 1
    assert result.stderr.startswith("femfit: No scheduler answers at 'nonsense://host:1'")
    assert "Traceback" not in result.stderr


def test_an_error_far_below_a_thousandth_of_a_per_cent_is_not_printed_as_nothing():
    from femfit.cli.sweep import _force

    assert _force({"force_min_N": 0.0, "force_max_N": 1.0, "force_error_relative_max": 1.7e-6}).endswith("0.00017 %")


def test_a_table_needs_no_stop_and_a_model_ends_where_its_sweep_does(tmp_path):
    """Of two stops the sweep reaches one: the table is whole, a simulation towards the other ends with the model."""
    (tmp_path / "drawing.toml").write_text(SLEEVED.replace("mass_g = 2", "mass_g = 2\ntravel_mm = [1, 8]"))
    swept = femfit("sweep", "drawing.toml", "-o", "run", "--workers", 1, cwd=tmp_path)
    assert swept.returncode == 0, swept.stderr
    fitted = femfit("fit", "run", "-o", "model.json", cwd=tmp_path)
    assert "The near stop at 1.00 mm lies beyond the swept distances" in fitted.stdout
    assert "far stop" not in fitted.stdout
    model = ff.read_model(tmp_path / "model.json")
    assert (model.validity.distance_min_m, model.motion.ends) == (4e-3, (float("-inf"), 8e-3))
    pulled = ff.simulate(model, voltage_V=0.5)
    assert [name for name, _ in pulled.left_domain] == ["distance"]
    assert pulled.table["distance_m"].min() >= 4e-3
    assert "--" not in str(pulled)  # an option of the command is no advice for a library


STEEL = SLEEVED.replace('material = "iron"', 'material = "steel_1010"').replace("[0, 0.5, 1]", "[0, 1]")
STEEL = STEEL.replace("[materials.iron]\nrelative_permeability = 500\n", "").replace("[4, 5, 6, 8, 10]", "[4, 5, 6]")


@pytest.fixture
def steel(tmp_path):
    sweep_task.MESHES.clear()
    (tmp_path / "steel.toml").write_text(STEEL)
    yield tmp_path
    sweep_task.MESHES.clear()


def given_up(monkeypatch, where):
    """Newton's iteration given up after two corrections, by a mesh's number of elements and the distance in m."""
    solve, minimise, places = NonlinearActuator.solve, current_path.minimise, [0.0]

    def noted(actuator, distance, currents):
        places.append(distance)
        return solve(actuator, distance, currents)

    def limited(system, currents, start, **options):
        return minimise(system, currents, start, limit=2 if where(system.space.mesh.ne, places[-1]) else 60, **options)

    monkeypatch.setattr(NonlinearActuator, "solve", noted)
    monkeypatch.setattr(current_path, "minimise", limited)


def test_a_distance_that_fails_whole_is_named_and_the_curve_is_not_blamed(steel, monkeypatch):
    given_up(monkeypatch, lambda _, distance: distance == 5e-3)
    result = femfit("sweep", "steel.toml", "-o", "run", "--workers", 1, cwd=steel)
    (line,) = [line for line in result.stdout.splitlines() if "converge" in line]
    assert "2 points failed" in line
    assert "at 5 mm (all currents)" in line
    assert "mesh of this one" in line
    assert "B-H curve" not in line


def test_currents_that_fail_at_several_distances_are_named_and_the_curve_is_asked_for(steel, monkeypatch):
    given_up(monkeypatch, lambda _, distance: distance < 5.5e-3)
    result = femfit("sweep", "steel.toml", "-o", "run", "--workers", 1, cwd=steel)
    (line,) = [line for line in result.stdout.splitlines() if "converge" in line]
    assert "at 4 mm (all currents), 5 mm (all currents)" in line
    assert "B-H curve" in line


def test_a_distance_whose_mesh_fails_is_solved_on_a_finer_one(steel, monkeypatch):
    meshes = []

    def first(elements, _):
        meshes.append(elements)
        return elements == meshes[0]

    whole = ff.run_sweep(steel / "steel.toml", steel / "whole", workers=1).rows
    sweep_task.MESHES.clear()
    given_up(monkeypatch, first)
    result = femfit("sweep", "steel.toml", "-o", "run", "--workers", 1, cwd=steel)
    assert "0 failed" in result.stdout
    again = ff.read_sweep(steel / "run").rows
    assert max(meshes) > meshes[0]
    np.testing.assert_allclose(again["force_N"], whole["force_N"], rtol=2e-3)  # the meshes' own error is 5e-4
