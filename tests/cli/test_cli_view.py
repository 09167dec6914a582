"""``femfit view`` from the command line."""

import json
import shutil

import pytest

from femfit.field.current_path import along_currents
from support.actuators import GEOMETRY
from support.command import femfit
from support.small_drawing import SMALL

RIG = (GEOMETRY / "emaws-rig.toml").read_text()
SWEEP = RIG[RIG.index("[sweep]") : RIG.index("[reference]")]


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    """A run directory of two rows."""
    directory = tmp_path_factory.mktemp("view")
    text = RIG.replace(SWEEP, "[sweep]\ncurrent_A = [0.0, 0.5]\ndistance_mm = [20.0]\n\n")
    text = text[: text.index("[reference]")]
    (directory / "rig.toml").write_text(text)
    result = femfit("sweep", directory / "rig.toml", "-o", directory / "run", "--workers", "1")
    assert result.returncode == 0, result.stderr
    return directory / "run"


def test_a_row_of_a_sweep_is_drawn_with_the_sweeps_force(swept, tmp_path):
    result = femfit("view", swept, "--row", "1", "-o", tmp_path / "b.png", "--json", tmp_path / "b.json")
    assert result.returncode == 0, result.stderr
    data = json.loads((tmp_path / "b.json").read_text())
    assert (data["distance_m"], data["current_A"]) == (0.02, 0.5)
    last = (swept / "sweep.csv").read_text().splitlines()
    force = float(last[2].split(",")[last[0].split(",").index("force_N")])
    assert data["force_N"] == pytest.approx(force, rel=1e-6)  # the same mesh: the sweep has this distance alone
    assert (tmp_path / "b.png").read_bytes().startswith(b"\x89PNG")
    assert "d = 20 mm, i = 0.5 A" in result.stdout


def test_everything_goes_into_a_directory(tmp_path):
    options = ("--distance-mm", "20", "-o", tmp_path / "all", "--json", tmp_path / "all.json")
    result = femfit("view", GEOMETRY / "emaws-rig.toml", *options)
    assert result.returncode == 0, result.stderr
    names = {file.name for file in (tmp_path / "all").iterdir()}
    pictures = {f"{name}.png" for name in ("geometry", "mesh", "flux-lines", "flux-density", "permeability")}
    assert names == pictures | {"field.vtu"}
    numbers = json.loads((tmp_path / "all.json").read_text())["numbers"]  # which the picture marks
    titles = {one["key"]: one["title"] for one in numbers}
    assert titles["moving.regions.magnet.z_mm[1]"] == "magnet: face at z = 5 mm"
    places = {one["key"]: one["at_mm"] for one in numbers}
    assert places["moving.regions.magnet.z_mm[1]"] == [2.75, 5.0]
    lines = result.stdout.splitlines()
    marked = [line for line in lines if line.endswith("magnet: face at z = 5 mm [moving.regions.magnet.z_mm[1]]")]
    assert [line.split()[0] for line in marked] == [str(1 + list(titles).index("moving.regions.magnet.z_mm[1]"))]


@pytest.mark.parametrize(
    ("arguments", "words", "code"),
    [
        (["--distance-mm", "5"], "15 to 45 mm", 1),
        (["--row", "1"], "give a run directory", 2),
        (["--what", "mesh", "--what", "vtu", "-o", "one.png"], "Give a directory", 2),
        (["--what", "mesh", "-o", "field.vtu"], "not mesh", 2),
        (["-o", "p.gif"], ".png, .svg, .pdf", 2),
    ],
)
def test_a_request_that_cannot_be_met_says_what_to_do(arguments, words, code):
    result = femfit("view", GEOMETRY / "emaws-rig.toml", *arguments)
    assert result.returncode == code
    assert words in " ".join(result.stderr.split())


def test_a_row_beyond_the_table_is_refused(swept):
    result = femfit("view", swept, "--row", "7")
    assert result.returncode == 1
    assert "at most 1" in result.stderr


def test_a_full_disk_is_an_error_and_no_field_that_was_written(tmp_path):
    (tmp_path / "field.vtu").symlink_to("/dev/full")
    result = femfit("view", GEOMETRY / "emaws-rig.toml", "-o", tmp_path / "field.vtu")
    assert result.returncode == 1
    assert "No space left" in result.stderr
    assert "written" not in result.stdout


def test_a_manifests_name_leads_no_file_out_of_the_directory(swept, tmp_path):
    copy = tmp_path / "in" / "run"
    shutil.copytree(swept, copy)
    manifest = json.loads((copy / "manifest.json").read_text())
    manifest["inputs"]["name"] = manifest["name"] = "../stray"
    (copy / "manifest.json").write_text(json.dumps(manifest))
    result = femfit("view", copy, "--what", "mesh", cwd=tmp_path / "in")
    assert result.returncode == 1
    assert "name" in result.stderr
    assert [file.name for file in tmp_path.iterdir()] == ["in"]


def test_a_view_solves_its_own_point_alone_once_and_to_the_sweeps_tolerance(tmp_path, monkeypatch):
    steel = SMALL.replace('material = "iron"', 'material = "steel_1010"').split("[tolerances]")[0]
    steel += "[solver]\ntolerance = 5e-3\n"
    (tmp_path / "small.toml").write_text(steel.replace("[0, 0.5, 1]", "[0, 0.2, 0.4, 0.6, 0.8, 1]"))
    (tmp_path / "point.toml").write_text(
        steel.replace("[0, 0.5, 1]", "[0, 0.8]").replace("{ start = 4, stop = 12, step = 1 }", "[7]")
    )
    solved = []

    def counted(system, points, *rest):
        solved.append((system.space.ndof, len(points)))
        return along_currents(system, points, *rest)

    monkeypatch.setattr("femfit.field.nonlinear_point.along_currents", counted)
    place = ("--distance-mm", "7", "--current-A", "0.8", "--json", tmp_path / "view.json")
    assert femfit("view", tmp_path / "small.toml", *place, "-o", tmp_path / "b.png").returncode == 0
    finest = max(unknowns for unknowns, _ in solved)
    assert [points for unknowns, points in solved if unknowns == finest] == [2]  # with the one without current
    assert femfit("sweep", tmp_path / "point.toml", "-o", tmp_path / "run", "--workers", "1").returncode == 0
    header, _, row = (tmp_path / "run" / "sweep.csv").read_text().splitlines()
    force = float(row.split(",")[header.split(",").index("force_N")])
    assert json.loads((tmp_path / "view.json").read_text())["force_N"] == pytest.approx(force, rel=5e-3)
