"""Export a model as a self-contained package with filters and a simulator, which needs numpy alone.

The package is femfit's own source, copied file by file with only the package's name changed in the import statements,
so that no formula exists twice and its numbers are femfit's numbers. It holds what its example imports; the catalogues
of laws and effects list those of the model.

Which files of femfit a program needs, read from the import statements.
"""

import ast
import shutil
import sys
from collections.abc import Iterable
from importlib.metadata import PackageNotFoundError, distribution
from importlib.resources import files
from pathlib import Path

from femfit import __version__
from femfit.core.errors import MissingPartError, RunDirectoryError
from femfit.effects import catalogue as effects
from femfit.estimate.levitation import chosen_sensors
from femfit.laws import catalogue as laws
from femfit.model.actuator_model import ActuatorModel
from femfit.model.json_file import write_model
from femfit.model.magnetics import LawMagnetics

PACKAGE = "femfit"
ROOT = Path(__file__).resolve().parents[1]


def reachable_sources(program: str, unused: Iterable[str] = ()) -> dict[Path, str]:
    """Text of every file of femfit that a program imports, directly or through others, by its place in the package.

    The package's own front is left out, and so are ``unused`` constants of the catalogues.
    """
    names = frozenset(unused)
    found: dict[Path, str] = {}
    waiting = _own_modules(program)
    while waiting:
        name = waiting.pop()
        file = _file_of(name)
        if file in found or name == PACKAGE:
            continue
        text = (ROOT / file).read_text(encoding="utf-8")
        found[file] = without_imports(text, names) if name.endswith(".catalogue") else text
        waiting += [name.rpartition(".")[0], *_own_modules(found[file])]
    return dict(sorted(found.items()))


def imported_modules(text: str) -> tuple[str, ...]:
    """Dotted names that a source imports when it runs: ``from a.b import c`` gives ``a.b.c``."""
    names: list[str] = []
    waiting: list[ast.AST] = [ast.parse(text)]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module is not None:
            names += [f"{node.module}.{alias.name}" for alias in node.names]
        elif isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            waiting += node.orelse
        else:
            waiting += ast.iter_child_nodes(node)
    return tuple(names)


def third_party_imports(texts: Iterable[str]) -> set[str]:
    """Top-level packages that sources import, other than femfit and the standard library."""
    tops = {name.partition(".")[0] for text in texts for name in imported_modules(text)}
    return {top for top in tops if top != PACKAGE and top not in sys.stdlib_module_names}


def renamed_imports(text: str, package: str) -> str:
    """The source with its imports of femfit pointed at another package name; nothing else changes."""
    lines = text.splitlines(keepends=True)
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import | ast.ImportFrom):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else [node.module or ""]
            if any(name.partition(".")[0] == PACKAGE for name in names):
                lines[node.lineno - 1] = lines[node.lineno - 1].replace(PACKAGE, package, 1)
    return "".join(lines)


def without_imports(text: str, names: frozenset[str]) -> str:
    """A catalogue without some of its members: their import lines, and the lines that list them, are left out."""
    lines: list[str | None] = list(text.splitlines(keepends=True))
    for node in ast.parse(text).body:
        if isinstance(node, ast.ImportFrom) and any(one.name in names for one in node.names):
            kept = [one.name for one in node.names if one.name not in names]
            lines[node.lineno - 1 : node.end_lineno] = [None] * ((node.end_lineno or node.lineno) - node.lineno + 1)
            lines[node.lineno - 1] = f"from {node.module} import {', '.join(kept)}\n" if kept else None
    gone = {f"    {name},\n" for name in names}
    return "".join(line for line in lines if line is not None and line not in gone)


def _own_modules(text: str) -> list[str]:
    """``femfit.room.file.Name`` and ``femfit.room.file`` are both the module ``femfit.room.file``."""
    targets = [name for name in imported_modules(text) if name.partition(".")[0] == PACKAGE]
    return [name if (ROOT / _file_of(name)).is_file() else name.rpartition(".")[0] for name in targets]


def _file_of(name: str) -> Path:
    """A module's place in the package's directory."""
    place = Path(*name.split(".")[1:])
    return place / "__init__.py" if (ROOT / place).is_dir() else place.with_suffix(".py")


RUNTIME = "femfit_runtime"
NEW, OLD = f".{RUNTIME}.partial", f".{RUNTIME}.old"
"""What an export that was interrupted leaves behind; the next one takes it away."""

RUN_TIME_DEPENDENCIES = frozenset({"numpy"})


def export_estimator(model: ActuatorModel, directory: Path) -> tuple[Path, ...]:
    """Write the package, the model, a description and an example."""
    if len(model.circuits) < 2:
        model.require_circuit()  # there is nothing to control without a winding
    model.require_motion()
    chosen_sensors(model, None)
    _require_built_in_law(model)
    _require_built_in_effects(model)
    model.require_dynamics()
    directory = Path(directory)
    _require_free(directory)
    texts = _texts(model)
    new = directory / NEW
    shutil.rmtree(new, ignore_errors=True)
    absent = not directory.exists()
    try:
        new.mkdir(parents=True)  # refused where somebody laid a link in its place
        for name, text in texts.items():
            (new / name).parent.mkdir(parents=True, exist_ok=True)
            (new / name).write_text(text, encoding="utf-8")
        write_model(model, new / "model.json")
        _put_in_place(new, directory)
    except OSError as error:
        place = str(error.filename or directory).replace(str(new), str(directory))  # a full disk names no file
        raise OSError(error.errno, error.strerror, place) from error
    finally:
        shutil.rmtree(new, ignore_errors=True)
        if absent and directory.exists() and not any(directory.iterdir()):
            directory.rmdir()
    return tuple(directory / name for name in (*texts, "model.json"))


def _texts(model: ActuatorModel) -> dict[str, str]:
    """Every file but the model's, by its name in the directory."""
    example = Path(__file__).with_name("estimator_example.py").read_text(encoding="utf-8")
    sources = reachable_sources(example, _unused(model))
    foreign = third_party_imports(sources.values()) - RUN_TIME_DEPENDENCIES
    if foreign:
        raise MissingPartError(
            f"The exported rooms may import numpy alone; this femfit's import {', '.join(sorted(foreign))}. "
            "Install an unmodified femfit."
        )
    words = {"name": model.name, "runtime": RUNTIME, "version": __version__}
    words |= {"sensors": ", ".join(chosen_sensors(model, None)), "circuits": ", ".join(model.circuit_names)}
    readme = files("femfit.targets").joinpath("estimator_readme.md").read_text(encoding="utf-8")
    texts = {f"{RUNTIME}/__init__.py": _FRONT.format(**words)}
    texts |= {f"{RUNTIME}/{file.as_posix()}": renamed_imports(text, RUNTIME) for file, text in sources.items()}
    texts |= {"README.md": readme.format(**words), "pyproject.toml": _PYPROJECT.format(**words)}
    texts["example.py"] = renamed_imports(example, RUNTIME)
    licence = _licence()
    return texts if licence is None else texts | {"LICENSE": licence}


def _unused(model: ActuatorModel) -> set[str]:
    """Constants of the catalogues' modules that the model does not name."""
    magnetics = model.without_effects.magnetics
    used = {added.effect.name for added in model.effects}
    if isinstance(magnetics, LawMagnetics):
        used.add(magnetics.law_name)
    return {
        constant
        for catalogue in (effects, laws)
        for constant, item in vars(catalogue).items()
        if constant.isupper() and any(item is member for member in catalogue.BUILT_IN) and item.name not in used
    }


def _require_built_in_law(model: ActuatorModel) -> None:
    magnetics = model.without_effects.magnetics
    if not isinstance(magnetics, LawMagnetics):
        return
    own = [law.name for law in laws.BUILT_IN]
    if magnetics.law_name not in own:
        raise MissingPartError(
            f"Force law {magnetics.law_name!r} comes from another installed package and cannot be exported; the "
            f"export holds femfit's own laws: {', '.join(own)}. Fit one of them, or --model coenergy, and export that."
        )


def _require_built_in_effects(model: ActuatorModel) -> None:
    own = {effect.name for effect in effects.BUILT_IN}
    foreign = [
        added.effect.name for added in model.effects if added.effect.name not in own and added.effect.carried is None
    ]
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
    earlier = any((directory / name).exists() for name in (f"{RUNTIME}/__init__.py", NEW, OLD))
    if any(directory.iterdir()) and not earlier:
        raise RunDirectoryError(
            f"{directory} must be absent, empty or an earlier export; it holds other files. Choose another directory."
        )


def _put_in_place(new: Path, directory: Path) -> None:
    """Replace an earlier export; at each moment its package, the new one or the aside one says that it is an export."""
    package, old = directory / RUNTIME, directory / OLD
    shutil.rmtree(old, ignore_errors=True)
    if package.exists():
        package.rename(old)
    (new / RUNTIME).rename(package)
    for file in new.iterdir():
        file.replace(directory / file.name)
    shutil.rmtree(old, ignore_errors=True)


def _licence() -> str | None:
    """Text of the licence that the installed femfit carries."""
    try:
        return distribution("femfit").read_text("licenses/LICENSE")
    except PackageNotFoundError:
        return None


_FRONT = '''"""Filters and a simulator for one electromagnetic actuator, exported by femfit."""

__version__ = "{version}"
'''

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
