"""From a drawing or a table of another program: new, sweep, run, view, calibrate, import, import-fem."""

import json
import tomllib
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import get_args

import numpy as np
import pandas as pd
import pytest

import femfit as ff
from femfit.cli.new import Kind
from femfit.cli.run import _close_loop
from femfit.device.electrics import CurrentSensor, PositionSensor
from femfit.device.load import actuator_from_toml, read_actuator
from femfit.field import newton as current_path
from femfit.field import sweep_task
from femfit.field.newton import along_currents
from femfit.field.nonlinear_point import NonlinearActuator
from femfit.field.sweep import run_sweep
from femfit.tables.sweep_table import read_sweep_table
from support.actuators import GEOMETRY
from support.cli_case import DRAWN
from support.command import femfit, worked
from support.fem_files import suspension
from support.page import Page
from support.small_drawing import SLEEVED, SMALL


def test_every_drawing_can_be_asked_for():
    names = [path.stem for path in (files("femfit.device") / "examples").iterdir()]
    assert list(get_args(Kind)) == sorted(names)


@pytest.mark.parametrize("kind", get_args(Kind))
def test_a_drawing_is_read_under_the_name_of_its_file(kind, tmp_path):
    worked("new", kind, "-o", tmp_path / "mine.toml")
    assert read_actuator(tmp_path / "mine.toml").name == "mine"
    tables = tomllib.loads((tmp_path / "mine.toml").read_text(encoding="utf-8"))
    assert tables["schema"] == 2
    assert not {"electromagnet", "coil", "hall"} & set(tables)  # the tables of schema 1
    assert "mass_g" not in tables.get("moving", {})


def test_an_editor_gets_a_schema_that_every_drawing_meets_and_a_wrong_key_does_not(tmp_path):
    jsonschema = pytest.importorskip("jsonschema", reason="checks JSON Schema")
    worked("new", "--schema", "-o", tmp_path / "actuator.json")
    validator = jsonschema.Draft202012Validator(json.loads((tmp_path / "actuator.json").read_text(encoding="utf-8")))
    drawings = [*GEOMETRY.glob("*.toml"), *(GEOMETRY.parent / "docs" / "reference").glob("*.toml")]
    tables = {path.stem: tomllib.loads(path.read_text(encoding="utf-8")) for path in drawings}
    assert not [(name, one.message) for name, drawn in tables.items() for one in validator.iter_errors(drawn)]
    wrong = tables["every-key"] | {"mechanics": {"mass_g": -1, "gravty": "off"}}
    assert len(list(validator.iter_errors(wrong))) == 2
    assert "Give a kind of actuator" in femfit("new").stderr


FEWER = {
    "magnet-pair": {"[0.1, 0.5, 1, 2, 5, 10, 15, 20, 30, 40]": "[1, 2, 5, 10, 15, 20, 40]"},
    "bearing": {"step = 0.05": "step = 0.12", "sample_time_ms = 0.1": "sample_time_ms = 0.8"},
}


@pytest.mark.nightly
@pytest.mark.parametrize("kind", FEWER)
def test_a_drawing_runs_to_its_report_and_pictures(kind, tmp_path):
    path = tmp_path / "mine.toml"
    worked("new", kind, "-o", path)
    text = path.read_text()
    for old, new in FEWER[kind].items():
        assert text.count(old) == 1
        text = text.replace(old, new)
    path.write_text(text + "\n[solver]\ntolerance = 0.1\n")
    worked("run", path, "-o", tmp_path / "run", "--workers", 1)
    page = Page((tmp_path / "run" / "report.html").read_text(encoding="utf-8"))
    assert ("circuits" in page.ids) == (kind == "bearing")
    currents = ("--current-A", 1, "--current-A", -1) if kind == "bearing" else ()
    worked("view", path, "--what", "flux-density", "-o", tmp_path / "field.png", *currents)


RIG = (GEOMETRY / "emaws-rig.toml").read_text()
GRID = """[sweep]
current_A = [0, 0.4, 0.9, 1.4]
distance_mm = [15, 16.5, 18, 20, 23, 27, 32, 38, 45]
[reference]
distance_mm = [24, 26]
"""


@pytest.mark.nightly
def test_run_does_the_whole_main_job(tmp_path):
    """The rig on a grid of 4 x 9 points, with small steps of the reference and long samples, enough for all."""
    target, begin = tmp_path / "run", RIG.index("[sweep]")
    text = RIG[:begin] + GRID + "".join(f"{line}\n" for line in RIG[begin:].splitlines() if "sample_time" in line)
    (tmp_path / "small.toml").write_text(text.replace("sample_time_ms = 0.5", "sample_time_ms = 1.0"))
    worked("run", tmp_path / "small.toml", "-o", target, "--workers", 1, "--json", tmp_path / "result.json")
    for name in ("sweep.parquet", "sweep.csv", "manifest.json", "model.json", "model_law.json", "report.html"):
        assert (target / name).stat().st_size > 0
    assert (target / "estimator" / "estimator.py").is_file()
    assert (target / "report.html").stat().st_size < 3e6
    data = json.loads((tmp_path / "result.json").read_text())
    assert data["closed_loop"] is not None
    assert data["sweep"]["failed"] == 0


@pytest.mark.nightly
def test_run_of_an_actuator_that_cannot_levitate_says_so(tmp_path):
    result = worked("run", GEOMETRY / "plunger-solenoid.toml", "-o", tmp_path / "run")
    assert "none: Model 'plunger-solenoid' must have a sensor" in result.stdout
    assert "reluctance-network is taken" in result.stdout  # no sum of columns reaches the target for a plunger
    assert (tmp_path / "run" / "report.html").is_file()
    assert not (tmp_path / "run" / "estimator").exists()


def test_no_loop_is_closed_where_no_sensor_reads_the_distance(monkeypatch, levitation_model):
    shunt = CurrentSensor(name="shunt", circuit="coil", noise=0.004)
    laser = PositionSensor(name="laser", noise=4e-5, distances_m=(0.0, 1.0), readings=(0.0, 1.0), unit="m")
    blind = replace(levitation_model, sensor=None, other_sensors=(shunt,))
    calls = []
    monkeypatch.setattr("femfit.simulation.study.closed_loop_study", lambda model, seed: calls.append(model))
    _, why = _close_loop(blind, 1, Path("runs/valve/model.json"))
    assert not calls
    assert "femfit simulate runs/valve/model.json" in why
    for seeing in (levitation_model, replace(blind, other_sensors=(shunt, laser))):
        assert _close_loop(seeing, 1, Path("model.json"))[1] == ""
    assert len(calls) == 2


def test_only_what_changed_is_said_to_have_changed(tmp_path):
    small = SLEEVED.replace("[4, 5, 6, 8, 10]", "[4, 6]").replace("[0, 0.5, 1]", "[0, 1]")
    tolerant, slopes = f"{small}[tolerances]\nlength_mm = 0.1\n", None
    for text, more, changed in (
        (small, (), ""),
        (small, ("--signatures",), "the signatures asked for;"),
        (tolerant, (), ""),
        (tolerant.replace("mass_g = 2", "mass_g = 3"), (), "the drawing"),
        (tolerant, (), ""),  # whose results were kept
    ):
        (tmp_path / "sleeved.toml").write_text(text)
        said = worked("sweep", "sleeved.toml", "-o", "run", "--workers", 1, *more, cwd=tmp_path).stderr
        assert ("anew" in said) == bool(changed)
        assert changed in said
        if slopes and not changed:
            assert (tmp_path / "run/signatures.parquet").read_bytes() == slopes
        slopes = (tmp_path / "run/signatures.parquet").read_bytes() if more else slopes


VARIANTS = (GEOMETRY / "emaws-variants.toml").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def variants(tmp_path_factory):
    """Three variants, of which the second cannot be drawn."""
    directory = tmp_path_factory.mktemp("variants")
    text = VARIANTS.replace("{ start = 15, stop = 45, step = 5 }", "[15, 19, 24, 31, 45]")
    (directory / "variants.toml").write_text(text.replace("values = [10, 10, 11]", "values = [10, 21, 11]"))
    options = ("-o", directory / "run", "--workers", 1, "--json", directory / "summary.json")
    return directory, femfit("sweep", directory / "variants.toml", *options)


def test_a_variant_without_a_point_ends_the_sweep_as_an_error_that_numbers_it(variants):
    directory, result = variants
    assert result.returncode == 1
    assert "1 variant of 3 (2)" in result.stderr
    assert "coils.coil.r_mm" in result.stdout
    assert json.loads((directory / "summary.json").read_text())["failed"] == 15


def test_a_fit_is_of_the_variant_that_is_chosen(variants, tmp_path):
    run, models = variants[0] / "run", []
    for where in (["variant=3"], ["coils.coil.turns=250", "sleeve_radius_m=0.011"]):
        options = [word for one in where for word in ("--where", one)]
        worked("fit", run, *options, "-o", tmp_path / "model.json")
        models.append(json.loads((tmp_path / "model.json").read_text())["magnetics"])
        (tmp_path / "model.json").unlink()
    assert models[0] == models[1]
    for where, words in (((), "--where variant=1"), (("variant=7",), "variant = 7"), (("variant=2",), "status ok")):
        refused = femfit("fit", run, *(word for one in where for word in ("--where", one)))
        assert (refused.returncode, words in refused.stderr) == (1, True)


def test_a_table_needs_no_stop_and_a_model_ends_where_its_sweep_does(tmp_path):
    """Of two stops the sweep reaches one: the table is whole, a simulation towards the other ends with the model."""
    drawing = SLEEVED.replace("mass_g = 2", "mass_g = 2\ntravel_mm = [1, 8]")
    fitted = ff.fit_model(run_sweep(actuator_from_toml(drawing), tmp_path / "run", workers=1))
    (said,) = (line for line in str(fitted).splitlines() if " stop " in line)
    assert "1.00 mm" in said
    model = fitted.model
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


@pytest.mark.parametrize(
    ("fails", "named", "curve_asked_for"),
    [
        (lambda _, d: d == 5e-3, "at 5 mm", False),
        (lambda _, d: d < 5.5e-3, "at 4 mm, 5 mm", True),
    ],
)
def test_distances_that_fail_whole_are_named_and_the_curve_is_blamed_for_several(
    steel, monkeypatch, fails, named, curve_asked_for
):
    given_up(monkeypatch, fails)
    result = femfit("sweep", "steel.toml", "-o", "run", "--workers", 1, cwd=steel)
    (line,) = [line for line in result.stdout.splitlines() if "converge" in line]
    assert named in line
    assert ("B-H curve" in line) == curve_asked_for


@pytest.mark.nightly
def test_everything_is_drawn_into_a_directory_with_the_numbers_that_the_picture_marks(tmp_path):
    options = ("--distance-mm", "20", "-o", tmp_path / "all", "--json", tmp_path / "all.json")
    result = worked("view", GEOMETRY / "emaws-rig.toml", *options)
    pictures = {f"{name}.png" for name in ("geometry", "mesh", "flux-lines", "flux-density", "permeability")}
    assert {file.name for file in (tmp_path / "all").iterdir()} == pictures | {"field.vtu"}
    numbers = {one["key"]: one for one in json.loads((tmp_path / "all.json").read_text())["numbers"]}
    key = "moving.regions.magnet.z_mm[1]"
    assert (numbers[key]["title"], numbers[key]["at_mm"]) == ("magnet: face at z = 5 mm", [2.75, 5.0])
    (marked,) = [line for line in result.stdout.splitlines() if line.endswith(f"[{key}]")]
    assert marked.split()[0] == str(1 + list(numbers).index(key))


def test_a_view_solves_its_own_point_alone_once_and_to_the_sweeps_tolerance(tmp_path, monkeypatch):
    steel = SMALL.replace('material = "iron"', 'material = "steel_1010"').split("[tolerances]")[0]
    steel += "[solver]\ntolerance = 5e-3\n"
    (tmp_path / "small.toml").write_text(steel.replace("[0, 0.5, 1]", "[0, 0.2, 0.4, 0.6, 0.8, 1]"))
    text = steel.replace("[0, 0.5, 1]", "[0, 0.8]").replace("{ start = 4, stop = 12, step = 1 }", "[7]")
    solved = []

    def counted(system, points, *rest):
        solved.append((system.space.ndof, len(points)))
        return along_currents(system, points, *rest)

    monkeypatch.setattr("femfit.field.nonlinear_point.along_currents", counted)
    place = ("--distance-mm", "7", "--current-A", "0.8", "--json", tmp_path / "view.json")
    worked("view", tmp_path / "small.toml", *place, "-o", tmp_path / "b.png")
    finest = max(unknowns for unknowns, _ in solved)
    assert [points for unknowns, points in solved if unknowns == finest] == [2]  # with the one without current
    force = run_sweep(actuator_from_toml(text), tmp_path / "run", workers=1).rows["force_N"].iloc[-1]
    assert json.loads((tmp_path / "view.json").read_text())["force_N"] == pytest.approx(force, rel=5e-3)


@pytest.fixture(scope="module")
def weak(tmp_path_factory):
    """A device whose magnet is 6 % weaker than drawn, four of the tolerances that are assumed, read with much noise."""
    directory = tmp_path_factory.mktemp("weak")
    (directory / "assumed.toml").write_text(DRAWN)
    declared = DRAWN.replace("[tolerances]", '[tolerances]\n"materials.hard.remanence_T" = 0.2')
    (directory / "declared.toml").write_text(declared)
    true = actuator_from_toml(DRAWN.replace("remanence_T = 1.2", "remanence_T = 1.128"))
    rows = run_sweep(true, directory / "true", workers=1).rows
    rng, tables = np.random.default_rng(11), []
    for run in (1, 2):
        noise = 0.008 * rng.standard_normal(len(rows))
        tables.append(rows[["distance_m", "current_A"]].assign(run=run, force_N=rows["force_N"] + noise))
    pd.concat(tables).to_csv(directory / "bench.csv", index=False)
    return directory


@pytest.mark.nightly
def test_a_tolerance_that_was_declared_leaves_the_number_to_the_data(weak):
    worked(
        "calibrate", "declared.toml", "bench.csv", "--numbers", "remanence", "--with", "force_offset", "--noise",
        "force_N=0.008", "-o", "declared-new.toml", "--runs", "runs-declared", "--workers", 1, "--json",
        "declared.json", cwd=weak,
    )  # fmt: skip
    (number,) = json.loads((weak / "declared.json").read_text())["numbers"]
    assert abs(number["value"] - 1.128) < 2.0 * number["sd_as_drawn"]


def test_options_of_an_import_reach_its_reader(tmp_path):
    (tmp_path / "a.txt").write_text("5 -1\n6 -0.9\n")
    (tmp_path / "b.txt").write_text("5 -2\n6 -1.8\n")
    options = ["--columns", "position,force", "--unit", "distance=mm", "--file-current-A", "0,1", "--keep-force"]
    actuator = ("--actuator", GEOMETRY / "emaws-rig.toml")
    worked("import", tmp_path / "a.txt", tmp_path / "b.txt", "-o", tmp_path / "out", *options, *actuator)
    table = read_sweep_table(tmp_path / "out")
    assert table.rows["current_A"].tolist() == [0, 0, 1, 1]
    assert table.rows["force_N"].tolist() == [-1, -0.9, -2, -1.8]
    assert table.manifest["actuator"]["mass_kg"] == pytest.approx(4.35e-3)
    assert table.manifest["actuator"]["hall"] is not None


@pytest.mark.parametrize("option", [("--moving-group", 3), ("--moving-block", "N40")])
def test_the_moving_part_of_a_fem_model_can_be_named_by_group_or_block(option, tmp_path):
    (tmp_path / "m.fem").write_text(suspension(below=True, face=3.0, unit="inches").text())
    worked("import-fem", tmp_path / "m.fem", "-o", tmp_path / "a.toml", "--json", tmp_path / "r.json", *option)
    assert [region.name for region in read_actuator(tmp_path / "a.toml").moving.regions] == ["n40"]
    assert "mover" not in {one["code"] for one in json.loads((tmp_path / "r.json").read_text())["findings"]}
