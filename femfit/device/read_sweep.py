"""Currents and distances of the sweep and frequencies of the solver, as an actuator file gives them."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from femfit.device.complaints import did_you_mean, joined, read_list, read_table
from femfit.device.decimals import axis_values, not_above, scaled
from femfit.device.drawing import coil_tables
from femfit.device.parts import SweepAxes
from femfit.device.schema import AXIS_VALUES, RangeEntry, SweepEntry
from femfit.device.schema_device import FREQUENCIES, MAX_FREQUENCIES, FrequencyRangeEntry, SolverEntry

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


def read_axis(value: object, path: str, key: str, problems: list[str]) -> tuple[float, ...]:
    """The ascending values of an axis given as a list or as { start, stop, step }; none if unusable."""
    remedy = SweepEntry.model_fields[key].description or ""
    if isinstance(value, dict):
        entry = read_table(RangeEntry, value, path, problems)
        return () if entry is None else axis_values(entry, path, problems)
    if isinstance(value, list):
        return axis_values(read_list(AXIS_VALUES, value, path, remedy, problems), path, problems)
    problems.append(
        f"{path} must be a list of numbers or a table {{ start, stop, step }}; it is {str(value)[:60]!r}. {remedy}"
    )
    return ()


def read_axes(data: Mapping[str, Any], circuits: Sequence[str], problems: list[str]) -> FileAxes:
    """The axes of a file with these circuits."""
    sweep = data.get("sweep")
    if not isinstance(sweep, dict):
        return FileAxes((), ())
    currents, without = sweep.get("current_A"), not any(coil_tables(data))
    read_table(SweepEntry, ({"current_A": []} if without else {}) | sweep, "sweep", problems)
    axes, each = [], isinstance(currents, dict) and not currents.keys() <= RangeEntry.model_fields.keys()
    if isinstance(currents, dict) and each:
        axes = _by_circuit(currents, circuits, problems)
    elif "current_A" in sweep and not without:
        if len(circuits) > 1:
            problems.append(
                f"sweep.current_A must give the currents of each circuit; there are {', '.join(circuits)}. Write "
                f"current_A = {{ {circuits[0]} = [0, 1], {circuits[1]} = [0, 1] }}."
            )
        axes = [read_axis(currents, "sweep.current_A", "current_A", problems)]
    distances_mm: tuple[float, ...] = ()
    if "distance_mm" in sweep:
        distances_mm = read_axis(sweep["distance_mm"], "sweep.distance_mm", "distance_mm", problems)
    if distances_mm and distances_mm[0] < MIN_DISTANCE and data.get("schema") == 1:
        problems.append(
            f"sweep.distance_mm must be > 0, the gap from face to face; it starts at {distances_mm[0]:g}. "
            f"Start at {MIN_DISTANCE:g} mm or more, or write schema = 2 for a body that passes the face."
        )
    return FileAxes(tuple(axes), distances_mm)


def _by_circuit(currents: Mapping[str, Any], circuits: Sequence[str], problems: list[str]) -> list[tuple[float, ...]]:
    problems += [
        f"{joined('sweep.current_A', name)} must name a circuit.{did_you_mean(name, circuits)} "
        f"Known: {', '.join(circuits) or 'none'}."
        for name in currents
        if name not in circuits
    ]
    missing = [name for name in circuits if name not in currents]
    problems += [f"{joined('sweep.current_A', name)} is missing. Give the circuit's currents." for name in missing]
    paths = {name: joined("sweep.current_A", name) for name in circuits if name in currents}
    return [read_axis(currents[name], path, "current_A", problems) for name, path in paths.items()]


_DIGITS = 9
"""Significant digits of a frequency between the ends of a range, the same on every machine."""


def frequencies(entry: SolverEntry | None, problems: list[str]) -> tuple[float, ...]:
    """The ascending frequencies in Hz; those of a range are equally spaced in their logarithm, both ends included."""
    path = "solver.frequency_Hz"
    axis = entry.frequency_Hz if entry is not None else None
    if axis is None:
        return ()
    if not isinstance(axis, dict):
        remedy = SolverEntry.model_fields["frequency_Hz"].description or ""
        return axis_values(read_list(FREQUENCIES, axis, path, remedy, problems), path, problems)
    frequencies = read_table(FrequencyRangeEntry, axis, path, problems)
    if frequencies is None:
        return ()
    if frequencies.stop <= frequencies.start:
        problems.append(not_above(path, frequencies.start, frequencies.stop))
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
