"""A page of the documentation as a session at a shell: its commands, and what it says that they print."""

import re
from dataclasses import dataclass
from pathlib import Path

BLOCK = re.compile(r"^```(\w*)\n(.*?)^```", flags=re.MULTILINE | re.DOTALL)
NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")


@dataclass(frozen=True)
class Step:
    """One block of commands and the block of output that follows it, empty where none does."""

    commands: tuple[str, ...]
    printed: str


def steps_of(page: Path) -> list[Step]:
    """The session of a page, in order; a block without a language right after commands is their output."""
    steps: list[Step] = []
    for language, text in BLOCK.findall(page.read_text(encoding="utf-8")):
        if language == "console":
            lines = re.sub(r"\\\n\s*", "", text).splitlines()
            steps.append(Step(tuple(line.removeprefix("$ ") for line in lines if line.startswith("$ ")), ""))
        elif language == "" and steps and not steps[-1].printed:
            steps[-1] = Step(steps[-1].commands, text)
    return steps


def differing_lines(said: str, printed: str, tolerance: float) -> list[str]:
    """Lines of a page that no line of the output equals in words, and in numbers within a tolerance."""
    lines = [line.strip() for line in printed.splitlines()]
    wanted = [line.strip() for line in said.splitlines() if line.strip() not in {"", "..."}]
    return [line for line in wanted if not any(alike(line, other, tolerance) for other in lines)]


def alike(line: str, other: str, tolerance: float) -> bool:
    """Whether two lines have the same words, and numbers within a relative tolerance."""
    if NUMBER.sub("#", line) != NUMBER.sub("#", other):
        return False
    pairs = zip(map(float, NUMBER.findall(line)), map(float, NUMBER.findall(other)), strict=True)
    return all(abs(a - b) <= tolerance * max(abs(a), abs(b)) for a, b in pairs)
