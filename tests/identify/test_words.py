"""The words of results stand in templates: each can be read, and each finding has its own."""

import re
from pathlib import Path

import pytest
from jinja2 import Environment, FileSystemLoader, nodes

import femfit
from femfit.identify.words import finding

ROOM = Path(femfit.__file__).parent / "identify"
CODE = "\n".join(path.read_text(encoding="utf-8") for path in ROOM.rglob("*.py"))
TEMPLATES = Environment(loader=FileSystemLoader(ROOM / "templates"))  # noqa: S701  plain text


def macros(template):
    tree = TEMPLATES.parse((ROOM / "templates" / template).read_text(encoding="utf-8"))
    return {macro.name for macro in tree.find_all(nodes.Macro)}


def test_every_template_is_printed_by_somebody():
    used = set(re.findall(r'(?:printed|sentence)\(\s*"(\w+)"', CODE)) | {"findings"}
    imported = {
        name
        for text in TEMPLATES.list_templates()
        for name in TEMPLATES.loader.get_source(TEMPLATES, text)[0].split('"')
    }
    assert {name for name in TEMPLATES.list_templates() if name[:-3] not in used and name not in imported} == set()


def test_every_finding_has_its_words():
    codes = set(re.findall(r'finding\(\s*"([\w-]+)"', CODE))
    other = set(re.findall(r'words="(\w+)"', CODE))
    assert len(codes) > 15
    assert macros("findings.j2") - {"rows"} == {code.replace("-", "_") for code in codes} | other


@pytest.mark.parametrize(("count", "text"), [(1, "1 row without"), (1200, "1,200 rows without")])
def test_a_finding_is_a_severity_a_text_and_a_remedy(count, text):
    remark = finding("no-setting", "distance_m", 3.0, rows=count)
    assert (remark.code, remark.severity, remark.column, remark.size, remark.remedy) == (
        "no-setting", "info", "distance_m", 3.0, "",
    )  # fmt: skip
    assert remark.text.startswith(text)
    assert "\n" not in finding("extrapolated", beyond=1, rows=2, limits=[(0.0, 1.0)], quadratic=True).text
    assert finding("no-noise").remedy.endswith("force_N=2e-4.")
