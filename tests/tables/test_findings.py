"""Each sentence of ``findings.toml`` is said with exactly the facts that fill it."""

import ast
import string
from pathlib import Path

import pytest

import femfit.tables
from femfit.tables.findings import catalogue, finding

ROOM = Path(femfit.tables.__file__).parent
TREES = {path: ast.parse(path.read_text(encoding="utf-8")) for path in ROOM.rglob("*.py")}
TEXTS = {node.value for tree in TREES.values() for node in ast.walk(tree) if isinstance(node, ast.Constant)}
ALWAYS = {"size", "column"}


def fields(key):
    """The facts that an entry's sentences need."""
    sentences = " ".join(catalogue()[key].get(name, "") for name in ("text", "remedy"))
    return {name for _, name, _, _ in string.Formatter().parse(sentences) if name} - ALWAYS


def calls():
    """Each call with a key as it stands, with the facts that it names; those behind ``**`` are not looked at."""
    for path, tree in TREES.items():
        for node in ast.walk(tree):
            name = getattr(getattr(node, "func", None), "attr", getattr(getattr(node, "func", None), "id", ""))
            if name in {"finding", "say"} and node.args and isinstance(node.args[0], ast.Constant):
                facts = {word.arg for word in node.keywords}
                yield pytest.param(node.args[0].value, facts, id=f"{path.stem}:{node.lineno}")


@pytest.mark.parametrize(("key", "facts"), list(calls()))
def test_a_remark_has_its_sentence_and_its_facts(key, facts):
    assert fields(key) <= facts | ALWAYS or None in facts
    assert facts - ALWAYS - {None} <= fields(key)


def test_no_sentence_is_said_by_nobody():
    assert {entry.get("severity", "info") for entry in catalogue().values()} <= {"info", "warning", "error"}
    heads = {text.partition(" ")[0] for text in TEXTS if isinstance(text, str)}
    assert [key for key in catalogue() if key not in TEXTS and key.partition(" ")[0] not in heads] == []


def test_a_count_has_its_noun_and_verb():
    assert [finding("loose-lines", lines=n).text.split()[:2] for n in (1, 2)] == [["1", "line"], ["2", "lines"]]
