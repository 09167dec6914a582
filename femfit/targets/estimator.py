"""Export a model as a self-contained package with filters and a simulator, which needs numpy alone.

The package is femfit's own source, copied file by file with only the package's name changed in the import statements,
so that no formula exists twice and its numbers are femfit's numbers.
"""

import shutil
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

from femfit import __version__
from femfit.core.errors import MissingPartError, RunDirectoryError
from femfit.effects.base_amplitudes import BASE_AMPLITUDES
from femfit.effects.catalogue import BUILT_IN as BUILT_IN_EFFECTS
from femfit.filters.levitation import require_slow_coil
from femfit.filters.noise import operating_distance
from femfit.laws.catalogue import BUILT_IN
from femfit.model.actuator_model import ActuatorModel
from femfit.model.json_file import write_model
from femfit.model.magnetics import LawMagnetics
from femfit.targets.import_graph import SourceFile, reachable_sources, renamed_imports, third_party_imports

RUNTIME = "femfit_runtime"
ROOMS = ("simulation", "filters", "model")
RUN_TIME_DEPENDENCIES = frozenset({"numpy"})


def export_estimator(model: ActuatorModel, directory: Path) -> tuple[Path, ...]:
    """Write the package, the model, a description and an example.

    Parameters
    ----------
    directory : Path
        Absent, empty, or an earlier export, whose files are replaced.

    Raises
    ------
    MissingPartError
        If the model has no circuit, motion or sensor, or a force law or effect that is not femfit's own.
    FilterError
        If the coil is too fast for a filter at the model's sample time.
    RunDirectoryError
        If the directory holds anything else.
    """
    model.require_circuit()
    model.require_motion()
    model.require_sensor()
    _require_built_in_law(model)
    _require_built_in_effects(model)
    model.require_dynamics()
    require_slow_coil(model, operating_distance(model))
    directory = Path(directory)
    _require_free(directory)
    sources = reachable_sources(ROOMS)
    foreign = third_party_imports(sources) - RUN_TIME_DEPENDENCIES
    if foreign:
        raise MissingPartError(
            f"The exported rooms may import numpy alone; this femfit's import {', '.join(sorted(foreign))}. "
            "Install an unmodified femfit."
        )
    written = [*_write_package(sources, directory), directory / "model.json"]
    write_model(model, directory / "model.json")
    texts = {
        "pyproject.toml": _PYPROJECT.format(runtime=RUNTIME, version=__version__),
        "README.md": _README.format(name=model.name, runtime=RUNTIME, version=__version__),
        "example.py": _EXAMPLE.format(runtime=RUNTIME),
    }
    licence = _licence()
    if licence is not None:
        texts["LICENSE"] = licence
    return (*written, *(_write(directory / name, text) for name, text in texts.items()))


def _require_built_in_law(model: ActuatorModel) -> None:
    magnetics = model.without_effects.magnetics
    if not isinstance(magnetics, LawMagnetics):
        return
    own = [law.name for law in BUILT_IN]
    if magnetics.law_name not in own:
        raise MissingPartError(
            f"Force law {magnetics.law_name!r} comes from another installed package and cannot be exported; the "
            f"export holds femfit's own laws: {', '.join(own)}. Fit one of them, or --model coenergy, and export that."
        )


def _require_built_in_effects(model: ActuatorModel) -> None:
    own = {effect.name for effect in (*BUILT_IN_EFFECTS, *BASE_AMPLITUDES)}
    foreign = [added.effect.name for added in model.effects if added.effect.name not in own]
    if foreign:
        raise MissingPartError(
            f"Effect {foreign[0]!r} comes from another installed package and cannot be exported; the export holds "
            "femfit's own effects. Export the model without it."
        )


def _require_free(directory: Path) -> None:
    if not directory.exists():
        return
    if not directory.is_dir():
        raise RunDirectoryError(f"{directory} must be a directory to export to; it is a file. Choose another name.")
    if any(directory.iterdir()) and not (directory / RUNTIME / "__init__.py").is_file():
        raise RunDirectoryError(
            f"{directory} must be absent, empty or an earlier export; it holds other files. Choose another directory."
        )


def _write_package(sources: tuple[SourceFile, ...], directory: Path) -> list[Path]:
    """Write the sources beside an earlier package, then put them in its place."""
    package, partial = directory / RUNTIME, directory / f".{RUNTIME}.partial"
    shutil.rmtree(partial, ignore_errors=True)
    files = [source.file_in_package for source in sources]
    for source, file in zip(sources, files, strict=True):
        _write(partial / file, renamed_imports(source.text, RUNTIME))
    if package.exists():
        shutil.rmtree(package)
    partial.rename(package)
    return [package / file for file in files]


def _write(path: Path, text: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    return path


def _licence() -> str | None:
    """Text of the licence that the installed femfit carries."""
    try:
        return distribution("femfit").read_text("licenses/LICENSE")
    except PackageNotFoundError:
        return None


_PYPROJECT = """\
[build-system]
requires = ["hatchling>=1.25"]
build-backend = "hatchling.build"

[project]
name = "{runtime}"
version = "{version}"
description = "Filters and a simulator for one electromagnetic actuator, exported by femfit."
readme = "README.md"
requires-python = ">=3.11"
license = "MIT"
dependencies = ["numpy>=2.0"]

[tool.hatch.build.targets.wheel]
packages = ["{runtime}"]
"""

_README = """\
# Estimator for {name}

Written by femfit {version}. It needs Python 3.11 and numpy, nothing else.

    python example.py

closes the loop around the simulated actuator (Hall sensor, filter, controller) and prints the distance held.

- `model.json`: force and flux linkage from one co-energy, circuit, motion and Hall sensor, with where they come from.
- `{runtime}.model.json_file.read_model(path)`: the model.
- `{runtime}.estimate`: `levitation.levitation_process(model)` tells a filter of the model;
  `unscented.UnscentedFilter(process)`, `square_root.SquareRootUnscentedFilter(process)` and
  `extended.ExtendedFilter(process)` run it: `start`, then `step(state, voltage, hall_voltage)` each sample.
- `{runtime}.simulate`: plant, sensor, controllers, closed loop.

The source is femfit's own; the next export into this directory replaces these files.
"""

_EXAMPLE = """\
\"\"\"Hold the body for 2000 samples with filter and controller on the simulated actuator; say where it hangs.\"\"\"

from pathlib import Path

import numpy as np

from {runtime}.model.json_file import read_model
from {runtime}.simulate.design import design_loop
from {runtime}.simulate.loop import ClosedLoop, run_loop
from {runtime}.simulate.plant import Plant
from {runtime}.simulate.reference import reference_steps
from {runtime}.simulate.sensor import SensorErrors

design = design_loop(read_model(Path(__file__).with_name("model.json")))
model, point = design.model, design.points[0]
reference = reference_steps([point.distance_m], 2000, model.sample_time_s, rate=10.0)
errors = SensorErrors(noise_V=design.noise_V)
loop = ClosedLoop(Plant(model), model.require_sensor(), errors, design.observer("ukf"), design.backstepping, reference)
start = np.array([[point.distance_m, 0.0, point.current_A]])
result = run_loop(loop, start, np.random.default_rng(0))
held = 1e3 * result.series.distance_m[1000:]
if result.held.all():
    print(f"wanted {{1e3 * point.distance_m:.3f}} mm, held {{held.mean():.3f}} mm +- {{held.std():.3f}} mm")
else:
    print(result.outcomes()[0].sentence)
"""
