"""The one place that decides how a file of numbers is read: by its first bytes, else as text.

MAT and HDF5 files are decoded in a process of their own: a damaged one can make their libraries in C crash.

TDMS files of LabVIEW and DIAdem: groups of channels, each with its unit and its step of time.

WAV recordings of a sound card: channels in parts of full scale, the time from the sample rate.

Sheets of a spreadsheet, each read as the text table that it would be saved as.
"""

import faulthandler
import io
import resource
import warnings
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from femfit.core.errors import TableError
from femfit.core.files import reading
from femfit.core.processes import process_pool
from femfit.core.results import listing
from femfit.core.text import quoted
from femfit.tables.columns import match_column
from femfit.tables.findings import refused
from femfit.tables.header import with_unit
from femfit.tables.nested import hdf5_tree, mat_tree, nested_tables, require_library, table_of_columns
from femfit.tables.raw_table import AGAIN, RawTable, typed_table
from femfit.tables.text_table import parse_text

SUFFIXES = (".csv", ".txt", ".dat", ".tsv", ".asc", ".parquet", ".xlsx", ".mat", ".h5", ".hdf5", ".tdms", ".wav")
"""What is taken for a table where a directory is read."""

TIMEOUT_S, TIMEOUT_S_PER_BYTE = 30.0, 1e-6
"""Chosen: a file of 1 MB takes 0.3 s on a free machine, most of it the libraries' import, and 100 MB take 1 s."""

MEMORY, MEMORY_PER_BYTE = 2e9, 64.0
"""Bytes, chosen: what numbers unpack to, several times over, beside the libraries'."""

_HDF5 = b"\x89HDF\r\n\x1a\n"
_NO_CLOCK = (0.0, 1.0)
"""Increments that LabVIEW writes where there is no clock."""

_FULL_SCALE = {"int16": 2.0**15, "int32": 2.0**31, "int64": 2.0**63}
"""Integers of 24 bits are read shifted up to 32."""

Wanted = Callable[[RawTable], bool]
Tables = tuple[list[RawTable], str]
"""The tables of a file, and what in it cannot be read."""


def parse_table(
    content: bytes,
    source: str,
    *,
    table: str | None = None,
    wanted: Wanted = lambda _: True,
    **dialect: str | None,
) -> RawTable:
    """Read a table of any kind of file; the dialect is that of :func:`femfit.tables.text_table.parse_text`.

    Parameters
    ----------
    table : str, optional
        Which of a file's tables: a sheet, a group, a struct.
    wanted : callable, optional
        Whether a table has the columns that are needed; of several tables the only one that has them is taken.

    Raises
    ------
    TableError
        If it is damaged, or if no or more than one of several tables has what is needed.
    """
    kind = container_kind(content, source)
    if kind:
        with reading(source, AGAIN, f" as {kind}"), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of a file's styles, titles or index, which no number depends on
            tables, remark = _READERS[kind](content, source)
        return _chosen(tables, remark, source, table, wanted)
    require_no_choice(source, table)
    if not content.startswith(b"PAR1") and not source.endswith(".parquet"):
        return parse_text(content, source, **dialect)
    with reading(source, AGAIN, " as Parquet"):
        frame = pd.read_parquet(io.BytesIO(content))
    indexed = any(level is not None for level in frame.index.names)
    return typed_table(frame.reset_index() if indexed else frame, source, "Parquet")


def require_no_choice(source: str, table: str | None) -> None:
    """Refuse the name of a table where there is only one."""
    if table is not None:
        raise TableError(f"{source} holds one table, so that --table {quoted(table)} has no meaning. Leave it out.")


def container_kind(content: bytes, source: str) -> str:
    """Name the kind of a file that may hold several tables, by its first bytes; empty for text and Parquet."""
    matlab = source.casefold().endswith(".mat")
    signs = {
        "HDF5": content.startswith(_HDF5),
        "MAT 7.3": content.startswith(b"MATLAB 7.3") or (matlab and content[512:520] == _HDF5),
        "MAT": matlab or content.startswith(b"MATLAB 5.0"),
        "XLSX": content.startswith(b"PK\x03\x04") and b"xl/" in content,
        "TDMS": content.startswith(b"TDSm"),
        "WAV": content[:4] in {b"RIFF", b"RIFX", b"RF64"} and content[8:12] == b"WAVE",
    }
    return next((kind for kind, sign in signs.items() if sign), "")


def is_container(path: Path) -> bool:
    """Tell whether a file is of a kind that may hold several tables, without reading it whole."""
    with path.open("rb") as file:
        head = file.read(1024)
    return head.startswith(b"PK\x03\x04") or bool(container_kind(head, path.name))


def _chosen(tables: list[RawTable], remark: str, source: str, name: str | None, wanted: Wanted) -> RawTable:
    """The table of a name, or of a name's end; without one the only one that has what is needed."""
    if name is not None:
        exact = [table for table in tables if table.name == name]
        suitable = exact or [each for each in tables if each.name.casefold().endswith(name.strip().casefold())]
    else:
        suitable = tables if len(tables) == 1 else list(filter(wanted, tables))
    if len(suitable) == 1:
        raw = suitable[0]
        if name is not None or len(tables) == 1:
            return raw
        passed_over = listing(table.name for table in tables if table is not raw)
        note = f"of {len(tables)} tables {quoted(raw.name)!r} was taken, not {passed_over}"
        return replace(raw, notes=(*raw.notes, note))
    needed = "all columns that are needed" if name is None else f"the name {quoted(name)!r}"
    lines = [
        f"  - {quoted(table.name)}: {listing(table.headers, 6) or 'columns without names'}"
        for table in (suitable or tables)[:12]
    ]
    head = f"{source} must have one table with {needed}; {len(suitable)} of its {len(tables)} have. {remark}".rstrip()
    end = "Choose one with --table NAME, and say what a column is with --column HEADER=COLUMN."
    raise TableError("\n".join([head, *lines, end]))


def _read_apart(kind: str, content: bytes, source: str) -> Tables:
    """Tables of a MAT or HDF5 file."""
    if kind != "MAT":
        require_library("h5py", "h5py", source)
    timeout, memory = TIMEOUT_S + TIMEOUT_S_PER_BYTE * len(content), MEMORY + MEMORY_PER_BYTE * len(content)
    with process_pool(1) as pool:
        try:
            tree, remark = pool.submit(_decoded, kind, content, int(memory)).result(timeout)
        except MemoryError as error:
            facts = {"megabytes": len(content) / 1e6, "gigabytes": memory / 1e9}
            raise refused("too-much-memory", source=source, **facts) from error
    return nested_tables(tree, source, kind, separator="/" if kind == "HDF5" else "."), remark


def _decoded(kind: str, content: bytes, memory: int) -> tuple[dict[str, Any], str]:
    """What a file holds, in a process of its own with so many bytes."""
    faulthandler.disable()  # what it prints of a crash is for programmers
    hard = resource.getrlimit(resource.RLIMIT_AS)[1]  # which no process may raise
    memory = memory if hard == resource.RLIM_INFINITY else min(memory, hard)
    resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    return mat_tree(content) if kind == "MAT" else hdf5_tree(content)


def _read_tdms(content: bytes, source: str) -> Tables:
    """Tables of a TDMS file, one a group; a waveform's increment gives its time."""
    require_library("nptdms", "npTDMS", source)
    from nptdms import TdmsFile  # noqa: PLC0415
    from nptdms.log import log_manager  # noqa: PLC0415

    log = io.StringIO()
    terminal = log_manager.console_handler.setStream(log)  # npTDMS prints what it made of damage
    try:
        file = TdmsFile.read(io.BytesIO(content))
    finally:
        log_manager.console_handler.setStream(terminal)
    tree: dict[str, Any] = {}
    for group in file.groups():
        channels = group.channels()
        columns = {
            with_unit(channel.name, channel.properties.get("unit_string")): np.asarray(channel[:])
            for channel in channels
        }
        tree[group.name] = _time(columns, [dict(channel.properties) for channel in channels]) | columns
    tables = nested_tables(tree, source, "TDMS", separator="/")
    lines = [line.partition("] ")[2] for line in log.getvalue().splitlines()]
    remark = f"The file seems to be damaged: {listing(lines, 3)}." if lines else ""
    return [replace(table, notes=(remark,) if lines else ()) for table in tables], remark


def _time(columns: dict[str, Any], properties: list[dict[str, Any]]) -> dict[str, Any]:
    """The time of a group's samples, if they have one clock and no channel is it."""
    clocks = {(float(of.get("wf_increment", 0.0)), float(of.get("wf_start_offset", 0.0))) for of in properties}
    lengths = {len(column) for column in columns.values()}
    timed = any((column := match_column(name, ("time_s",))) and column.name == "time_s" for name in columns)
    if timed or not len(clocks) == len(lengths) == 1:
        return {}
    step, begin = clocks.pop()
    return {} if step in _NO_CLOCK else {"time_s": begin + step * np.arange(lengths.pop())}


def _read_wav(content: bytes, source: str) -> Tables:
    """The one table of a recording: ``time_s`` and ``channel 1`` to ``channel n``, each from -1 to 1."""
    from scipy.io import wavfile  # noqa: PLC0415

    rate, samples = wavfile.read(io.BytesIO(content))
    samples = samples.reshape(len(samples), -1)
    unsigned = 128.0 if samples.dtype == np.uint8 else 0.0
    scaled = (samples - unsigned) / (unsigned or _FULL_SCALE.get(samples.dtype.name, 1.0))
    columns = {"time_s": np.arange(len(scaled)) / rate}
    columns |= {f"channel {k + 1}": scaled[:, k] for k in range(scaled.shape[1])}
    table = table_of_columns("samples", columns, source, f"WAV of {rate} samples a second")
    note = "the channels are parts of full scale, -1 to 1; a number as unit, --unit 'channel 1=2.5', is the gain"
    return [replace(table, notes=(note,))], ""


def _read_xlsx(content: bytes, source: str) -> Tables:
    """Tables of a workbook's sheets, and which sheets are none."""
    require_library("openpyxl", "openpyxl", source)
    sheets = pd.read_excel(io.BytesIO(content), sheet_name=None, header=None, engine="openpyxl")
    tables, charts = [], []
    for name, cells in sheets.items():
        text = cells.dropna(axis=1, how="all").map(_on_a_line).to_csv(sep="\t", header=False, index=False)
        try:
            raw = parse_text(text.encode(), source, delimiter="\t", decimal=".")
        except TableError:
            charts.append(name)
        else:
            tables.append(replace(raw, name=str(name)))
    return tables, f"No table stands in {listing(charts)}." if charts else ""


def _on_a_line(cell: Any) -> Any:
    """A cell without line ends, and with 0 or 1 for false or true."""
    return " ".join(cell.split()) if isinstance(cell, str) else int(cell) if isinstance(cell, bool) else cell


_READERS: dict[str, Callable[[bytes, str], Tables]] = {
    **{kind: partial(_read_apart, kind) for kind in ("HDF5", "MAT 7.3", "MAT")},
    "XLSX": _read_xlsx,
    "TDMS": _read_tdms,
    "WAV": _read_wav,
}
