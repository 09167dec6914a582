"""Which files of femfit a program needs, read from the import statements."""

import ast
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from femfit.core.errors import FemfitError

PACKAGE = "femfit"


@dataclass(frozen=True)
class SourceFile:
    """One module of femfit; ``name`` is dotted, for example ``femfit.core.errors``."""

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


def reachable_sources(program: str, unused: Iterable[str] = ()) -> tuple[SourceFile, ...]:
    """Every module of femfit that a program imports, directly or through others, without the package's own front."""
    unused = frozenset(unused)
    found: dict[str, SourceFile] = {}
    waiting = list(_own_modules(program))
    while waiting:
        name = waiting.pop()
        if name in found or name == PACKAGE:
            continue
        source = _read(name)
        if name.endswith(".catalogue"):
            source = SourceFile(name, source.path, without_imports(source.text, unused))
        found[name] = source
        waiting += [name.rpartition(".")[0], *_own_modules(source.text)]
    return tuple(found[name] for name in sorted(found))


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


def third_party_imports(sources: Iterable[SourceFile]) -> set[str]:
    """Top-level packages that sources import, other than femfit and the standard library."""
    tops = {name.partition(".")[0] for source in sources for name in imported_modules(source.text)}
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
    gone = {f"    {name},\n" for name in names}
    kept = [line for line in text.splitlines(keepends=True) if line not in gone]
    return "".join(
        line for line in kept if not (line.startswith("from ") and line.strip().rpartition(" import ")[2] in names)
    )


def _own_modules(text: str) -> list[str]:
    return [_module_of(name) for name in imported_modules(text) if name.partition(".")[0] == PACKAGE]


def _module_of(target: str) -> str:
    """``femfit.room.file.Name`` and ``femfit.room.file`` are both the module ``femfit.room.file``."""
    place = package_root().joinpath(*target.split(".")[1:])
    return target if place.is_dir() or place.with_suffix(".py").is_file() else target.rpartition(".")[0]


def _read(name: str) -> SourceFile:
    place = package_root().joinpath(*name.split(".")[1:])
    path = place / "__init__.py" if place.is_dir() else place.with_suffix(".py")
    if not path.is_file():
        raise FemfitError(f"Module {name} is imported but {path} does not exist; install femfit again.")
    return SourceFile(name, path, path.read_text(encoding="utf-8"))
