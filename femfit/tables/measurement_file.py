"""Bench measurement files, CSV or Parquet with an optional sidecar, to checked tables."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from femfit.core.errors import TableError
from femfit.tables.measurement import CHANNELS, SETTINGS, BenchTable
from femfit.tables.measurement_branch import branch_from_order
from femfit.tables.measurement_cells import cell_numbers, read_cells
from femfit.tables.measurement_checks import checked, without_copies
from femfit.tables.measurement_columns import recognise
from femfit.tables.measurement_order import in_measuring_order
from femfit.tables.measurement_sidecar import read_sidecar


def read_bench_table(path: Path, *, planned: bool = False) -> BenchTable:
    """Read and check a bench measurement.

    Parameters
    ----------
    path : Path
        ``.csv`` (commas, semicolons or tabs; decimal point or comma; lines that start with # are passed over) or
        ``.parquet``; ``NAME.toml`` or ``NAME.csv.toml`` beside it may declare the noise.
    planned : bool
        Whether it is a plan: a channel counts as given by its column alone, its cells may be empty.

    Returns
    -------
    BenchTable
        Rows in the order of measuring, with what the checks set aside as NaN and said in ``findings``.

    Raises
    ------
    TableError
        If there is no such file, it is no table, or it lacks a current, a distance or any channel.
    """
    path = Path(path)
    raw = read_cells(path)
    used, findings = recognise(map(str, raw.columns), str(path))
    names = [one.name for one in used]
    if raw.empty:
        raise TableError(f"{path} has column names and no row below them; it needs one row a reading.")
    _require(names, path, [str(header) for header in raw.columns if header not in {one.header for one in used}])
    columns = {}
    for one in used:
        columns[one.name], said = cell_numbers(raw[one.header], one)
        findings += said
    sidecar = read_sidecar(path)
    rows = pd.DataFrame(columns)
    given = tuple(
        name
        for name in (*SETTINGS, *CHANNELS)
        if name in rows and (bool(rows[name].notna().any()) or (planned and name in CHANNELS))
    )
    _require(given, path)
    full, copies = (_complete(rows), []) if planned else without_copies(_complete(rows), given)
    ordered, said = in_measuring_order(full, "run" in given)
    if "branch" not in given:
        branch, assumed = branch_from_order(ordered)
        said += assumed
        ordered = ordered if branch is None else ordered.assign(branch=branch)
    table = BenchTable(
        rows=ordered.assign(mount=ordered["mount"].fillna(ordered["run"])),
        given=given,
        declared_noise=sidecar.noise,
        findings=(*findings, *copies, *said, *sidecar.findings),
        source=path.name,
        test_object=sidecar.test_object,
        notes=sidecar.notes,
    )
    table = table if planned else checked(table)
    if table.rows.empty:
        raise TableError(
            f"{path} must have rows with a distance above zero, counted from the electromagnet's face to the moving "
            "part's; it has none. Add the thickness that was left out, or turn the sign."
        )
    return table


def _require(names: Sequence[str], path: Path, unknown: Sequence[str] = ()) -> None:
    missing = [name for name in ("current_A", "distance_m") if name not in names]
    if not any(name in CHANNELS for name in names):
        missing.append(f"one of {', '.join(CHANNELS)}")
    if missing:
        raise TableError(
            f"A bench table must have current_A, distance_m and at least one channel, with numbers in them; {path} "
            f"lacks {' and '.join(missing)} (it has {', '.join(names) or 'none of the known columns'}"
            f"{'; not understood: ' + ', '.join(unknown) if unknown else ''}). Rename the columns or add them."
        )


def _complete(rows: pd.DataFrame) -> pd.DataFrame:
    """Every column of the contract, in the order of the file."""
    full = pd.DataFrame({name: rows.get(name, missing) for name, missing in SETTINGS.items()}, index=rows.index)
    full = full.assign(**{name: rows.get(name, np.nan) for name in CHANNELS}).astype(np.float64)
    return full.assign(
        run=full["run"].fillna(full["run"].ffill().fillna(1.0)), branch=np.sign(full["branch"].fillna(0.0))
    )
