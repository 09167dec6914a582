"""Orders what is equal up to rounding as it was given, so that no result depends on the processor's last bit."""

from collections.abc import Callable, Sequence
from typing import TypeVar

Item = TypeVar("Item")

ROUNDING = 1e-6
"""Relative difference below which two computed numbers are one: the last steps of a solver change as much."""


def first_best(values: Sequence[float], least: float = 0.0) -> int:
    """Index of the first value that equals the largest up to rounding."""
    largest = max(values)
    slack = max(ROUNDING * abs(largest), least)
    return next(k for k, value in enumerate(values) if value >= largest - slack)


def ranked(items: Sequence[Item], value: Callable[[Item], float], least: float = 0.0) -> list[Item]:
    """Items with the largest value first; those that are equal up to rounding stay in the order given."""
    left, values, result = list(items), [value(item) for item in items], []
    while left:
        best = first_best(values, least)
        result.append(left.pop(best))
        values.pop(best)
    return result
