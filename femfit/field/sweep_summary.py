"""What a sweep came to, in a few numbers."""

from typing import TYPE_CHECKING, Any

from femfit.core.sweep_columns import VARIANT
from femfit.tables.sweep_table import SweepTable

if TYPE_CHECKING:
    import pandas as pd

SMALL_FORCE = 0.01
"""Of the largest force at the same distance: a force below it is a passage through zero (conventional)."""


def summarise(table: SweepTable) -> dict[str, Any]:
    """Rows, failures, range of the force and of its estimated error.

    Returns
    -------
    dict
        JSON-ready; the relative error is of the force or, where that is larger, of the force of the weakest current at
        the same distance, or of that current's force at the distance before or after if its sign is another, and of a
        hundredth of the largest force at the same distance at least: a force that crosses or stays at zero is no
        measure. Forces are None if every row failed. ``points_beyond_bh_curve`` and, with
        a tolerance, which knows one distance only, ``rows_beyond_tolerance`` where they apply.
    """
    status = table.rows["status"]
    good = table.valid_rows()
    failures = {str(reason): int(count) for reason, count in status[status != "ok"].value_counts().items()}
    relative = _relative_errors(good, _near_force(good))
    tolerance = table.manifest.get("settings", {}).get("tolerance")
    notes = {name: table.manifest[name] for name in ("points_beyond_bh_curve",) if name in table.manifest}
    if tolerance is not None:
        strict = _relative_errors(good, good["force_N"].abs())
        notes["rows_beyond_tolerance"] = int((strict > tolerance).sum())
    return {
        "rows": len(table.rows),
        "failed": len(table.rows) - len(good),
        "failures": failures,
        "force_min_N": float(good["force_N"].min()) if len(good) else None,
        "force_max_N": float(good["force_N"].max()) if len(good) else None,
        "force_error_relative_max": float(relative.max()) if len(relative) else 0.0,
        **notes,
    }


def _near_force(rows: "pd.DataFrame") -> "pd.Series[float]":
    """Each row's force; beside a change of sign along the distance, the largest of it and those of another sign."""
    keys = [name for name in (VARIANT, "current_A") if name in rows]
    forces = rows.sort_values("distance_m", kind="stable").groupby(keys)["force_N"]
    size = rows["force_N"].abs()
    for step in (1, -1):
        other = forces.shift(step).reindex(rows.index)
        size = size.mask(rows["force_N"] * other <= 0.0, size.combine(other.abs(), max))
    return size


def _relative_errors(rows: "pd.DataFrame", size: "pd.Series[float]") -> "pd.Series[float]":
    """Estimated error of each row with a force, relative to its size or to that of the weakest current."""
    keys = [name for name in (VARIANT, "distance_m") if name in rows]
    weakest_first = rows.assign(size=size, magnitude=rows["current_A"].abs()).sort_values("magnitude", kind="stable")
    weakest = weakest_first.groupby(keys)["size"].transform("first")
    largest = weakest_first["force_N"].abs().groupby([weakest_first[name] for name in keys]).transform("max")
    scale = size.combine(weakest.reindex(rows.index), max).combine(SMALL_FORCE * largest.reindex(rows.index), max)
    return (rows["force_error_N"] / scale)[scale > 0.0]
