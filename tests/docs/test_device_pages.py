"""Every page about a device is run as a user would type it: commands, pictures and what it says is printed."""

import contextlib
import io
import re
import shlex
from pathlib import Path

import pytest

from support.command import worked
from support.snapshot import alike

ROOT = Path(__file__).parents[2]
BLOCK = re.compile(r"^```(\S*)[^\n]*\n(.*?)^```", flags=re.MULTILINE | re.DOTALL)
PAGES = sorted(path for path in (ROOT / "docs" / "devices").glob("*.md") if path.name != "index.md")


def session(page):
    """Blocks of commands and of Python in order, each with the block without a language that follows it, its output."""
    steps = []
    for language, text in BLOCK.findall(page.read_text(encoding="utf-8")):
        if language in {"console", "python"}:
            steps.append([language, text, ""])
        elif language == "" and steps and not steps[-1][2]:
            steps[-1][2] = text
    return steps


def printed_by(language, text, folder, names):
    """What a block prints in a folder; a command that fails raises."""
    out = io.StringIO()
    if language == "python":
        with contextlib.chdir(folder), contextlib.redirect_stdout(out):
            exec(text, names)  # noqa: S102 - the page's own text
        return out.getvalue()
    for line in re.sub(r"\\\n\s*", "", text).splitlines():
        name, *words = shlex.split(line.removeprefix("$ "), comments=True)
        assert name == "femfit", line
        out.write(worked(*words, cwd=folder).stdout)
    return out.getvalue()


def differing_lines(said, printed, tolerance):
    """Lines of a page that no line of the output equals in words, and in numbers within a tolerance."""
    lines = [line.strip() for line in printed.splitlines()]
    wanted = [line.strip() for line in said.splitlines() if line.strip() not in {"", "..."}]
    return [line for line in wanted if not any(alike(line, other, tolerance) for other in lines)]


@pytest.mark.nightly
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_page_about_a_device_says_what_happens(page, tmp_path):
    for folder in ("geometry", "data"):
        (tmp_path / folder).symlink_to(ROOT / folder)
    names = {}
    for language, text, said in session(page):
        printed = printed_by(language, text, tmp_path, names)
        assert differing_lines(said, printed, tolerance=0.1) == [], printed
    made = {path.name for path in tmp_path.glob("*.png")}
    shown = set(re.findall(r"[\w-]+\.png", page.read_text(encoding="utf-8")))
    assert shown == made
    assert all((page.parent / name).is_file() for name in shown)
