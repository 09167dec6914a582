"""Which files of femfit a program needs, read from the import statements."""

import ast
import sys
from collections.abc import Iterable
from pathlib import Path

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
