"""The words of results stand in templates: each can be read, and each finding has its own."""

import re
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, nodes

import femfit

ROOM = Path(femfit.__file__).parent / "identify"
CODE = "\n".join(path.read_text(encoding="utf-8") for path in ROOM.rglob("*.py"))
TEMPLATES = Environment(loader=FileSystemLoader(ROOM / "templates"))  # noqa: S701  plain text


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
    tree = TEMPLATES.parse((ROOM / "templates" / "findings.j2").read_text(encoding="utf-8"))
    macros = {macro.name for macro in tree.find_all(nodes.Macro)}
    assert macros - {"rows"} == {code.replace("-", "_") for code in codes} | other
