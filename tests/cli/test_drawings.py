"""From a drawing or a table of another program: new, sweep, run, view, calibrate, import, import-fem."""

import json
import re
import tomllib
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import get_args

import pytest

import femfit as ff
from femfit.cli.drawings import Kind
from femfit.cli.run import _close_loop
from femfit.device.electrics import CurrentSensor, PositionSensor
from femfit.device.load import actuator_from_toml, read_actuator
from femfit.field.newton import along_currents
from femfit.field.sweep import run_sweep
from femfit.tables.sweep_table import read_sweep_table
from support.actuators import GEOMETRY
from support.command import femfit, worked
from support.fem_files import suspension
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
    places = ("geometry/*", "docs/reference/*", "femfit/device/examples/*", "tests/device/drawings/r*")
    drawings = [path for place in places for path in sorted(GEOMETRY.parent.glob(f"{place}.toml"))]
    tables = {str(path): tomllib.loads(path.read_text(encoding="utf-8")) for path in drawings}
    assert {drawn["schema"] for drawn in tables.values()} == {1, 2}
    assert not [(name, one.message) for name, drawn in tables.items() for one in validator.iter_errors(drawn)]
    wrong = tables[str(drawings[0])] | {"mechanics": {"mass_g": -1, "gravty": "off"}}
    assert len(list(validator.iter_errors(wrong))) == 2
    assert not [name for name, drawn in tables.items() if validator.is_valid(drawn | {"nane": "x"})]
    text = (GEOMETRY.parent / "docs/reference/every-key-circuits.toml").read_text(encoding="utf-8")
    for right, wrong in {"stiffness_N_per_mm": "stifness_N_per_mm", "turns": "turn", "step": "stp"}.items():
        mistyped = tomllib.loads(re.sub(rf"\b{right} =", f"{wrong} =", text))
        said = " ".join(fault.message for fault in validator.iter_errors(mistyped))
        assert f"('{wrong}' was unexpected)" in said  # though a table may be one of several records
    assert "Give a kind of actuator" in femfit("new").stderr


def test_no_loop_is_closed_where_no_sensor_reads_the_distance(monkeypatch, levitation_model):
    shunt = CurrentSensor(name="shunt", circuit="coil", noise=0.004)
    laser = PositionSensor(name="laser", noise=4e-5, distances_m=(0.0, 1.0), readings=(0.0, 1.0), unit="m")
    blind = replace(levitation_model, sensor=None, other_sensors=(shunt,))
    calls = []
    monkeypatch.setattr("femfit.simulation.close_loop.closed_loop_study", lambda model, seed: calls.append(model))
    _, why = _close_loop(blind, 1, Path("runs/valve/model.json"))
    assert not calls
    assert "femfit simulate runs/valve/model.json" in why
    for seeing in (levitation_model, replace(blind, other_sensors=(shunt, laser))):
        assert _close_loop(seeing, 1, Path("model.json"))[1] == ""
    assert len(calls) == 2


@pytest.fixture(scope="module")
def variants(tmp_path_factory):
    """Three variants, of which the second cannot be drawn."""
    directory = tmp_path_factory.mktemp("variants")
    text = (GEOMETRY / "emaws-variants.toml").read_text(encoding="utf-8")
    text = text.replace("{ start = 15, stop = 45, step = 5 }", "[15, 19, 24, 31, 45]")
    (directory / "variants.toml").write_text(text.replace("values = [10, 10, 11]", "values = [10, 21, 11]"))
    line = "sweep variants.toml -o run --workers 1 --json summary.json"
    return directory, femfit(*line.split(), cwd=directory)


def test_a_variant_without_a_point_ends_the_sweep_as_an_error_that_numbers_it(variants):
    directory, result = variants
    assert result.returncode == 1
    assert "1 variant of 3 (2)" in result.stderr
    assert "coils.coil.r_mm" in result.stdout
    assert json.loads((directory / "summary.json").read_text())["failed"] == 15


def test_a_fit_is_of_the_variant_that_is_chosen(variants):
    directory, models = variants[0], []
    for n, where in enumerate(("variant=3", "coils.coil.turns=250 --where sleeve_radius_m=0.011")):
        worked(*f"fit run --where {where} -o {n}.json".split(), cwd=directory)
        models.append(json.loads((directory / f"{n}.json").read_text())["magnetics"])
    assert models[0] == models[1]
    refused = femfit("fit", "run", "--where", "variant=2", cwd=directory)
    assert (refused.returncode, "status ok" in refused.stderr) == (1, True)


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


@pytest.mark.nightly
def test_everything_is_drawn_into_a_directory_and_the_numbers_are_listed(tmp_path):
    options = ("--distance-mm", "20", "-o", tmp_path / "all", "--json", tmp_path / "all.json")
    worked("view", GEOMETRY / "emaws-rig.toml", *options)
    pictures = {f"{name}.png" for name in ("geometry", "mesh", "flux-lines", "flux-density")}
    assert {file.name for file in (tmp_path / "all").iterdir()} == pictures | {"field.vtu"}
    numbers = {one["key"]: one for one in json.loads((tmp_path / "all.json").read_text())["numbers"]}
    key = "moving.regions.magnet.z_mm[1]"
    assert (numbers[key]["title"], numbers[key]["at_mm"]) == ("magnet: face at z = 5 mm", [2.75, 5.0])


def test_a_view_solves_its_own_point_alone_once(tmp_path, monkeypatch):
    steel = SMALL.replace('material = "iron"', 'material = "steel_1010"').split("[tolerances]")[0]
    (tmp_path / "small.toml").write_text(steel + "[solver]\ntolerance = 5e-3\n")
    solved = []

    def counted(system, points, *rest):
        solved.append((system.space.ndof, len(points)))
        return along_currents(system, points, *rest)

    monkeypatch.setattr("femfit.field.problem.along_currents", counted)
    worked("view", tmp_path / "small.toml", "--distance-mm", 7, "--current-A", 0.8, "-o", tmp_path / "b.png")
    finest = max(unknowns for unknowns, _ in solved)
    assert [points for unknowns, points in solved if unknowns == finest] == [2]  # with the one without current


def test_options_of_an_import_reach_its_reader(tmp_path):
    (tmp_path / "0A.txt").write_text("5 -1\n6 -0.9\n")
    (tmp_path / "1A.txt").write_text("5 -2\n6 -1.8\n")
    line = "import 0A.txt 1A.txt -o out --columns position,force --unit distance=mm --keep-force --actuator"
    worked(*line.split(), GEOMETRY / "emaws-rig.toml", cwd=tmp_path)
    table = read_sweep_table(tmp_path / "out")
    assert table.rows["current_A"].tolist() == [0, 0, 1, 1]
    assert table.rows["force_N"].tolist() == [-1, -0.9, -2, -1.8]
    assert table.manifest["actuator"]["mass_kg"] == pytest.approx(4.35e-3)
    assert table.manifest["actuator"]["hall"] is not None


def test_an_empty_name_keeps_its_place_among_the_names_of_columns(tmp_path):
    rows = [f"0.00{11 + k},{0.3 + k / 100},{0.2 + k / 100},{0.1 + k / 100}" for k in range(5)]
    (tmp_path / "matrix.csv").write_text("\n".join(rows))
    line = "import matrix.csv -o out --matrix-rows distance --unit distance=m --columns"
    worked(*line.split(), ",0 A,0.5 A,1 A", cwd=tmp_path)
    assert sorted(read_sweep_table(tmp_path / "out").rows["current_A"].unique()) == [0.0, 0.5, 1.0]


def test_the_moving_part_of_a_fem_model_can_be_named_by_a_label(tmp_path):
    (tmp_path / "m.fem").write_text(suspension("inches", below=True, face=3.0))
    worked("import-fem", "m.fem", "-o", "a.toml", "--json", "r.json", "--moving-label", 3, cwd=tmp_path)
    assert [region.name for region in read_actuator(tmp_path / "a.toml").moving.regions] == ["n40"]
    assert "mover" not in {one["code"] for one in json.loads((tmp_path / "r.json").read_text())["findings"]}
