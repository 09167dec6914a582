"""Each sentence of ``findings.toml`` has its facts, and a message about a column an option that a shell takes."""

import ast
import re
import shlex
import string
from itertools import pairwise
from pathlib import Path

import pytest

import femfit.tables
from femfit.core.errors import TableError
from femfit.tables.columns import column_option
from femfit.tables.findings import catalogue
from femfit.tables.measurement_file import read_measurement

ROOM = Path(femfit.tables.__file__).parent
TREES = {
    path.stem: ast.parse(text)
    for path in ROOM.parent.rglob("*.py")
    for text in [path.read_text(encoding="utf-8")]
    if path.is_relative_to(ROOM) or "from femfit.tables.findings import" in text
}
NODES = [(stem, node) for stem, tree in TREES.items() for node in ast.walk(tree)]
TEXTS = {node.value for _, node in NODES if isinstance(node, ast.Constant) and isinstance(node.value, str)}
ALWAYS = {"size", "column"}


def test_a_remark_has_its_sentence_and_its_facts():
    """Each call with a key as it stands; the facts behind ``**`` are not looked at."""
    every = 0
    for stem, node in NODES:
        name = getattr(getattr(node, "func", None), "attr", getattr(getattr(node, "func", None), "id", ""))
        if name in {"finding", "say", "refused"} and node.args and isinstance(node.args[0], ast.Constant):
            given, entry = {word.arg for word in node.keywords}, catalogue()[node.args[0].value]
            sentences = string.Formatter().parse(" ".join(entry.get(part, "") for part in ("text", "remedy")))
            needed = {name for _, name, _, _ in sentences if name} - ALWAYS
            assert needed <= given or None in given, (stem, node.lineno)
            assert given - ALWAYS - {None} <= needed, (stem, node.lineno)
            every += 1
    assert every > 100


def test_every_sentence_is_said_and_its_verb_agrees_with_its_number():
    heads = {text.partition(" ")[0] for text in TEXTS}
    plural = re.compile(r"\{\w+:\w+\|\w+\} (are|were|differ|stand)\b")
    for key, entry in catalogue().items():
        assert entry.get("severity", "info") in {"info", "warning", "error"}
        assert key in TEXTS or key.partition(" ")[0] in heads
        assert not plural.search(entry["text"]), key


HEADERS = ["CH1 voltage (V)", "Bob's coil [V]", 'the "old" coil [V]', "$V_out [V]", "100 % [V]", "U\\I [V]", "A=B"]


def options_in(message):
    """Header to column, as a shell takes them out of a message."""
    words = shlex.split(message[message.index("--column") :].rstrip("."))
    options = [after for option, after in pairwise(words) if option == "--column"]
    return dict(text.rpartition("=")[::2] for text in options)


@pytest.mark.parametrize("header", HEADERS)
def test_a_shell_reads_the_header_as_the_file_has_it(header, tmp_path):
    assert options_in(column_option(header, "voltage_V")) == {header: "voltage_V"}
    if '"' not in header:  # which would be a quoted cell
        path = tmp_path / "scope.csv"
        path.write_text("\n".join([f"Time (s),{header}", *(f"{1e-3 * k:g},{k % 3}" for k in range(9))]))
        with pytest.raises(TableError) as refused:
            read_measurement(path)
        options = options_in(str(refused.value))
        assert list(options) == [header]
        assert "voltage_V" in read_measurement(path, columns=options).given
