"""Which files of femfit a set of rooms needs, read from their import statements."""

import ast
import sys
from dataclasses import dataclass
from pathlib import Path

from femfit.core.errors import FemfitError

PACKAGE = "femfit"


@dataclass(frozen=True)
class SourceFile:
    """One module of femfit.

    Parameters
    ----------
    name : str
        Dotted, for example ``femfit.core.errors``; a package by its own name.
    """

    name: str
    path: Path
    text: str

    @property
    def file_in_package(self) -> Path:
        """Its file relative to the package's directory."""
        place = Path(*self.name.split(".")[1:])
        return place / "__init__.py" if self.path.name == "__init__.py" else place.with_suffix(".py")


def package_root() -> Path:
    """Directory of the running femfit."""
    return Path(__file__).resolve().parents[1]


def reachable_sources(rooms: tuple[str, ...], root: Path | None = None) -> tuple[SourceFile, ...]:
    """Every module of some rooms and all that they import of femfit, packages above them included.

    Parameters
    ----------
    root : Path or None
        Directory of the package; that of the running femfit where None.

    Raises
    ------
    FemfitError
        If a module imports a part of femfit that has no file.
    """
    root = package_root() if root is None else root
    waiting = [
        ".".join((PACKAGE, room, *file.relative_to(root / room).with_suffix("").parts))
        for room in rooms
        for file in (root / room).rglob("*.py")
    ]
    found: dict[str, SourceFile] = {}
    while waiting:
        name = waiting.pop().removesuffix(".__init__")
        if name in found:
            continue
        source = _read(name, root)
        found[name] = source
        if "." in name:
            waiting.append(name.rpartition(".")[0])
        own = (target for target in imported_modules(source.text) if target.partition(".")[0] == PACKAGE)
        waiting.extend(_module_of(target, root) for target in own)
    return tuple(found[name] for name in sorted(found))


def imported_modules(text: str) -> tuple[str, ...]:
    """Dotted names that a source imports: ``from a.b import c`` gives ``a.b.c``."""
    names: list[str] = []
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module is not None:
            names += [f"{node.module}.{alias.name}" for alias in node.names]
    return tuple(names)


def third_party_imports(sources: tuple[SourceFile, ...]) -> set[str]:
    """Top-level packages that sources import, other than femfit and the standard library."""
    tops = {name.partition(".")[0] for source in sources for name in imported_modules(source.text)}
    return {top for top in tops if top != PACKAGE and top not in sys.stdlib_module_names}


def renamed_imports(text: str, package: str) -> str:
    """The source with its imports of femfit pointed at another package name; nothing else changes."""
    lines = text.splitlines(keepends=True)
    for node in ast.walk(ast.parse(text)):
        names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        if any(name.partition(".")[0] == PACKAGE for name in names):
            row = node.lineno - 1  # type: ignore[attr-defined]  # both kinds of import have it
            lines[row] = lines[row].replace(PACKAGE, package, 1)
    return "".join(lines)


def _read(name: str, root: Path) -> SourceFile:
    place = root.joinpath(*name.split(".")[1:])
    path = place / "__init__.py" if place.is_dir() else place.with_suffix(".py")
    if not path.is_file():
        raise FemfitError(f"Module {name} is imported but {path} does not exist; install femfit again.")
    return SourceFile(name, path, path.read_text(encoding="utf-8"))


def _module_of(target: str, root: Path) -> str:
    """``femfit.room.file.Name`` and ``femfit.room.file`` are both the module ``femfit.room.file``."""
    place = root.joinpath(*target.split(".")[1:])
    return target if place.is_dir() or place.with_suffix(".py").is_file() else target.rpartition(".")[0]
