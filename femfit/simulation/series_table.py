"""Recorded runs of a loop as a table: one row a sample, up to the sample at which a run was lost."""

from pathlib import Path

import numpy as np

from femfit.core import atomic
from femfit.simulation.design import LoopDesign
from femfit.simulation.loop import LoopResult


def command_columns(design: LoopDesign) -> list[str]:
    """Names of the commands in a table: by the circuit's name where there are several."""
    circuits = design.model.circuits
    kinds = [("command", "A") if circuit.drive.kind == "current" else ("voltage", "V") for circuit in circuits]
    if len(circuits) == 1:
        return ["_".join(kinds[0])]
    return [f"{kind}_{circuit.name}_{unit}" for (kind, unit), circuit in zip(kinds, circuits, strict=True)]


def current_columns(design: LoopDesign) -> list[str]:
    """Names of the currents in a table."""
    circuits = design.model.circuits
    return ["current_A"] if len(circuits) == 1 else [f"current_{circuit.name}_A" for circuit in circuits]


def reading_columns(design: LoopDesign) -> list[str]:
    """Names of the readings in a table: those of a record, from which any filter takes them."""
    readings = [sensor.reading for sensor in design.loop_sensors()]
    return [
        reading.column or f"{reading.name}_{reading.unit.replace('/', '_').replace('^', '')}" for reading in readings
    ]


def series_columns(design: LoopDesign) -> list[str]:
    """Names of all columns after the run and the time; what no sensor gives is named as the truth or an estimate."""
    return [
        *command_columns(design),
        *(f"true_{name}" for name in (*current_columns(design), "distance_m")),
        *reading_columns(design),
        "reference_m",
        "estimated_distance_m",
        "estimated_velocity_m_s",
        *(f"estimated_{name}" for name in current_columns(design)),
    ]


def write_series(design: LoopDesign, result: LoopResult, path: str | Path) -> None:
    """Write the recorded runs of a loop."""
    series, rows = result.series, []
    for run in range(series.distance_m.shape[1]):
        alive = np.flatnonzero(np.isfinite(series.distance_m[:, run]))
        columns = [
            series.commands,
            series.currents_A,
            series.distance_m[..., None],
            series.readings,
            series.reference_m[..., None],
            series.estimated_distance_m[..., None],
            series.estimated_velocity_m_s[..., None],
            series.estimated_currents_A,
        ]
        head = np.stack([np.full(len(alive), run + 1.0), result.time_s[alive]], axis=1)
        rows.append(np.concatenate([head, *(column[alive, run] for column in columns)], axis=1))
    names = ("run", "time_s", *series_columns(design))
    table = np.concatenate(rows) if rows else np.empty((0, len(names)))
    with atomic.replacing(path) as partial:
        formats = ["%d"] + ["%.9g"] * (len(names) - 1)
        np.savetxt(partial, table, delimiter=",", header=",".join(names), comments="", fmt=formats)
