"""From a sweep's results to its table and manifest, and what it came to in a few numbers."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from femfit.core.results import listing
from femfit.core.sweep_columns import VARIANT, current_columns, flux_columns, pickup_column, sweep_columns
from femfit.core.text import counted
from femfit.device.drawn_numbers import DrawnNumber
from femfit.device.electrics import PickupCoil
from femfit.device.load import sweep_manifest_entry
from femfit.device.parts import Actuator
from femfit.device.rewrite import VariantSweep
from femfit.field.point_rows import NO_CONVERGENCE, UNSOLVED, swept_currents
from femfit.field.tolerance import scale
from femfit.tables.signatures import Signatures
from femfit.tables.sweep_table import SweepTable, current_names

if TYPE_CHECKING:
    import pandas as pd

Result = Mapping[str, Any]
REMEDIES = {
    NO_CONVERGENCE: "Check the B-H curve for kinks, or sweep the current in smaller steps.",
    UNSOLVED: "Look there for a narrow gap or a thin sliver of a part, move the distance a little, or leave it out.",
}
"""What to do about points that were not solved, by their status."""

NEWTON_COLUMNS = ("newton_iterations", "newton_residual")
"""Columns of actuators with saturating parts alone."""


def sweep_rows(sweep: VariantSweep, results: Mapping[tuple[int, float], Result]) -> "pd.DataFrame":
    """The rows of a sweep, by variant, current and distance; the parameters' columns last.

    Results are by number of the variant, from 1, and distance in m: ``status``, and ``rows`` where there are any.
    """
    import pandas as pd  # noqa: PLC0415  loads while the workers solve

    circuits = [circuit.name for circuit in sweep.actuator.circuits]
    pickups = [sensor.name for sensor in sweep.actuator.sensors if isinstance(sensor, PickupCoil)]
    columns, frames = sweep_columns(circuits, pickups), []
    for number, variant in enumerate(sweep.variants, 1):
        parameters = {VARIANT: number, **dict(zip(sweep.columns, variant.values, strict=True))} if sweep.columns else {}
        points = swept_currents(variant.sweep)
        for distance in variant.sweep.distances_m:
            settings = dict(zip(current_columns(circuits), points.T, strict=True))
            settings["distance_m"] = np.full(len(points), distance)
            result = results[number, distance]
            solved = {
                name: np.array(values, dtype=np.float64) if None in values else values
                for name, values in result.get("rows", {}).items()
            }
            frames.append(pd.DataFrame({**settings, "status": result["status"], **solved, **parameters}))
    rows = pd.concat(frames, ignore_index=True)
    axes, optional = [VARIANT, *sweep.columns] if sweep.columns else [], {*NEWTON_COLUMNS, "hall_T"}
    optional.update(map(pickup_column, pickups))
    columns = [name for name in columns if name not in optional or (name in rows and rows[name].notna().any())]
    rows = rows.reindex(columns=[*columns, *axes])
    return rows.sort_values([*axes[:1], *current_columns(circuits), "distance_m"], kind="stable", ignore_index=True)


def signatures_of(
    sweep: VariantSweep, results: Mapping[tuple[int, float], Result], numbers: Sequence[DrawnNumber]
) -> Signatures:
    """What the results of a sweep without parameters say of the drawing's numbers."""
    import pandas as pd  # noqa: PLC0415  loads while the workers solve

    actuator, points = sweep.actuator, swept_currents(sweep.actuator.sweep)
    circuits = [circuit.name for circuit in actuator.circuits]
    slopes = ["force_N", *flux_columns(circuits), *(["hall_T"] if actuator.hall is not None else [])]
    columns = ["number", *current_columns(circuits), "distance_m", *slopes]
    keys, frames = [number.facts.key for number in numbers], []
    for distance in actuator.sweep.distances_m:
        signatures = results[1, distance].get("signatures")
        if signatures is not None:
            values = np.array(signatures, dtype=np.float64).swapaxes(0, 1).reshape(-1, len(slopes))
            settings = np.repeat(keys, len(points)), *np.tile(points.T, len(keys)), np.full(len(values), distance)
            frames.append(pd.DataFrame(dict(zip(columns, (*settings, *values.T), strict=True))))
    rows = pd.concat(frames, ignore_index=True) if frames else pd.DataFrame(columns=columns)
    order = pd.Categorical(rows["number"], keys, ordered=True)
    rows = rows.assign(number=order).sort_values(
        ["number", *columns[1 : -len(slopes)]], kind="stable", ignore_index=True
    )
    return Signatures(tuple(number.facts for number in numbers), rows.assign(number=rows["number"].astype(str)))


def sweep_manifest(sweep: VariantSweep, configuration: Mapping[str, Any]) -> dict[str, Any]:
    """The manifest of a sweep.

    Returns
    -------
    dict
        JSON-ready; ``inputs`` is the whole actuator, and ``variants`` has what each variant's model needs beside its
        rows.
    """

    def described(actuator: Actuator | None) -> dict[str, Any]:
        if actuator is None:
            return {"actuator": None, "inputs": None}
        return {"actuator": sweep_manifest_entry(actuator), "inputs": asdict(actuator)}

    manifest = {
        "kind": "sweep",
        "name": sweep.actuator.name,
        **described(sweep.actuator),
        "settings": configuration["settings"],
        "versions": configuration["versions"],
        "configuration_hash": configuration["hash"],
    }
    if not sweep.columns:
        return manifest
    variants = [
        {VARIANT: number, **dict(zip(sweep.columns, variant.values, strict=True)), **described(variant.actuator)}
        for number, variant in enumerate(sweep.variants, 1)
    ]
    return manifest | {"parameters": list(sweep.columns), "variants": variants}


def summarise(table: SweepTable) -> dict[str, Any]:
    """Rows, failures, range of the force and of its estimated error.

    Returns
    -------
    dict
        JSON-ready; the relative error is of the force or, where that is larger, of the force of the weakest currents
        at the same distance, or of their force at the distance before or after if its sign is another, and of a
        hundredth of the largest force at the same distance at least: a force that crosses or stays at zero is no
        measure. Forces are None if every row failed. ``points_beyond_bh_curve`` and, with
        a tolerance, which knows one distance only, ``rows_beyond_tolerance`` where they apply.
    """
    status = table.rows["status"]
    good = table.valid_rows()
    failures = {str(reason): int(count) for reason, count in status[status != "ok"].value_counts().items()}
    scales = _scales(good)
    relative = _relative_errors(good, scales.combine(_near_force(good), max))
    tolerance = table.manifest.get("settings", {}).get("tolerance")
    notes = {name: table.manifest[name] for name in ("points_beyond_bh_curve",) if name in table.manifest}
    if tolerance is not None:
        notes["rows_beyond_tolerance"] = int((_relative_errors(good, scales) > tolerance).sum())
    return {
        "rows": len(table.rows),
        "failed": len(table.rows) - len(good),
        "failures": failures,
        "force_min_N": float(good["force_N"].min()) if len(good) else None,
        "force_max_N": float(good["force_N"].max()) if len(good) else None,
        "force_error_relative_max": float(relative.max()) if len(relative) else 0.0,
        **notes,
    }


def failed_points(table: SweepTable) -> list[str]:
    """What failed, where, and what to do about it, a sentence or two for each reason."""
    rows, lines, currents = table.rows, [], current_names(table.rows)
    for reason, failed in rows[rows["status"] != "ok"].groupby("status", sort=False):
        text = f"{counted(len(failed), 'point')} {str(reason).removesuffix('.')}"
        if len(failed) < len(rows) and VARIANT not in rows:
            text += f"; at {listing(f'{1e3 * place:g} mm' for place in failed['distance_m'].unique())}"
            points = failed[currents].drop_duplicates()
            if len(points) < len(rows[currents].drop_duplicates()):
                amperes = (", ".join(f"{i:g}" for i in point) for point in points.to_numpy())
                text += f" with {listing(f'{point} A' for point in amperes)}"
        lines.append(f"{text}. {REMEDIES.get(str(reason), '')}".rstrip())
    return lines


def variants_without_a_point(table: SweepTable) -> list[int]:
    """Numbers of the variants every row of which failed; none where the sweep has no parameters."""
    if VARIANT not in table.rows:
        return []
    solved = (table.rows["status"] == "ok").groupby(table.rows[VARIANT]).any()
    return [int(number) for number in solved.index[~solved]]


def _near_force(rows: "pd.DataFrame") -> "pd.Series[float]":
    """Each row's force; beside a change of sign along the distance, the largest of it and those of another sign."""
    keys = [*(name for name in (VARIANT,) if name in rows), *current_names(rows)]
    forces = rows.sort_values("distance_m", kind="stable").groupby(keys)["force_N"]
    size = rows["force_N"].abs()
    for step in (1, -1):
        neighbour = forces.shift(step).reindex(rows.index)
        size = size.mask(rows["force_N"] * neighbour <= 0.0, size.combine(neighbour.abs(), max))
    return size


def _scales(rows: "pd.DataFrame") -> "pd.Series[float]":
    """What an error of each row's force is relative to, at its distance: :func:`femfit.field.tolerance.scale`."""
    scales = rows["force_N"].abs()
    for _, here in rows.groupby([name for name in (VARIANT, "distance_m") if name in rows]):
        scales[here.index] = scale(here["force_N"].to_numpy(), here[current_names(here)].to_numpy())
    return scales


def _relative_errors(rows: "pd.DataFrame", scales: "pd.Series[float]") -> "pd.Series[float]":
    return (rows["force_error_N"] / scales)[scales > 0.0]
