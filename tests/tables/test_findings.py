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
SOURCES = {path: path.read_text(encoding="utf-8") for path in ROOM.parent.rglob("*.py")}
TREES = {
    path: ast.parse(text)
    for path, text in SOURCES.items()
    if path.is_relative_to(ROOM) or "from femfit.tables.findings import" in text
}
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
            if name in {"finding", "say", "refused"} and node.args and isinstance(node.args[0], ast.Constant):
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


def test_a_verb_agrees_with_its_number():
    plural = re.compile(r"\{\w+:\w+\|\w+\} (are|were|differ|stand)\b")
    assert not [key for key, entry in catalogue().items() if plural.search(entry["text"])]


HEADERS = ["CH1 voltage (V)", "Bob's coil [V]", 'the "old" coil [V]', "$V_out [V]", "100 % [V]", "U\\I [V]", "A=B"]


def options_in(message):
    """Header to column, as a shell and the command line take them out of a message."""
    words = shlex.split(message[message.index("--column") :].rstrip("."))
    options = [after for option, after in pairwise(words) if option == "--column"]
    return dict(text.rpartition("=")[::2] for text in options)


def refusal(read, path):
    with pytest.raises(TableError) as refused:
        read(path)
    return options_in(str(refused.value))


@pytest.mark.parametrize("header", HEADERS)
def test_a_shell_reads_the_header_as_the_file_has_it(header, tmp_path):
    assert options_in(column_option(header, "voltage_V")) == {header: "voltage_V"}
    if '"' not in header:  # which would be a quoted cell
        path = tmp_path / "scope.csv"
        path.write_text("\n".join([f"Time (s),{header}", *(f"{1e-3 * k:g},{k % 3}" for k in range(9))]))
        options = refusal(read_measurement, path)
        assert list(options) == [header]
        assert "voltage_V" in read_measurement(path, columns=options).given


def test_a_column_that_is_not_used_is_offered_where_its_words_say_what_it_may_be(tmp_path):
    path = tmp_path / "bench.csv"
    path.write_text("distance_mm,current_A,Kraft ges. [N],note\n" + "".join(f"{k},1,{k},x\n" for k in range(2, 6)))
    assert refusal(read_measurement, path) == {"Kraft ges. [N]": "force_N"}
    table = read_measurement(
        path, columns={"note": "force_N", "Kraft ges. [N]": "hall_V"}, units={"Kraft ges. [N]": "V"}
    )
    assert "unused-column" not in {one.code for one in table.findings}
