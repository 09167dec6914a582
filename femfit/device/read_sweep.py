"""Currents and distances of the sweep, as an actuator file gives them.

Frequencies of the solver, as an actuator file gives them.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from femfit.device.complaints import did_you_mean, joined, read_part, read_table
from femfit.device.decimals import axis_values, scaled
from femfit.device.drawing import coil_tables
from femfit.device.parts import SweepAxes
from femfit.device.schema import CurrentAxis, DistanceAxis, RangeEntry, SweepEntry
from femfit.device.schema_device import MAX_FREQUENCIES, FrequencyRangeEntry, SolverEntry

MIN_DISTANCE = 1e-3
"""In mm, of schema 1: a micrometre is less than a face is flat, and still a gap that can be meshed."""


@dataclass(frozen=True)
class FileAxes:
    """The axes in the file's units; empty where they are unusable."""

    currents_A: tuple[tuple[float, ...], ...]  # One axis a circuit
    distances_mm: tuple[float, ...]

    def in_si(self) -> SweepAxes:
        """The sweep's grid; an actuator without a circuit has the one current of zero."""
        first, *further = self.currents_A or ((0.0,),)
        return SweepAxes(first, tuple(scaled(d) for d in self.distances_mm), tuple(further))


def read_axes(data: Mapping[str, Any], circuits: Sequence[str], problems: list[str]) -> FileAxes:
    """The axes of a file with these circuits."""
    sweep = data.get("sweep")
    if not isinstance(sweep, dict):
        return FileAxes((), ())
    given = sweep.get("current_A")
    several = isinstance(given, dict) and not given.keys() <= RangeEntry.model_fields.keys()
    without = not any(coil_tables(data))
    if several or without:  # what stands in its place passes the check of the other keys
        read_table(SweepEntry, sweep | {"current_A": [0.0]}, "sweep", problems)
    else:
        read_table(SweepEntry, sweep, "sweep", problems)
    distances = read_part(DistanceAxis, sweep)
    at = axis_values(distances.distance_mm, "sweep.distance_mm", problems) if distances else ()
    if at and at[0] < MIN_DISTANCE and data.get("schema") == 1:
        problems.append(
            f"sweep.distance_mm must be > 0, the gap from face to face; it starts at {at[0]:g}. "
            f"Start at {MIN_DISTANCE:g} mm or more, or write schema = 2 for a body that passes the face."
        )
    if several and isinstance(given, dict):
        return FileAxes(_by_circuit(given, circuits, problems), at)
    if without:
        return FileAxes((), at)
    if len(circuits) > 1:
        problems.append(
            f"sweep.current_A must give the currents of each circuit; there are {', '.join(circuits)}. Write "
            f"current_A = {{ {circuits[0]} = [0, 1], {circuits[1]} = [0, 1] }}."
        )
    currents = read_part(CurrentAxis, sweep)
    return FileAxes((axis_values(currents.current_A, "sweep.current_A", problems),) if currents else (), at)


def _by_circuit(
    given: Mapping[str, Any], circuits: Sequence[str], problems: list[str]
) -> tuple[tuple[float, ...], ...]:
    unknown = [name for name in given if name not in circuits]
    problems += [
        f"{joined('sweep.current_A', name)} must name a circuit.{did_you_mean(name, circuits)} "
        f"Known: {', '.join(circuits) or 'none'}."
        for name in unknown
    ]
    missing = [name for name in circuits if name not in given]
    problems += [f"{joined('sweep.current_A', name)} is missing. Give the circuit's currents." for name in missing]
    axes = []
    for name in circuits:
        if name not in given:
            continue
        path = joined("sweep.current_A", name)
        found = len(problems)
        entry = read_table(CurrentAxis, {"current_A": given[name]}, "", problems)
        problems[found:] = [problem.replace("current_A", path, 1) for problem in problems[found:]]
        if entry is not None:
            axes.append(axis_values(entry.current_A, path, problems))
    return tuple(axes)


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
