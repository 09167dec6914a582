"""The sweep table: one row a solved point, as Parquet and CSV beside a manifest.

Written by the sweep and by the importer of FEMM tables, read by the fit; both kinds look the same. Of a parameter
sweep's table one variant is chosen, with what its model needs beside the rows.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from femfit.core.errors import TableError
from femfit.core.files import path_of, read_settings, reading, replacing, write_arrays, write_json
from femfit.core.numerics import FloatArray
from femfit.core.results import Plotted, listing
from femfit.core.sweep_columns import VARIANT, is_current
from femfit.core.text import counted, quoted
from femfit.tables.eddy_table import NAME, EddyTable, read_eddy
from femfit.tables.findings import refused
from femfit.tables.signatures import (
    SLOPES_NAME,
    ImpedanceSlopes,
    Signatures,
    read_signatures,
    read_slopes,
    write_signatures,
)

if TYPE_CHECKING:
    import pandas as pd

REQUIRED = ("current_A", "distance_m", "force_N")
TABLE_STEM = "sweep"
MANIFEST_NAME = "manifest.json"
KINDS = ("sweep", "import")
"""Kinds of manifest; what such a table holds was checked when it was made."""


SAME = 1e-6
"""Values of a variant's parameter that agree to this part are the same: nobody types a drawn sample's sixteen digits.
Chosen."""

SHOWN = 6
"""Values that a message shows."""


@dataclass(frozen=True, eq=False, repr=False)
class SweepTable(Plotted):
    """A sweep table with its manifest.

    Parameters
    ----------
    rows : DataFrame
        Columns as in :data:`COLUMNS`; those without data may be absent, ``REQUIRED`` are not.
    manifest : mapping
        ``kind`` (``sweep`` or ``import``), ``name``, ``actuator`` (circuit, motion, sensor as far as known: keys
        ``mass_kg, resistance_ohm, voltage_min_V, voltage_max_V, sample_time_s, reference_distances_m, hall`` with the
        fields of :class:`femfit.device.parts.HallElement`), versions and hashes.
    signatures : Signatures or None
        What each number of the drawing changes, where that was solved.

    Examples
    --------
    >>> import femfit as ff
    >>> rows = ff.read_sweep("runs/rig").valid_rows()
    >>> nearest = rows[rows["distance_m"] == 0.015]
    >>> nearest["force_N"].round(3).to_list()
    [0.08, 0.126, 0.171, 0.217, 0.24]
    """

    rows: "pd.DataFrame"
    manifest: Mapping[str, Any] = field(default_factory=dict)
    signatures: Signatures | None = None
    eddy: EddyTable | None = None
    impedance_slopes: ImpedanceSlopes | None = None

    @property
    def still_mm(self) -> tuple[float, ...]:
        """Distances at which the field was solved at rest, and eddy currents, asked for, were not."""
        if self.eddy is None:
            return ()
        unsolved = sorted(set(self.valid_rows()["distance_m"]) - set(self.eddy.distances_m))
        return tuple(float(f"{1e3 * distance:.6g}") for distance in unsolved)

    @property
    def saturating(self) -> tuple[str, ...]:
        """Names of the materials with a magnetisation curve, as the drawing in the manifest has them."""
        inputs = self.manifest.get("inputs") or {}
        regions = [*inputs.get("fixed", ()), *(inputs.get("moving") or {}).get("regions", ())]
        return tuple(
            dict.fromkeys(region["material"]["name"] for region in regions if "flux_density_T" in region["material"])
        )

    def valid_rows(self) -> "pd.DataFrame":
        """The rows whose status is ``ok``."""
        if "status" not in self.rows:
            return self.rows
        return self.rows[self.rows["status"] == "ok"].reset_index(drop=True)

    def __str__(self) -> str:
        rows = self.valid_rows()
        distance = 1e3 * rows["distance_m"]
        currents = [(name.removeprefix("current_").removesuffix("A"), rows[name]) for name in current_names(rows)]
        ranges = [
            f"{counted(values.nunique(), 'current')} {f'of {name[:-1]} ' if name else ''}"
            f"{values.min():g} to {values.max():g} A"
            for name, values in currents
        ]
        return (
            f"{counted(len(rows), 'point')}: {', '.join(ranges)}, "
            f"{counted(distance.nunique(), 'distance')} {distance.min():g} to {distance.max():g} mm"
        )

    def _repr_html_(self) -> str:
        return super()._repr_html_() + str(self.rows.to_html(max_rows=12))


def current_names(rows: "pd.DataFrame") -> list[str]:
    """The columns of the circuits' currents, in their order."""
    return [name for name in map(str, rows.columns) if is_current(name)]


def write_sweep_table(table: SweepTable, directory: Path) -> Path:
    """Write ``sweep.parquet``, ``sweep.csv``, ``manifest.json`` and signatures, each completely or not at all."""
    parquet = Path(directory) / f"{TABLE_STEM}.parquet"
    with replacing(parquet) as partial:
        table.rows.to_parquet(partial, index=False)
    with replacing(parquet.with_suffix(".csv")) as partial:
        table.rows.to_csv(partial, index=False)
    write_json(parquet.with_name(MANIFEST_NAME), table.manifest)
    write_signatures(table.signatures, parquet.parent)
    eddy, slopes = table.eddy, table.impedance_slopes
    write_arrays(None if eddy is None else vars(eddy), parquet.with_name(NAME))
    write_arrays(None if slopes is None else slopes.arrays(), parquet.with_name(SLOPES_NAME))
    return parquet


def read_sweep_table(path: str | Path) -> SweepTable:
    """Read a sweep table.

    Parameters
    ----------
    path : str or Path
        A run directory, or its ``.parquet`` or ``.csv`` file; the manifest beside it is read where there is one.

    Raises
    ------
    TableError
        If there is no such file, a required column is missing, empty or not numeric, or no row is usable.

    Examples
    --------
    >>> import femfit as ff
    >>> print(ff.read_sweep("runs/rig"))
    50 points: 5 currents 0 to 1.4 A, 10 distances 15 to 45 mm
    """
    from femfit.tables.checks import suspected_units  # noqa: PLC0415
    from femfit.tables.containers import parse_table  # noqa: PLC0415  pandas loads while a sweep's workers solve
    from femfit.tables.raw_table import file_content  # noqa: PLC0415

    file = path_of(path, "A sweep table")
    if file.is_dir():
        held = [name for suffix in ("parquet", "csv") if (name := file / f"{TABLE_STEM}.{suffix}").is_file()]
        if not held:
            raise TableError(f"{file} holds no {TABLE_STEM}.parquet; run femfit sweep ACTUATOR.toml -o {file} first.")
        file = held[0]
    content = file_content(file, "sweep table")
    raw = parse_table(content, str(file), wanted=lambda raw: set(REQUIRED[1:]) <= set(raw.headers))
    if raw.ragged:
        raise refused("sweep-cells", file=file, lines=listing(raw.ragged))
    table, manifest_file = SweepTable(raw.frame()), file.with_name(MANIFEST_NAME)
    manifest = read_settings(manifest_file, '"kind": "sweep"') if manifest_file.is_file() else {}
    required = (*(current_names(table.rows) or REQUIRED[:1]), *REQUIRED[1:])
    if missing := [name for name in required if name not in table.rows]:
        facts = {"required": ", ".join(REQUIRED), "lacking": ", ".join(missing)}
        raise refused("sweep-columns", file=file, columns=listing(table.rows.columns, 20), **facts)
    usable = table.valid_rows()
    if usable.empty:
        lacks = "no rows" if table.rows.empty else "no row with status ok"
        raise TableError(f"Sweep table {file} has {lacks}.")
    for name in required:
        column_numbers(usable, name, f" of {file}")
    if manifest.get("kind") not in KINDS and (usable["distance_m"] <= 0).any():
        raise TableError(f"Column distance_m of {file} must be > 0; it goes down to {usable['distance_m'].min():g}.")
    wrong = [name for name in ("actuator", "versions") if not isinstance(manifest.get(name, {}), dict)]
    if wrong:
        raise TableError(f"{wrong[0]} in {manifest_file} must be a table of settings. Run the sweep or import again.")
    suspected = [] if manifest.get("kind") in KINDS else suspected_units(table.rows[["distance_m"]], None)
    if suspected:
        raise TableError(f"{file}: {suspected[0].text} Convert it with femfit import {file} --unit distance_m=mm.")
    folder = file.parent
    table = SweepTable(table.rows, manifest, read_signatures(folder), read_eddy(folder), read_slopes(folder))
    with reading(manifest_file, "Run the sweep or import again."):
        str(table.saturating)  # a manifest that is damaged is said to be, here and not where a fit asks
    return table


def column_numbers(rows: "pd.DataFrame", name: str, source: str = "") -> FloatArray:
    """A column as floats; an error where it has holes or text."""
    from pandas import to_numeric  # noqa: PLC0415

    column, values = rows[name], to_numeric(rows[name], errors="coerce").to_numpy(dtype=np.float64)
    texts = column[np.isnan(values) & column.notna()]
    if not len(texts) and not np.all(np.isfinite(values)):
        where = int(np.flatnonzero(~np.isfinite(values))[0])
        raise refused("sweep-numbers", name=name, source=source, row=where + 1, value=values[where])
    if len(texts) or (column.dtype.kind == "O" and any(isinstance(cell, str) for cell in column)):
        held = quoted((texts if len(texts) else column).iloc[0])
        raise TableError(f"Column {name}{source} must be numeric; it holds {held!r}.")
    return values


_SAME_LEVEL = 1e-6  # of the axis' span: loops that add 0.1 ten times differ by 1e-16, units by rounding of 6 digits


def snap_axis(values: FloatArray) -> FloatArray:
    """Replace each value by the first of its level, rounded to 12 digits: loops that add 0.1 ten times differ."""
    order = np.argsort(values, kind="stable")
    ordered = values[order]
    tolerance = _SAME_LEVEL * (np.ptp(values) or abs(float(values[0])) or 1.0)
    starts = np.concatenate([[True], np.diff(ordered) > tolerance])
    levels = np.array([float(f"{value:.12g}") for value in ordered[starts]])
    snapped = np.empty_like(values)
    snapped[order] = levels[np.cumsum(starts) - 1]
    return snapped


def choose_variant(table: SweepTable, where: Mapping[str, float | str]) -> SweepTable:
    """Return the rows of one variant as a sweep table of their own, with the variant's actuator.

    ``where`` has values by the column of the parameter, or of ``variant``, text for a material; it is empty for a table
    without parameters.
    """
    names = list(map(str, table.rows.columns))
    axes = names[names.index(VARIANT) :] if VARIANT in names else []
    rows = table.rows
    for name, value in where.items():
        if name not in axes:
            axes_text = f"its parameters are {', '.join(axes)}" if axes else "it has none: leave --where out"
            raise TableError(f"{name!r} is no parameter of the table; {axes_text}.")
        texts = isinstance(value, str) or any(isinstance(cell, str) for cell in rows[name])
        close = (
            str(cell) == _shown(value) if texts else math.isclose(float(cell), float(value), rel_tol=SAME)
            for cell in rows[name]
        )
        matching = rows[list(close)]
        if matching.empty:
            raise refused("no-variant", name=name, value=_shown(value), values=_values(rows[name]))
        rows = matching
    if not axes:
        return table
    variants = rows[axes].drop_duplicates()
    if len(variants) > 1:
        varying = "; ".join(f"{name} {_values(variants[name])}" for name in axes if len(set(variants[name])) > 1)
        first, level = variants[VARIANT].iloc[0], _shown(variants[axes[-1]].iloc[0])  # not of one row: 1 stays whole
        facts = {"first": first, "axis": axes[-1], "level": level}
        raise refused("several-variants", variants=len(variants), varying=varying, parameter=VARIANT, **facts)
    chosen = {name: variants[name].tolist()[0] for name in axes}
    manifest = {name: value for name, value in table.manifest.items() if name not in {"variants", "parameters"}}
    for entry in table.manifest.get("variants", ()):
        if entry.get(VARIANT) == chosen[VARIANT]:
            manifest |= {name: value for name, value in entry.items() if name in manifest}
    return SweepTable(rows.drop(columns=axes).reset_index(drop=True), manifest | {"variant": chosen})


def _shown(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:g}"


def _values(column: "pd.Series[Any]") -> str:
    values = list(map(_shown, sorted(set(column))))
    return f"is {', '.join(values[:SHOWN])}{f', ... {values[-1]}' if len(values) > SHOWN else ''}"
