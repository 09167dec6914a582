"""Numbers, names, lists and comments of an actuator file that is written."""

import json
import re
from collections.abc import Iterator, Sequence
from decimal import Decimal
from itertools import pairwise

EXACT = 17
"""Digits that print a double without loss: the sweep must hold the file's own point."""


def written_list(key: str, items: Sequence[str], remark: str = "") -> Iterator[str]:
    """A key with a list, on one line or six items a line."""
    if len(items) <= 6:
        yield f"{key} = [{', '.join(items)}]{remark}"
        return
    yield f"{key} = [{remark}"
    yield from (f"  {', '.join(items[k : k + 6])}," for k in range(0, len(items), 6))
    yield "]"


def axis(values: Sequence[float]) -> str:
    """A grid as a range where it is one, else as a list."""
    exact = [Decimal(repr(float(value))) for value in values]
    steps = {after - before for before, after in pairwise(exact)}
    if len(values) > 3 and len(steps) == 1:
        start, stop, step = (number(value, EXACT) for value in (values[0], values[-1], float(steps.pop())))
        return f"{{ start = {start}, stop = {stop}, step = {step} }}"
    return f"[{', '.join(number(value, EXACT) for value in values)}]"


def number(value: float, digits: int = 12) -> str:
    """The shortest text of a number with so many significant digits; whole numbers without a point."""
    rounded = float(f"{value:.{digits}g}") + 0.0
    return str(int(rounded)) if rounded.is_integer() and abs(rounded) < 1e15 else repr(rounded)


def free_name(name: str, taken: set[str]) -> str:
    """A region's name from a block's: letters, digits, - and _, beginning with a letter, not yet taken."""
    stem = re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")[:50]
    stem = stem if re.match(r"[a-z]", stem) else f"part_{stem}".rstrip("_")
    free = next(
        candidate for n in range(1, len(taken) + 2) if (candidate := stem if n == 1 else f"{stem}_{n}") not in taken
    )
    taken.add(free)
    return free


def string(text: str) -> str:
    """A TOML basic string."""
    return json.dumps(text, ensure_ascii=False)


def plain(text: str) -> str:
    """On one line of a comment."""
    return "".join(character if character.isprintable() else " " for character in text)
