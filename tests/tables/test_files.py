"""Files as laboratories and programs write them, right and wrong, and what the readers make of each.

``files/NAME.expected.json`` holds the cases of ``files/NAME.*``. What a case asks for: ``read`` and ``options``;
``lines`` in place of the file, ``edits`` of its text, files ``beside`` it, the name that it has (``as``), its
``encoding``; ``each`` holds variants that must all come out alike. ``<<c*n>>`` is a character n times. What comes out:
a few ``values`` of each column in SI, the codes of the findings (``noted`` where there is nothing to do), or the class
of the error; ``mentions`` are the facts that its message names.
"""

from pathlib import Path

import numpy as np
import pytest

from femfit.core.errors import FemfitError
from femfit.tables.coil_record import open_coil_record
from femfit.tables.foreign import import_table
from femfit.tables.measurement_file import read_measurement
from femfit.tables.sweep_table import read_sweep_table
from support.expected import cases, rounded, unmentioned, written_out

FILES = Path(__file__).parent / "files"
ASKED = ("read", "options", "lines", "edits", "beside", "as", "encoding", "each", "mentions")
READERS = {"bench": read_measurement, "foreign": import_table, "sweep": read_sweep_table}
FILLED_IN = ("run", "order", "mount", "branch", "segment", "current_A")
LONGEST_MESSAGE = 1100


def placed(case, stem, folder):
    """The file of a case in a folder of its own."""
    encoding = case.get("encoding", "utf-8")
    stored = next((path for path in FILES.glob(f"{stem}.*") if not path.name.endswith(".expected.json")), None)
    name = case.get("as", stored.name if stored else "table.csv")
    for beside, text in case.get("beside", {}).items():
        (folder / beside).write_text(written_out(text), encoding="utf-8")
    if "lines" in case:
        content = "\n".join([*case["lines"], ""]).encode(encoding)
    else:
        content = stored.read_bytes() if stored else b""
    for old, new in case.get("edits", {}).items():
        assert old.encode(encoding) in content, old
        content = content.replace(old.encode(encoding), written_out(new).encode(encoding))
    if (stored is not None or "lines" in case) and name != "no.csv":
        (folder / name).write_bytes(content)
    return folder / name


def without_notes(result):
    """What variants have in common: where each says what it concluded, the remarks differ."""
    return {key: value for key, value in result.items() if key != "noted"}


def few(values):
    """All of a few values, or four of many."""
    places = range(len(values)) if len(values) <= 6 else np.linspace(0, len(values) - 1, 4).astype(int)
    return [values[k] for k in places]


def facts(result):
    """What a reader made of a file, for JSON."""
    if not hasattr(result, "rows"):
        blocks = list(result.blocks())
        columns = {name: [getattr(block, name) for block in blocks] for name in ("time", "voltage", "hall", "current")}
        joined = {name: np.concatenate(parts) for name, parts in columns.items() if parts and parts[0] is not None}
        return {"rows": sum(map(len, blocks)), "values": {name: few(x.tolist()) for name, x in joined.items()}}
    rows = result.rows
    is_measured = hasattr(result, "given")
    names = result.given if is_measured else [name for name in rows if name != "force_error_N"]
    every = {"reader": type(result).__name__, "rows": len(rows)}
    every |= {"valid": len(result.valid_rows())} if hasattr(result, "valid_rows") else {}
    every |= {"files": len(result.manifest["sources"])} if hasattr(result, "dialects") else {}
    names = [*names, *(name for name in FILLED_IN if is_measured and name in rows)]
    every["values"] = {name: few(rows[name].tolist()) for name in names}
    about = {key: getattr(result, key, "") for key in ("declared_noise", "test_object", "notes")}
    every |= {key: value for key, value in about.items() if value}
    findings = [one for one in getattr(result, "findings", ()) if one.code != "noise"]
    for key, serious in (("findings", True), ("noted", False)):
        codes = {f"{one.code} {one.column}".strip() for one in findings if (one.severity != "info") is serious}
        every |= {key: sorted(codes)} if codes else {}
    return every


def outcome(case, stem, folder):
    """The facts of a case and the text of its message or findings."""
    folder.mkdir()
    path = placed(case, stem, folder)
    options = case.get("options", {})
    try:
        if case["read"] == "coil":
            result = facts(open_coil_record(path, **options))
            return rounded(result), ""
        read = READERS[case["read"]](path, **options)
    except FemfitError as error:
        message = str(error)
        assert len(message) < LONGEST_MESSAGE
        assert "\x1b" not in message
        return {"error": type(error).__name__}, message
    return rounded(facts(read)), "\n".join(map(str, getattr(read, "findings", ())))


@pytest.mark.parametrize(("path", "name"), cases(FILES))
def test_a_file_is_read_or_refused_as_expected(path, name, expected, tmp_path):
    case, stem = expected.read(path)[name], path.name.partition(".")[0]
    results = []
    for k, variant in enumerate(case.get("each", [{}])):
        result, text = outcome(case | variant, stem, tmp_path / str(k))
        lacking = unmentioned([*case.get("mentions", ()), *variant.get("mentions", ())], text)
        assert not lacking, f"{variant}: no {lacking} in {text}"
        assert without_notes(result) == without_notes((results or [result])[0]), variant
        results.append(result)
    expected.case(path, name, ASKED, results[0])
