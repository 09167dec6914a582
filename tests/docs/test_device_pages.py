"""Every page about a device is run as a user would type it: commands, pictures and what it says is printed."""

import re
from pathlib import Path

import pytest

from support.pages import alike, differing_lines, run_step, steps_of

ROOT = Path(__file__).parents[2]
PAGES = sorted(path for path in (ROOT / "docs" / "devices").glob("*.md") if path.name != "index.md")


@pytest.mark.nightly
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_page_about_a_device_says_what_happens(page, tmp_path):
    for folder in ("geometry", "data"):
        (tmp_path / folder).symlink_to(ROOT / folder)
    names = {}
    for step in steps_of(page):
        printed = run_step(step, tmp_path, names)
        assert differing_lines(step.said, printed, tolerance=0.1) == [], printed
    made = {path.name for path in tmp_path.glob("*.png")}
    shown = set(re.findall(r"[\w-]+\.png", page.read_text(encoding="utf-8")))
    assert shown == made
    assert all((page.parent / name).is_file() for name in shown)


def test_a_session_is_read_and_run_from_its_blocks(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(
        "Text\n```console\n$ femfit new ball \\\n    -o b.toml\n```\nso\n```\nwritten: b.toml\n```\n```sh\nno\n```\n"
        "```python\nfrom pathlib import Path; print(Path('b.toml').read_text()[:1])\n```\n"
    )
    shell, code = steps_of(page)
    assert shell.said == "written: b.toml\n"
    assert "b.toml" in run_step(shell, tmp_path, {})
    assert run_step(code, tmp_path, {}) == "#\n"


def test_lines_differ_in_words_or_by_more_than_the_tolerance():
    assert alike("seats with 1.36 m/s", "seats with 1.40 m/s", 0.05)
    assert not alike("seats with 1.36 m/s", "seats with 1.60 m/s", 0.05)
    assert not alike("seats with 1.36 m/s", "hits with 1.36 m/s", 0.05)
    assert differing_lines("a 1\n...\nb 2", "b 2.0\nc", 0.1) == ["a 1"]
