"""From a sweep's results to its table and manifest."""

import math
from collections.abc import Mapping
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from femfit.core.sweep_columns import COLUMNS, VARIANT
from femfit.device.parts import SweepAxes
from femfit.device.summary import sweep_manifest_entry
from femfit.device.variants import VariantSweep

if TYPE_CHECKING:
    import pandas as pd

Result = Mapping[str, Any]
FIELD_COLUMNS = ("force_N", "flux_linkage_Wb", "inductance_H", "coenergy_J", "hall_T", "force_error_N")


def sweep_rows(sweep: VariantSweep, results: Mapping[tuple[int, float], Result]) -> "pd.DataFrame":
    """The rows of a sweep.

    Parameters
    ----------
    results : mapping
        By number of the variant, from 1, and distance in m: ``status``, and ``rows`` where there are any.

    Returns
    -------
    DataFrame
        In the order of the variants, then currents, then distances; the parameters' columns last.
    """
    import pandas as pd  # noqa: PLC0415  loads while the workers solve

    frames = []
    for number, variant in enumerate(sweep.variants, 1):
        own = {VARIANT: number, **dict(zip(sweep.columns, variant.values, strict=True))} if sweep.columns else {}
        frames += [
            _distance_rows(variant.sweep, distance, results[number, distance]) | own
            for distance in variant.sweep.distances_m
        ]
    rows = pd.concat([pd.DataFrame(frame) for frame in frames], ignore_index=True)
    axes = [VARIANT, *sweep.columns] if sweep.columns else []
    rows = rows.reindex(columns=[*(name for name in COLUMNS if name in rows), *axes])
    if rows["hall_T"].isna().all():
        rows = rows.drop(columns="hall_T")
    return rows.sort_values([*axes[:1], "current_A", "distance_m"], kind="stable", ignore_index=True)


def sweep_manifest(sweep: VariantSweep, configuration: Mapping[str, Any]) -> dict[str, Any]:
    """The manifest of a sweep.

    Returns
    -------
    dict
        JSON-ready; ``inputs`` is the whole actuator, and ``variants`` has what each variant's model needs beside its
        rows.
    """
    manifest = {
        "kind": "sweep",
        "name": sweep.actuator.name,
        "actuator": sweep_manifest_entry(sweep.actuator),
        "inputs": asdict(sweep.actuator),
        "settings": configuration["settings"],
        "versions": configuration["versions"],
        "configuration_hash": configuration["hash"],
    }
    if not sweep.columns:
        return manifest
    variants = [
        {
            VARIANT: number,
            **dict(zip(sweep.columns, variant.values, strict=True)),
            "actuator": None if variant.actuator is None else sweep_manifest_entry(variant.actuator),
            "inputs": None if variant.actuator is None else asdict(variant.actuator),
        }
        for number, variant in enumerate(sweep.variants, 1)
    ]
    return manifest | {"parameters": list(sweep.columns), "variants": variants}


def _distance_rows(axes: SweepAxes, distance: float, result: Result) -> dict[str, Any]:
    nothing = np.full(len(axes.currents_A), math.nan)
    rows = result.get("rows", {})
    return {
        "current_A": np.array(axes.currents_A),
        "distance_m": np.full(len(axes.currents_A), distance),
        **dict.fromkeys(FIELD_COLUMNS, nothing),
        "status": result["status"],
        **{name: np.array(values, dtype=np.float64) if None in values else values for name, values in rows.items()},
    }
