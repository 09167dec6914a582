"""Every page about a device is run as a user would type it: commands, pictures and what it says is printed."""

import contextlib
import io
import os
import re
import shlex
from dataclasses import dataclass
from pathlib import Path

import pytest

from support.command import femfit
from support.snapshot import alike

ROOT = Path(__file__).parents[2]
BLOCK = re.compile(r"^```(\S*)[^\n]*\n(.*?)^```", flags=re.MULTILINE | re.DOTALL)
PAGES = sorted(path for path in (ROOT / "docs" / "devices").glob("*.md") if path.name != "index.md")


@dataclass(frozen=True)
class Step:
    """One block of commands or of Python, and the block of output that follows it, empty where none does."""

    language: str
    text: str
    said: str = ""


def steps_of(page: Path) -> list[Step]:
    """The session of a page, in order; a block without a language right after one of commands is their output."""
    steps: list[Step] = []
    for language, text in BLOCK.findall(page.read_text(encoding="utf-8")):
        if language in {"console", "python"}:
            steps.append(Step(language, text))
        elif language == "" and steps and not steps[-1].said:
            steps[-1] = Step(steps[-1].language, steps[-1].text, text)
    return steps


def run_step(step: Step, folder: Path, names: dict[str, object]) -> str:
    """What a block prints in a folder; a command that fails raises."""
    if step.language == "python":
        home, out = Path.cwd(), io.StringIO()
        os.chdir(folder)
        try:
            with contextlib.redirect_stdout(out):
                exec(step.text, names)  # noqa: S102 - the page's own text
        finally:
            os.chdir(home)
        return out.getvalue()
    printed = ""
    for line in re.sub(r"\\\n\s*", "", step.text).splitlines():
        name, *words = shlex.split(line.removeprefix("$ "), comments=True)
        assert name == "femfit", line
        done = femfit(*words, cwd=folder)
        assert done.returncode == 0, f"{line}\n{done.stderr}"
        printed += done.stdout
    return printed


def differing_lines(said: str, printed: str, tolerance: float) -> list[str]:
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
    for step in steps_of(page):
        printed = run_step(step, tmp_path, names)
        assert differing_lines(step.said, printed, tolerance=0.1) == [], printed
    made = {path.name for path in tmp_path.glob("*.png")}
    shown = set(re.findall(r"[\w-]+\.png", page.read_text(encoding="utf-8")))
    assert shown == made
    assert all((page.parent / name).is_file() for name in shown)
