"""Frequencies of the solver, as an actuator file gives them."""

import math

from femfit.device.decimals import axis_values
from femfit.device.schema_solver import MAX_FREQUENCIES, FrequencyRangeEntry, SolverEntry

_DIGITS = 9
"""Significant digits of a frequency between the ends of a range, the same on every machine."""


def frequencies(entry: SolverEntry | None, problems: list[str]) -> tuple[float, ...]:
    """The ascending frequencies in Hz; those of a range are equally spaced in their logarithm, both ends included."""
    path = "solver.frequency_Hz"
    given = entry.frequency_Hz if entry is not None else None
    if given is None:
        return ()
    if not isinstance(given, FrequencyRangeEntry):
        return axis_values(given, path, problems)
    if given.stop <= given.start:
        problems.append(
            f"{path} must have stop > start; it has start = {given.start:g} and stop = {given.stop:g}. "
            "Exchange them, or give a list for a single value."
        )
        return ()
    # A range of no whole number of steps gets a step more, not wider ones
    steps = math.ceil(round(given.per_decade * math.log10(given.stop / given.start), _DIGITS))
    if steps >= MAX_FREQUENCIES:
        problems.append(
            f"{path} must have at most {MAX_FREQUENCIES} values; it has {steps + 1}. Give fewer per_decade."
        )
        return ()
    between = (given.start * (given.stop / given.start) ** (k / steps) for k in range(1, steps))
    return (given.start, *(float(f"{one:.{_DIGITS}g}") for one in between), given.stop)


def eddy_bias(entry: SolverEntry | None, circuits: int, problems: list[str]) -> tuple[float, ...]:
    """The currents in A about which eddy currents are linearised; empty where the file gives none."""
    given = entry.eddy_bias_A if entry is not None else None
    if given is None:
        return ()
    found = tuple(given) if isinstance(given, list) else (given,)
    if len(found) != circuits:
        problems.append(
            f"solver.eddy_bias_A must have a current for each of the {circuits} circuits; it has {len(found)}. Give a "
            "list in their order."
        )
    return found
