"""The exported package runs where only numpy exists, and gives femfit's numbers."""

import shutil
import subprocess
import sys
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import femfit
from femfit.core.errors import MissingPartError, RunDirectoryError, UsageError
from femfit.device.electrics import CurrentSensor, Drive, PositionSensor
from femfit.effects.catalogue import effect_by_name
from femfit.effects.effect import AddedEffect
from femfit.fit.build import fit_model
from femfit.model.json_file import write_model
from femfit.model.magnetics import Coefficient, LawMagnetics
from femfit.model.with_effects import with_effects
from femfit.targets import estimator
from femfit.targets.estimator import NEW, OLD, RUNTIME, export_estimator, imported_modules, renamed_imports
from femfit.targets.targets import TARGETS, export
from support.bearing import ENTRY, table_of
from support.eddies import with_eddies

CLOSED_LOOP = """
import sys
from dataclasses import replace
from pathlib import Path
import numpy as np
from {package}.estimate.kalman_filter import ExtendedFilter, UnscentedFilter
from {package}.estimate.levitation import levitation_process
from {package}.estimate.noise import initial_covariance, with_memory
from {package}.model.json_file import read_model
from {package}.simulation.controllers import design_backstepping
from {package}.simulation.loop import ClosedLoop, run_loop
from {package}.simulation.operating_point import operating_point
from {package}.simulation.plant import Plant
from {package}.simulation.targets import reference_steps
from {package}.simulation.sensor import SensorErrors, loop_sensors

def closed_loop(model_file, steps, filters):
    model = read_model(Path(model_file))
    points = [operating_point(model, d) for d in (0.022, 0.026)]
    reference = reference_steps([0.022, 0.026], steps, model.sample_time_s, rate=30.0)
    results = []
    for kind in (UnscentedFilter, ExtendedFilter)[:filters]:
        covariance = with_memory(model, initial_covariance(biases=(0.01,)))
        observer = kind(replace(levitation_process(model, hall_bias=True), start_covariance=covariance))
        sensors = loop_sensors(model, ("hall",), {{"hall": 1e-3}}, model.sample_time_s)
        loop = ClosedLoop(Plant(model), sensors, SensorErrors(), observer,
                          design_backstepping(model, points), reference)
        start = np.array([[0.0221, 0.0, points[0].current_A], [0.0219, 0.0, points[0].current_A]])
        series = run_loop(loop, start, np.random.default_rng(3)).series
        each = [getattr(series, name) for name in sorted(vars(series))]
        results.append(np.concatenate([one.reshape(*one.shape[:2], -1) for one in each], axis=2))
    return np.stack(results)
"""

IN_THE_BARE_ENVIRONMENT = (
    CLOSED_LOOP.format(package=RUNTIME)
    + """
for absent in ("femfit", "ngsolve", "cvxpy", "scipy", "pandas", "pyarrow", "cyclopts", "rich", "filterpy"):
    try:
        __import__(absent)
    except ModuleNotFoundError:
        continue
    raise SystemExit(f"{absent} is importable: the environment is not bare")
np.save(sys.argv[2], closed_loop(sys.argv[1], *map(int, sys.argv[3:])))
"""
)


@pytest.fixture(scope="module")
def exported(levitation_model, tmp_path_factory):
    directory = tmp_path_factory.mktemp("export") / "estimator"
    export_estimator(levitation_model, directory)
    return directory


@pytest.fixture(scope="module")
def bare_paths(tmp_path_factory):
    """A directory whose only content is numpy (and the libraries that its wheel carries)."""
    site = tmp_path_factory.mktemp("bare")
    installed = Path(np.__file__).parent
    for name in ("numpy", "numpy.libs"):
        if (installed.parent / name).exists():
            (site / name).symlink_to(installed.parent / name)
    return site


def run_bare(exported, bare_paths, code, *arguments):
    """Python without site-packages, environment variables and working directory; numpy and the export only."""
    prefix = f"import sys; sys.path[:0] = [{str(exported)!r}, {str(bare_paths)!r}]\n"
    command = [sys.executable, "-I", "-S", "-W", "error", "-c", prefix + code, *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=bare_paths)
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


def run_example(place, bare_paths):
    """What the example prints: "Wanted", a distance in mm, "mm; held", the mean, ... or the like."""
    return run_bare(
        place, bare_paths, f"import runpy; runpy.run_path({str(place / 'example.py')!r}, run_name='__main__')"
    )


def with_catalogues_effects(model):
    names = {"core_saturation": "mmf_loss_3", "eddy_current_lag": "ring_share", "hall_saturation": "cubic_loss"}
    effects = [effect_by_name(name) for name in names]
    return with_effects(model, [AddedEffect(one, one.null() | {names[one.name]: 0.03}) for one in effects])


@pytest.mark.parametrize(
    ("change", "steps", "filters"),
    [
        pytest.param(lambda model: model, 200, 2, id="as fitted"),
        pytest.param(with_catalogues_effects, 100, 1, id="with effects", marks=pytest.mark.nightly),
        pytest.param(lambda model: with_eddies(model, (2e-4, 5e-5)), 100, 2, id="with eddy currents"),
    ],
)
def test_closed_loops_in_a_bare_environment_equal_femfits(
    levitation_model, bare_paths, tmp_path, change, steps, filters
):
    model, file = change(levitation_model), tmp_path / "bare.npy"
    export_estimator(model, tmp_path / "out")
    run_bare(
        tmp_path / "out", bare_paths, IN_THE_BARE_ENVIRONMENT, tmp_path / "out" / "model.json", file, steps, filters
    )
    here = {}
    exec(compile(CLOSED_LOOP.format(package="femfit"), "closed_loop", "exec"), here)  # noqa: S102  # the same text
    write_model(model, tmp_path / "model.json")
    ours = here["closed_loop"](tmp_path / "model.json", steps, filters)
    assert np.isfinite(ours).all()
    assert ours.shape[:2] == (filters, steps)
    # The same operations on the same libraries leave no room for more.
    np.testing.assert_allclose(np.load(file), ours, rtol=0.0, atol=1e-12)


def test_the_example_holds_the_body_in_a_bare_environment(exported, bare_paths):
    words = run_example(exported, bare_paths)
    wanted, held = float(words[1]), float(words[4])
    assert wanted == 22.0
    # One second of 3.2 mV Hall noise moves the mean by its standard error, about 0.02 mm; a lost body by millimetres.
    assert abs(held - wanted) < 0.1


@pytest.mark.nightly
def test_the_example_chooses_a_distance_at_which_the_hall_element_is_not_saturated(
    levitation_model, bare_paths, tmp_path
):
    # 8.3 mT fill this one's range, and the magnet alone has 8.7 mT at 20 mm.
    sensor = replace(levitation_model.sensor, sensitivity_V_per_T=300.0)
    export_estimator(replace(levitation_model, sensor=sensor, reference_distances_m=()), tmp_path)
    words = run_example(tmp_path, bare_paths)
    assert 22.0 < float(words[1]) < 35.0
    assert abs(float(words[4]) - float(words[1])) < 0.1


@pytest.mark.nightly
def test_a_bearing_of_two_circuits_holds_itself_where_only_numpy_is(bare_paths, tmp_path):
    gap = {"kind": "position", "name": "gap", "noise": 2e-7, "distances_m": [0, 1], "readings": [0, 1], "unit": "m"}
    bearing = fit_model(table_of(entry={**ENTRY, "sensors": [gap], "sample_time_s": 1e-4})).model
    bridges = tuple(replace(one, voltage_min_V=-24.0, drive=Drive()) for one in bearing.circuits)
    export_estimator(replace(bearing, circuits=bridges), tmp_path)
    assert "held" in run_example(tmp_path, bare_paths)


def test_the_package_needs_numpy_alone(exported):
    texts = [file.read_text() for file in (exported / RUNTIME).rglob("*.py")]
    tops = {name.partition(".")[0] for text in texts for name in imported_modules(text)}
    assert tops - sys.stdlib_module_names == {"numpy", RUNTIME}
    project = tomllib.loads((exported / "pyproject.toml").read_text())["project"]
    assert (project["dependencies"], project["version"]) == (["numpy>=2.0"], femfit.__version__)


def test_every_copied_file_differs_from_femfits_in_import_lines_only(exported):
    root = Path(femfit.__file__).parent
    copies = set((exported / RUNTIME).rglob("*.py")) - {exported / RUNTIME / "__init__.py"}
    for copy in copies - set((exported / RUNTIME).rglob("catalogue.py")):
        original = (root / copy.relative_to(exported / RUNTIME)).read_text().splitlines()
        for ours, theirs in zip(original, copy.read_text().splitlines(), strict=True):
            if ours != theirs:
                assert ours.lstrip().startswith(("from femfit", "import femfit"))
                assert ours.replace("femfit", RUNTIME, 1) == theirs


def test_the_package_holds_the_laws_and_effects_of_its_model_and_nothing_of_the_bench(
    exported, levitation_model, tmp_path
):
    assert {file.stem for file in (exported / RUNTIME / "laws").glob("*.py")} == {"__init__", "catalogue", "law"}
    assert not (exported / RUNTIME / "effects" / "hysteresis.py").exists()
    export_estimator(
        with_effects(levitation_model, [AddedEffect(effect_by_name("hall_offset"), {"offset_V": 0.1})]), tmp_path
    )
    effects = {file.stem for file in (tmp_path / RUNTIME / "effects").iterdir()}
    assert "zeros_and_scales" in effects
    assert effects.isdisjoint({"hysteresis", "hall", "iron"})
    rooms = {file.name for file in (exported / RUNTIME).iterdir() if file.name != "__pycache__"}
    assert rooms == {"__init__.py", "core", "laws", "effects", "device", "model", "estimate", "simulation"}
    device = {file.stem for file in (exported / RUNTIME / "device").glob("*.py")}
    assert device == {"__init__", "electrics", "mechanics"}
    names = {file.stem for file in exported.rglob("*.py")}
    assert names.isdisjoint({"study", "table6", "journal", "readings", "field_of_current", "consistency"})
    assert len(names) < 0.25 * len(list(Path(femfit.__file__).parent.rglob("*.py")))  # a fifth of femfit, no more


def test_the_description_names_the_sensors_of_a_model_without_hall_element_in_their_order(levitation_model, tmp_path):
    laser = PositionSensor(name="laser", distances_m=(0.0, 0.1), readings=(0.0, 10.0), noise=2e-3)
    shunt = CurrentSensor(name="shunt", circuit=levitation_model.circuit_names[0], noise=1e-3)
    export_estimator(replace(levitation_model, sensor=None, other_sensors=(shunt, laser)), tmp_path)
    words = (tmp_path / "README.md").read_text(encoding="utf-8")
    assert "shunt, laser" in words
    assert "Hall" not in words


def test_imports_are_renamed_inside_of_functions_too_and_no_name_that_begins_alike():
    text = "def f():\n    from femfit.core import errors\n    return 'from femfit'\n"
    assert imported_modules(text) == ("femfit.core.errors",)
    assert renamed_imports(text, "other") == text.replace("from femfit.core", "from other.core")
    assert renamed_imports("import femfit_extra\n", "other") == "import femfit_extra\n"


def test_exporting_again_replaces_an_earlier_export_and_drops_stale_files(levitation_model, exported, tmp_path):
    shutil.copytree(exported, tmp_path, dirs_exist_ok=True)
    (tmp_path / RUNTIME / "stale.py").write_text("")
    (tmp_path / "my_controller.py").write_text("mine")
    export_estimator(replace(levitation_model, name="second"), tmp_path)
    assert not (tmp_path / RUNTIME / "stale.py").exists()
    assert (tmp_path / "my_controller.py").read_text() == "mine"
    assert '"second"' in (tmp_path / "model.json").read_text()


@pytest.mark.parametrize("left", [NEW, OLD])
def test_what_an_interrupted_export_left_does_not_block_the_next(levitation_model, tmp_path, left):
    (tmp_path / left).mkdir()
    (tmp_path / left / "half.py").write_text("")
    (tmp_path / "model.json").write_text("{}")  # as after a kill between the removal of the old and the new package
    export_estimator(levitation_model, tmp_path)
    assert {file.name for file in tmp_path.iterdir()} >= {RUNTIME, "model.json", "example.py"}
    assert not (tmp_path / NEW).exists()
    assert not (tmp_path / OLD).exists()


def test_an_export_that_fails_leaves_nothing_and_keeps_an_earlier_one(
    levitation_model, exported, tmp_path, monkeypatch
):
    shutil.copytree(exported, tmp_path / "kept")

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(estimator, "write_model", full)
    for name in ("kept", "new"):
        with pytest.raises(OSError, match="No space") as caught:
            export_estimator(levitation_model, tmp_path / name)
        assert caught.value.filename == str(tmp_path / name)
    assert [file.name for file in tmp_path.iterdir()] == ["kept"]
    assert (tmp_path / "kept" / RUNTIME / "__init__.py").is_file()
    assert not (tmp_path / "kept" / NEW).exists()


def test_a_directory_with_other_files_is_refused_and_left_alone(levitation_model, tmp_path):
    (tmp_path / "README.md").write_text("mine")
    with pytest.raises(RunDirectoryError, match="other files"):
        export_estimator(levitation_model, tmp_path)
    assert (tmp_path / "README.md").read_text() == "mine"
    assert len(list(tmp_path.iterdir())) == 1


@pytest.mark.parametrize(("part", "absent"), [("circuits", ()), ("motion", None), ("sensor", None)])
def test_a_model_without_a_part_is_refused_before_anything_is_written(levitation_model, tmp_path, part, absent):
    with pytest.raises(MissingPartError, match=part.rstrip("s")):
        export_estimator(replace(levitation_model, **{part: absent}), tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("part", ["law", "effect"])
def test_what_comes_from_another_package_cannot_be_exported(levitation_model, tmp_path, part):
    foreign = LawMagnetics("theirs", (Coefficient("d^-4", 0, 1e-9, "N m^4"),))
    theirs = AddedEffect(replace(effect_by_name("hall_offset"), name="theirs"), {"offset_V": 0.1})
    law, effect = replace(levitation_model, magnetics=foreign), with_effects(levitation_model, [theirs])
    with pytest.raises(MissingPartError, match="'theirs' comes from another"):
        export_estimator(law if part == "law" else effect, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_model_file_is_exported_and_the_result_says_what_to_try(levitation_model, tmp_path):
    write_model(levitation_model, tmp_path / "model.json")
    result = export(str(tmp_path / "model.json"), str(tmp_path / "out"))
    assert str(tmp_path / "out" / "example.py") in str(result)
    assert set(result.files) == {file for file in (tmp_path / "out").rglob("*") if file.is_file()}


def test_an_unknown_target_lists_the_known_ones():
    with pytest.raises(UsageError, match=r"one of: estimator .*instead received 'fmu'"):
        export("model.json", "out", to="fmu")
    assert [target.name for target in TARGETS] == ["estimator"]
