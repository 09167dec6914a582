"""Currents and distances of the sweep and frequencies of the solver, as an actuator file gives them."""

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
        first, *others_A = self.currents_A or ((0.0,),)
        return SweepAxes(first, tuple(scaled(d) for d in self.distances_mm), tuple(others_A))


def read_axes(data: Mapping[str, Any], circuits: Sequence[str], problems: list[str]) -> FileAxes:
    """The axes of a file with these circuits."""
    sweep = data.get("sweep")
    if not isinstance(sweep, dict):
        return FileAxes((), ())
    entries = sweep.get("current_A")
    several = isinstance(entries, dict) and not entries.keys() <= RangeEntry.model_fields.keys()
    without = not any(coil_tables(data))
    if several or without:  # what stands in its place passes the check of the other keys
        read_table(SweepEntry, sweep | {"current_A": [0.0]}, "sweep", problems)
    else:
        read_table(SweepEntry, sweep, "sweep", problems)
    distances = read_part(DistanceAxis, sweep)
    distances_mm = axis_values(distances.distance_mm, "sweep.distance_mm", problems) if distances else ()
    if distances_mm and distances_mm[0] < MIN_DISTANCE and data.get("schema") == 1:
        problems.append(
            f"sweep.distance_mm must be > 0, the gap from face to face; it starts at {distances_mm[0]:g}. "
            f"Start at {MIN_DISTANCE:g} mm or more, or write schema = 2 for a body that passes the face."
        )
    if several and isinstance(entries, dict):
        return FileAxes(_by_circuit(entries, circuits, problems), distances_mm)
    if without:
        return FileAxes((), distances_mm)
    if len(circuits) > 1:
        problems.append(
            f"sweep.current_A must give the currents of each circuit; there are {', '.join(circuits)}. Write "
            f"current_A = {{ {circuits[0]} = [0, 1], {circuits[1]} = [0, 1] }}."
        )
    currents = read_part(CurrentAxis, sweep)
    return FileAxes((axis_values(currents.current_A, "sweep.current_A", problems),) if currents else (), distances_mm)


def _by_circuit(
    currents: Mapping[str, Any], circuits: Sequence[str], problems: list[str]
) -> tuple[tuple[float, ...], ...]:
    unknown = [name for name in currents if name not in circuits]
    problems += [
        f"{joined('sweep.current_A', name)} must name a circuit.{did_you_mean(name, circuits)} "
        f"Known: {', '.join(circuits) or 'none'}."
        for name in unknown
    ]
    missing = [name for name in circuits if name not in currents]
    problems += [f"{joined('sweep.current_A', name)} is missing. Give the circuit's currents." for name in missing]
    axes = []
    for name in circuits:
        if name not in currents:
            continue
        path = joined("sweep.current_A", name)
        count = len(problems)
        entry = read_table(CurrentAxis, {"current_A": currents[name]}, "", problems)
        problems[count:] = [problem.replace("current_A", path, 1) for problem in problems[count:]]
        if entry is not None:
            axes.append(axis_values(entry.current_A, path, problems))
    return tuple(axes)


_DIGITS = 9
"""Significant digits of a frequency between the ends of a range, the same on every machine."""


def frequencies(entry: SolverEntry | None, problems: list[str]) -> tuple[float, ...]:
    """The ascending frequencies in Hz; those of a range are equally spaced in their logarithm, both ends included."""
    path = "solver.frequency_Hz"
    frequencies = entry.frequency_Hz if entry is not None else None
    if frequencies is None:
        return ()
    if not isinstance(frequencies, FrequencyRangeEntry):
        return axis_values(frequencies, path, problems)
    if frequencies.stop <= frequencies.start:
        problems.append(
            f"{path} must have stop > start; it has start = {frequencies.start:g} and stop = {frequencies.stop:g}. "
            "Exchange them, or give a list for a single value."
        )
        return ()
    # A range of no whole number of steps gets a step more, not wider ones
    steps = math.ceil(round(frequencies.per_decade * math.log10(frequencies.stop / frequencies.start), _DIGITS))
    if steps >= MAX_FREQUENCIES:
        problems.append(
            f"{path} must have at most {MAX_FREQUENCIES} values; it has {steps + 1}. Give fewer per_decade."
        )
        return ()
    between = (frequencies.start * (frequencies.stop / frequencies.start) ** (k / steps) for k in range(1, steps))
    return (frequencies.start, *(float(f"{value:.{_DIGITS}g}") for value in between), frequencies.stop)


def eddy_bias(entry: SolverEntry | None, circuits: int, problems: list[str]) -> tuple[float, ...]:
    """The currents in A about which eddy currents are linearised; empty where the file gives none."""
    bias = entry.eddy_bias_A if entry is not None else None
    if bias is None:
        return ()
    values = tuple(bias) if isinstance(bias, list) else (bias,)
    if len(values) != circuits:
        problems.append(
            f"solver.eddy_bias_A must have a current for each of the {circuits} circuits; it has {len(values)}. Give a "
            "list in their order."
        )
    return values
