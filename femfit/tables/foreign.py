"""From the tables that FEMM users have to a checked sweep table."""

import hashlib
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from femfit import __version__
from femfit.core.errors import TableError
from femfit.core.files import path_of
from femfit.core.results import Finding, listing
from femfit.core.sweep_columns import COLUMNS
from femfit.core.text import counted, quoted
from femfit.device.load import read_actuator, sweep_manifest_entry
from femfit.tables.checks import checked
from femfit.tables.columns import UsedColumn
from femfit.tables.containers import SUFFIXES, parse_table
from femfit.tables.findings import finding, refused
from femfit.tables.foreign_forms import AXES, SWEEP, ImportOptions, is_matrix, listed, long_points
from femfit.tables.raw_table import RawTable, file_content
from femfit.tables.reading import words_of
from femfit.tables.sweep_checks import GRID_CHECKS, ROW_CHECKS, force_sign, holes_of_grid, repeated_points
from femfit.tables.sweep_table import SweepTable, snap_axis
from femfit.tables.units import CHANNELS, column_unit, unit_factor

_NUMBER = r"(?P<number>(?:(?<![A-Za-z0-9])[-+])?\d+(?:[.,p]\d+)?(?:e-?\d+)?)"
_UNITS = {"current_A": r"(?P<unit>[mu]?A|amps?)", "distance_m": r"(?P<unit>[mcu]?m|in(?:ch)?)"}


@dataclass(frozen=True, eq=False, repr=False)
class ImportedTable(SweepTable):
    """A sweep table that was imported, and what was concluded about it.

    Parameters
    ----------
    findings : tuple of Finding
        In the order in which they were made; no error that was not accepted.
    mapping : tuple of UsedColumn
        Column and unit of each quantity (of the first file that had it).
    dialects : mapping of str to str
        File name to encoding, delimiter and decimal mark.

    Examples
    --------
    >>> import femfit as ff
    >>> table = ff.import_table("forces.csv", units={"distance": "mm"})
    >>> table.mapping[0].name, table.mapping[0].unit
    ('current_A', 'A')
    """

    findings: tuple[Finding, ...] = ()
    mapping: tuple[UsedColumn, ...] = ()
    dialects: Mapping[str, str] = field(default_factory=dict)

    def __str__(self) -> str:
        severe = [f"- {finding.marked}" for finding in self.findings if finding.severity != "info"]
        lines = [super().__str__(), *severe]
        lines += [f"{name}: read as {dialect}" for name, dialect in self.dialects.items()]
        for use in self.mapping:
            unit = f"{quoted(use.unit)}{' (assumed)' if use.assumed else ''}"
            lines.append(f"  {use.name} from {quoted(use.header)}, in {unit}, times {use.factor:g}")
        return "\n".join([*lines, *(f"- {finding}" for finding in self.findings if finding.severity == "info")])


def import_table(
    paths: str | Path | Sequence[str | Path], *, actuator: str | Path | None = None, **options: Any
) -> ImportedTable:
    """Bring in a table of FEMM or another program: recognise it, convert it to SI and check it.

    Parameters
    ----------
    paths : str, Path or sequence of them
        Files of any kind that holds tables, or directories of them (one file a current, named as in
        ``force_0.4A.csv``).
    actuator : str or Path, optional
        Actuator file whose circuit, motion and sensor go with the table.
    **options
        Fields of :class:`femfit.tables.foreign_forms.ImportOptions`, for example ``units={"distance": "mm"}``.

    Raises
    ------
    TableError
        If the files cannot be understood, or a check finds an error that ``accept`` does not name.

    Examples
    --------
    >>> import femfit as ff
    >>> table = ff.import_table("forces.csv", units={"distance": "mm"})
    >>> model = ff.fit_model(table).model
    """
    entry = {"actuator": sweep_manifest_entry(read_actuator(actuator))} if actuator else {}
    sources = paths if isinstance(paths, Iterable) and not isinstance(paths, str) else [paths]
    given = ImportOptions(**options)
    files = [file for path in sources for file in _files(path_of(path, "A table to import"))]
    if not files:
        raise TableError("An import needs at least one file or directory.")
    contents = {file: file_content(file, "table") for file in files}
    points, mapping, findings, dialects = _gather(contents, given)
    points = points.assign(distance_m=(given.distance_start_m or 0.0) + points["distance_m"])
    placed = points[np.isfinite(points[list(AXES)]).all(axis=1) & ~np.isfinite(points["force_N"])]
    good, faults = checked(points, ROW_CHECKS)
    if good.empty:
        raise refused(
            "no-rows",
            files=listing((file.name for file in files), 4),
            reason=faults[0].text if faults else "there is no row below the header.",
        )
    findings = _stop_at_errors([*findings, *faults], given)
    snapped = good.assign(**{name: snap_axis(good[name].to_numpy(dtype=float)) for name in AXES})
    good, repeats = checked(snapped, (repeated_points,))
    keep_sign = partial(force_sign, keep=given.keep_force)
    good = good.sort_values(list(AXES), kind="stable").reset_index(drop=True)
    good, remarks = checked(good, (holes_of_grid, keep_sign, *GRID_CHECKS))
    findings = _stop_at_errors([*findings, *repeats, *remarks], given)
    rows = good[[name for name in COLUMNS if name in good]].assign(status="ok")
    if len(placed):
        failed = placed[list(AXES)].assign(status="no number in the imported table")
        rows = pd.concat([rows, failed], ignore_index=True)
    manifest = {
        "kind": "import",
        "name": files[0].stem if len(files) == 1 else files[0].resolve().parent.name,
        "sources": [
            {"file": file.name, "sha256": hashlib.sha256(contents[file]).hexdigest(), "read_as": dialects[file.name]}
            for file in files
        ],
        "mapping": [
            {
                "quantity": column_unit(use.name)[0],
                "column": use.name,
                "header": use.header,
                "unit": use.unit,
                "factor_to_SI": use.factor,
                "unit_assumed": use.assumed,
            }
            for use in mapping
        ],
        "findings": [finding.as_dict() for finding in findings],
        "rows": len(rows),
        "versions": {"femfit": __version__, "numpy": np.__version__, "pandas": pd.__version__},
    }
    return ImportedTable(rows, manifest | entry, findings=tuple(findings), mapping=mapping, dialects=dialects)


def _files(path: Path) -> list[Path]:
    """A file, or the tables in a directory."""
    if not path.is_dir():
        return [path]
    tables = sorted(file for file in path.iterdir() if file.suffix.casefold() in SUFFIXES)
    if not tables:
        raise TableError(f"Directory {path} holds no table ({', '.join(SUFFIXES)}).")
    return tables


def _gather(
    contents: Mapping[Path, bytes], options: ImportOptions
) -> tuple[pd.DataFrame, tuple[UsedColumn, ...], list[Finding], dict[str, str]]:
    """All files' rows under each other."""
    frames: list[pd.DataFrame] = []
    mapping: dict[str, UsedColumn] = {}
    findings: list[Finding] = []
    dialects: dict[str, str] = {}
    for file, content in contents.items():
        in_name = {column: value for column in _UNITS if (value := _value_in_name(file, column)) is not None}
        words = words_of(file, options)
        words = replace(words, settings=in_name | dict(words.settings))
        wanted = partial(_is_wanted, words)
        raw = parse_table(content, file.name, table=words.table, wanted=wanted, decimal=words.decimal)
        raw = replace(raw, headers=words.column_names or raw.headers)
        dialects[file.name] = raw.dialect
        findings += [finding("reading", note=f"{file.name}: {note}") for note in raw.notes]
        matrix = is_matrix(raw, words)
        raw, choices, remarks = listed(raw, words) if matrix else (raw, words, [])
        frame, uses, doubts = long_points(raw, choices)
        frames.append(frame)
        findings += [remark for remark in (*remarks, *doubts) if remark not in findings]
        uses = {name: uses[name] for name in choices.columns.values()} if matrix else uses
        mapping = mapping | uses | mapping
    assumed = [f"{quoted(use.header)} in {use.unit}" for use in mapping.values() if use.assumed]
    if assumed:
        findings.append(finding("assumed-units", columns=", ".join(assumed)))
    return pd.concat(frames, ignore_index=True), tuple(mapping.values()), findings, dialects


def _is_wanted(options: ImportOptions, raw: RawTable) -> bool:
    named = replace(raw, headers=options.column_names or raw.headers)
    return is_matrix(named, options) or SWEEP.fits(named, options)


def _value_in_name(path: Path, column: str) -> float | None:
    """Read a current (A) or distance (m) from a file's name; ``p`` may stand for the decimal point.

    A hyphen is a minus only where no letter or digit precedes it. None unless the name holds exactly one such number,
    with its unit or after the quantity's name.
    """
    names = "|".join(sorted(filter(str.isascii, CHANNELS[column].names), key=len, reverse=True))
    patterns = [
        rf"(?<![\d.,]){_NUMBER}[ _]?{_UNITS[column]}(?![A-Za-z0-9])",
        rf"(?i:(?<![A-Za-z])(?:{names}))[ _=\-]*{_NUMBER}(?P<unit>)(?![A-Za-z0-9])",
        *([rf"^{_NUMBER}(?P<unit>)$"] if column == "current_A" else []),
    ]
    matches = next(filter(None, ([*re.finditer(pattern, path.stem)] for pattern in patterns)), [])
    if len(matches) != 1:
        return None
    (number, unit), si_unit = matches[0].group("number", "unit"), column_unit(column)[1]
    factor = unit_factor(unit or si_unit, si_unit)
    return None if factor is None else float(number.replace(",", ".").replace("p", ".")) * factor


def _stop_at_errors(findings: list[Finding], options: ImportOptions) -> list[Finding]:
    """Accepted errors as warnings; the others stop the import, all at once."""
    settled = [
        remark.accepted() if remark.severity == "error" and remark.code in options.accept else remark
        for remark in findings
    ]
    errors = [f"  - {remark} [{remark.code}]" for remark in settled if remark.severity == "error"]
    if errors:
        head, remedy = f"The table has {counted(len(errors), 'error')}:", "To go on in spite of one: --accept CODE."
        raise TableError("\n".join([head, *errors, remedy]))
    return settled
