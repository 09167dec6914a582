"""Results become JSON of numbers and codes, and two of them are compared."""

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from pathlib import Path

import numpy as np
import pandas as pd

EXPECTED = Path(__file__).parent / "expected"

KINDS = {
    "read": 1e-12,  # what a file says, in SI
    "algebra": 1e-9,  # closed formulae of stored coefficients: rounding, in another order of the terms
    "differences": 2e-5,  # femfit takes them by differences whose steps an exact derivative does not have
    "steps": 1e-8,  # steps of an integration or filter, in which rounding accumulates
    "settled": 1e-6,  # hundreds of steps, an iteration or an ODE solver to its own tolerance
    "fitted": 1e-6,  # least squares with a proven optimum
    "searched": 1e-4,  # an optimiser stops where its objective is flat: the square root of its tolerance
    "bits": 2e-2,  # means over noisy runs, in which rounding turns a bit of a converter, and that stays for a while
}
"""Relative tolerances; codes, counts and booleans are exact everywhere."""

FLOOR = 1e-3
"""Below this part of the largest number of an array an error counts against that part: zero crossings."""

_DROPPED = {"seconds", "sentence", "title", "words", "versions", "source", "directory", "made_by", "version"}
_AS_PARTS_OF_ONE = ("correlation", "probability", "p_value")
_INTERVALS = ("interval95", "ci95")


_WORDS = object()
"""In place of a text that is no code, and is left out."""


def frozen(value: object) -> object:
    """Numbers to 15 digits and codes; sentences are left out."""
    if isinstance(value, pd.DataFrame):
        value = {name: value[name].to_numpy() for name in value}
    elif is_dataclass(value):
        value = {one.name: getattr(value, one.name) for one in fields(value)}
    elif isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    elif isinstance(value, set | frozenset):
        value = sorted(value)
    if isinstance(value, Mapping):
        items = {str(key): frozen(one) for key, one in value.items() if key not in _DROPPED}
        return {key: one for key, one in items.items() if one is not _WORDS}
    if isinstance(value, list | tuple):
        return [one for one in map(frozen, value) if one is not _WORDS]
    if isinstance(value, str) and re.search(r"\s", value):
        return _WORDS
    if isinstance(value, complex):
        return [frozen(value.real), frozen(value.imag)]
    if isinstance(value, float):
        return float(f"{value:.15g}") if np.isfinite(value) else str(value)
    if value is None or isinstance(value, bool | int | str):
        return value.name if isinstance(value, Enum) else value
    raise TypeError(f"{type(value)} must be taken apart by door.py")


def write(name: str, result: object) -> None:
    """Store what a case gives, an array a line."""
    EXPECTED.mkdir(exist_ok=True)
    text = json.dumps(result, indent=1)
    text = re.sub(r"\[[^\[\]{}]*\]", lambda found: re.sub(r"\s+", " ", found[0]), text)  # innermost lists on one line
    (EXPECTED / f"{name}.json").write_text(text + "\n")


def read(name: str) -> object:
    """What is expected of a case; nothing where it is new."""
    file = EXPECTED / f"{name}.json"
    return json.loads(file.read_text()) if file.exists() else {}


def differences(old: object, new: object) -> Iterator[tuple[str, float, object, object]]:
    """Quantity, error over its tolerance (infinite of codes and shapes), old and new value: the largest of each array.

    The first level of a result names the kind of its numbers.
    """
    for kind in {**old, **new}:
        if kind in old and kind in new:
            yield from _compared(kind, old[kind], new[kind], KINDS[kind], 0.0)
        else:
            yield kind, np.inf, *("there" if kind in one else "absent" for one in (old, new))


def _compared(path: str, old: object, new: object, tolerance: float, width: float):
    if path.endswith(_INTERVALS) and _pair(old):
        width = old[1] - old[0]
    if isinstance(old, dict) and isinstance(new, dict):
        width = max([width, *(old[k][1] - old[k][0] for k in _INTERVALS if _pair(old.get(k)))])
        if path.endswith(_INTERVALS):
            old, new = ({f"{key}.interval95": one for key, one in both.items()} for both in (old, new))
        for key in {**old, **new}:
            if key in old and key in new:
                yield from _compared(
                    f"{path}.{key}", old[key], new[key], tolerance, max(width, key in _AS_PARTS_OF_ONE)
                )
            else:
                yield f"{path}.{key}", np.inf, *("there" if key in one else "absent" for one in (old, new))
    elif _numbers(old) and _numbers(new) and np.shape(old) == np.shape(new):
        yield from _of_numbers(path, np.array(old, dtype=float), np.array(new, dtype=float), tolerance, width)
    elif isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        for k, pair in enumerate(zip(old, new, strict=True)):
            yield from _compared(f"{path}[{k}]", *pair, tolerance, width)
    elif old != new or type(old) is not type(new):
        yield path, np.inf, old, new


def _of_numbers(path, old, new, tolerance, width):
    known = np.isfinite(old) & np.isfinite(new)
    if (np.isnan(old) != np.isnan(new)).any() or (old[~known & ~np.isnan(old)] != new[~known & ~np.isnan(old)]).any():
        yield path, np.inf, old.tolist(), new.tolist()
        return
    largest = np.abs(old[known]).max(initial=0.0)
    old, new = (np.where(known, one, 0.0) for one in (old, new))
    error = np.abs(new - old) / np.maximum(np.abs(old), max(FLOOR * largest, width, 1e-150))
    at = np.unravel_index(np.argmax(error), error.shape)
    if error[at] > 0.0:
        yield path, float(error[at] / tolerance), float(old[at]), float(new[at])


def _numbers(value: object) -> bool:
    """A float, or a full array of floats; integers are codes."""
    if isinstance(value, list):
        return bool(value) and all(map(_numbers, value)) and len({np.shape(one) for one in value}) == 1
    return isinstance(value, float) or value in ("nan", "inf", "-inf")


def _pair(value: object) -> bool:
    return isinstance(value, list) and len(value) == 2 and all(isinstance(one, float) for one in value)
