"""Drawings, right and wrong: what the actuator becomes, or where it is refused and with what facts.

``drawings/NAME.expected.json`` holds the cases of ``drawings/NAME.toml``, of the project's geometry, or of a starter
of that name. What a case asks for: ``edits`` of the text, of which each old one stands there once; files ``beside`` it;
its ``text`` in place of it; whether it is ``read`` as a table of variants; the ``paths`` of what is looked up in the
actuator (in each variant). What comes out: their values, or the class of the error with the key of each of its problems
(``at``); ``mentions`` are the facts that its message names. ``<<c*n>>`` is a character n times.
"""

import re
from dataclasses import fields
from pathlib import Path

import pytest

from femfit.core.errors import FemfitError
from femfit.device.load import starter_text
from femfit.device.rewrite import read_variants
from support.actuators import GEOMETRY
from support.expected import cases, rounded, unmentioned, written_out

DRAWINGS = Path(__file__).parent / "drawings"
ASKED = ("read", "edits", "beside", "text", "paths", "mentions")


def drawing(case, stem):
    if "text" in case:
        return written_out(case["text"]).encode("latin-1")
    stored = [path for path in (DRAWINGS / f"{stem}.toml", GEOMETRY / f"{stem}.toml") if path.exists()]
    text = stored[0].read_text(encoding="utf-8") if stored else starter_text(stem)
    for old, new in case.get("edits", {}).items():
        assert text.count(old) == 1, f"{old!r} must occur once"
        text = text.replace(old, new)
    return text.encode()


def looked_up(thing, path):
    """What stands at a path like ``coils[*].turns``."""
    for k, step in enumerate(steps := re.findall(r"\w+|\*", path)):
        if step == "*":
            return [looked_up(one, ".".join(steps[k + 1 :])) for one in thing]
        thing = thing[int(step)] if step.isdigit() else getattr(thing, step)
    return plain(thing)


def plain(thing):
    """Parts of a device as dictionaries without what is left at nothing."""
    if isinstance(thing, list | tuple):
        return [plain(one) for one in thing]
    if hasattr(thing, "__dataclass_fields__"):
        values = {name: plain(getattr(thing, name)) for name in (field.name for field in fields(thing))}
        return {"kind": type(thing).__name__} | {name: value for name, value in values.items() if value is not None}
    return thing


def outcome(case, path):
    """The facts of a case, and the text of its message, problems or remarks."""
    paths = case.get("paths", ())
    try:
        swept = read_variants(path)
    except FemfitError as error:
        for problem in error.problems:
            assert problem.endswith((".", "?")) or "Nearest" in problem
        at = [problem.split()[0] for problem in error.problems]
        return {"error": type(error).__name__, "at": at}, "\n".join(error.problems)
    if case.get("read") != "variants":
        return {"values": {key: looked_up(swept.actuator, key) for key in paths}}, "\n".join(swept.remarks)
    built = [{key: looked_up(one.actuator, key) for key in paths} if one.actuator else None for one in swept.variants]
    result = {"columns": swept.columns, "rows": [one.values for one in swept.variants], "values": built}
    return result, "\n".join([*swept.remarks, *(one.problem for one in swept.variants)])


@pytest.mark.parametrize(("path", "name"), cases(DRAWINGS))
def test_a_drawing_is_read_or_refused_as_expected(path, name, expected, tmp_path):
    case = expected.read(path)[name]
    for beside, text in case.get("beside", {}).items():
        (tmp_path / beside).parent.mkdir(exist_ok=True)
        (tmp_path / beside).write_text(text, encoding="utf-8")
    (tmp_path / "actuator.toml").write_bytes(drawing(case, path.name.partition(".")[0]))
    result, text = outcome(case, tmp_path / "actuator.toml")
    lacking = unmentioned(case.get("mentions", ()), text)
    assert not lacking, f"no {lacking} in {text}"
    expected.case(path, name, ASKED, rounded(result))
