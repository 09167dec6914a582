"""Exact decimals: what the file writes in mm is the nearest double in m, and 0.2 * 3 is 0.6.

A grid is a key of the sweep table; it must come out the same on every machine and in every language.
"""

from collections.abc import Sequence
from decimal import Decimal
from itertools import pairwise
from typing import Any

from femfit.device.schema import MAX_AXIS_POINTS, Entry, RangeEntry


def scaled(value: float, exponent: int = -3) -> float:
    """The double nearest to value * 10^exponent, as from mm to m, the value taken with the digits that print it."""
    return float(Decimal(repr(float(value))).scaleb(exponent))


_IN_SI = {"mm": ("m", -3), "ms": ("s", -3), "g": ("kg", -3), "mH": ("H", -3), "MS": ("S", 6), "MJ": ("J", 6)}
"""SI unit and power of ten of the words in keys that are not in SI units."""


def si_key(key: str) -> tuple[str, int]:
    """Name of a key's value in SI units, and the power of ten to it: ``stiffness_N_per_mm`` is in N/m times 10^3."""
    words, power = key.split("_"), 0
    for place, word in enumerate(words[1:], 1):
        words[place], exponent = _IN_SI.get(word, (word, 0))
        power += -exponent if words[place - 1] == "per" else exponent
    return "_".join(words), power


def in_si(entry: Entry, *without: str) -> dict[str, Any]:
    """The values of an entry by their names in SI units, lists as tuples, without some keys."""
    values = {}
    for key in type(entry).model_fields.keys() - {*without}:
        name, power = si_key(key)
        values[name] = _in_si(getattr(entry, key), power)
    return values


def _in_si(value: Any, power: int) -> Any:
    if isinstance(value, list):
        return tuple(_in_si(each, power) for each in value)
    return scaled(value, power) if power and value is not None else value


def axis_values(axis: RangeEntry | Sequence[float], path: str, problems: list[str]) -> tuple[float, ...]:
    """The ascending values of an axis, in the file's unit; none where they are unusable."""
    if isinstance(axis, RangeEntry):
        return _stepped(axis, path, problems)
    values = tuple(map(float, axis))
    for before, after in pairwise(values):
        if after <= before:
            what = "repeats" if after == before else "follows"
            problems.append(f"{path} must be ascending without repeats; {after:g} {what} {before:g}. Sort the list.")
            return ()
    return values


def _stepped(axis: RangeEntry, path: str, problems: list[str]) -> tuple[float, ...]:
    start, stop, step = (Decimal(repr(float(v))) for v in (axis.start, axis.stop, axis.step))
    if stop <= start:
        problems.append(not_above(path, axis.start, axis.stop))
    elif (stop - start) / step > MAX_AXIS_POINTS - 1:
        problems.append(
            f"{path} must have at most {MAX_AXIS_POINTS} values; {axis.start:g} to {axis.stop:g} by {axis.step:g} "
            "has more. Take a larger step."
        )
    elif start + (count := round((stop - start) / step)) * step != stop:
        problems.append(
            f"{path} must have a step that divides its range; {axis.step:g} does not divide "
            f"{axis.start:g} to {axis.stop:g}. End it at {float(start + count * step):g}, or change the step."
        )
    else:
        return tuple(float(start + k * step) for k in range(count + 1))
    return ()


def not_above(path: str, start: float, stop: float) -> str:
    """The sentence on a range whose end is not above its start."""
    return (
        f"{path} must have stop > start; it has start = {start:g} and stop = {stop:g}. Exchange them, or give a list "
        "for a single value."
    )


def decimal_sum(offset: float, factor: float, value: float) -> float:
    """The double nearest to offset + factor * value, all three taken with the digits that print them."""
    first, second, third = (Decimal(repr(float(number))) for number in (offset, factor, value))
    return float(first + second * third)
