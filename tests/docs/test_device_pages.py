"""Every page about a device is run as a user would type it: commands, pictures and what it says is printed."""

import shlex
from pathlib import Path

import pytest

from support.command import femfit
from support.pages import alike, differing_lines, steps_of

ROOT = Path(__file__).parents[2]
PAGES = sorted(path for path in (ROOT / "docs" / "devices").glob("*.md") if path.name != "index.md")


@pytest.mark.long
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_page_about_a_device_says_what_happens(page, tmp_path):
    for folder in ("geometry", "data"):
        (tmp_path / folder).symlink_to(ROOT / folder)
    for step in steps_of(page):
        printed = ""
        for command in step.commands:
            name, *words = shlex.split(command)
            assert name == "femfit", command
            done = femfit(*words, cwd=tmp_path)
            assert done.returncode == 0, f"{command}\n{done.stderr}"
            printed += done.stdout
        assert differing_lines(step.printed, printed, tolerance=0.1) == [], printed
    pictures = {path.name for path in tmp_path.rglob("*.png")}
    shown = {path.name for path in (ROOT / "docs" / "devices").glob(f"{page.stem}-*.png")}
    assert shown <= pictures


def test_a_session_is_read_from_its_blocks(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(
        "Text\n```console\n$ femfit new ball \\\n    -o b.toml\n```\nso\n```\nwritten: b.toml\n```\n```sh\nno\n```\n"
    )
    (step,) = steps_of(page)
    assert step.commands == ("femfit new ball -o b.toml",)
    assert step.printed == "written: b.toml\n"


def test_lines_differ_in_words_or_by_more_than_the_tolerance():
    assert alike("seats with 1.36 m/s", "seats with 1.40 m/s", 0.05)
    assert not alike("seats with 1.36 m/s", "seats with 1.60 m/s", 0.05)
    assert not alike("seats with 1.36 m/s", "hits with 1.36 m/s", 0.05)
    assert differing_lines("a 1\n...\nb 2", "b 2.0\nc", 0.1) == ["a 1"]
