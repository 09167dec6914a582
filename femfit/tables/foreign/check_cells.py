"""Cells that are no numbers."""

import numpy as np
import pandas as pd

from femfit.core.finding import Finding, listing
from femfit.tables.foreign.options import REQUIRED


def check_cells(points: pd.DataFrame) -> tuple[pd.DataFrame, pd.DataFrame, list[Finding]]:
    """Part the rows that have current, distance and force from the others, which come second."""
    finite = np.isfinite(points[list(REQUIRED)].to_numpy(dtype=float)).all(axis=1)
    bad = points[~finite].reset_index(drop=True)
    good = points[finite].reset_index(drop=True)
    findings = []
    if len(bad):
        findings.append(
            Finding(
                "cells",
                "error",
                f"{len(bad)} of {len(points)} rows have no number for current, distance or force: {rows_of(bad)}.",
                "Correct these rows, or give --accept cells to keep them as points without a result.",
                float(len(bad)),
            )
        )
    return good, bad, findings


def drop_incomplete(points: pd.DataFrame, quantities: list[str]) -> tuple[pd.DataFrame, list[Finding]]:
    """Leave out optional columns that have gaps: a fit that met them would have to invent numbers."""
    findings = []
    for quantity in [name for name in quantities if name in points]:
        gaps = points[~np.isfinite(points[quantity].to_numpy(dtype=float))]
        if len(gaps):
            points = points.drop(columns=quantity)
            findings.append(
                Finding(
                    "gaps",
                    "warning",
                    f"The column of {quantity.replace('_', ' ')} has {len(gaps)} cells without a number "
                    f"({rows_of(gaps)}) and is left out.",
                    "Complete it and import again if you need it.",
                    float(len(gaps)),
                )
            )
    return points, findings


def rows_of(points: pd.DataFrame) -> str:
    """Where rows stand in their files."""
    parts = []
    for source, group in points.groupby("source", sort=False):
        parts.append(f"{source} line " + listing([str(line) for line in group["line"].unique()]))
    return "; ".join(parts[:4]) + ("; ..." if len(parts) > 4 else "")
