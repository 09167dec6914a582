"""MAT and HDF5 files, decoded in a process of their own: a damaged one can make their libraries in C crash.

TDMS files of LabVIEW and DIAdem: groups of channels, each with its unit and its step of time.

WAV recordings of a sound card: channels in parts of full scale, the time from the sample rate.

Sheets of a spreadsheet, each read as the text table that it would be saved as.
"""

import faulthandler
import io
import resource
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
from scipy.io import wavfile

from femfit.core.errors import TableError
from femfit.core.processes import process_pool
from femfit.core.results import listing
from femfit.tables.columns import match_column
from femfit.tables.header import with_unit
from femfit.tables.mat_hdf5 import hdf5_tree, mat_tree, nested_tables, require_library, table_of_columns
from femfit.tables.raw_table import RawTable
from femfit.tables.text_table import parse_text

TIMEOUT_S, TIMEOUT_S_PER_BYTE = 30.0, 1e-6
"""Chosen: a file of 1 MB takes 0.3 s on a free machine, most of it the libraries' import, and 100 MB take 1 s."""

MEMORY, MEMORY_PER_BYTE = 2e9, 64.0
"""Bytes, chosen: what numbers unpack to, several times over, beside the libraries'."""


def read_apart(kind: str, content: bytes, source: str) -> tuple[list[RawTable], str]:
    """Tables of a MAT or HDF5 file, and what in it cannot be read."""
    if kind != "MAT":
        require_library("h5py", "h5py", source)
    timeout, memory = TIMEOUT_S + TIMEOUT_S_PER_BYTE * len(content), MEMORY + MEMORY_PER_BYTE * len(content)
    with process_pool(1) as pool:
        try:
            tree, remark = pool.submit(_decoded, kind, content, int(memory)).result(timeout)
        except MemoryError as error:
            raise TableError(
                f"{source} says that it unpacks to more memory than its {len(content) / 1e6:.3g} MB may take "
                f"({memory / 1e9:.3g} GB). Unless it is damaged, export fewer columns."
            ) from error
    return nested_tables(tree, source, kind, separator="/" if kind == "HDF5" else "."), remark


def _decoded(kind: str, content: bytes, memory: int) -> tuple[dict[str, Any], str]:
    """What a file holds, in a process of its own with so many bytes."""
    faulthandler.disable()  # what it prints of a crash is for programmers
    hard = resource.getrlimit(resource.RLIMIT_AS)[1]  # which no process may raise
    memory = memory if hard == resource.RLIM_INFINITY else min(memory, hard)
    resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    return mat_tree(content) if kind == "MAT" else hdf5_tree(content)


_NO_CLOCK = (0.0, 1.0)
"""Increments that LabVIEW writes where there is no clock."""


def read_tdms(content: bytes, source: str) -> tuple[list[RawTable], str]:
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
        channels = {
            with_unit(channel.name, channel.properties.get("unit_string")): np.asarray(channel[:])
            for channel in group.channels()
        }
        tree[group.name] = _with_time(channels, [dict(channel.properties) for channel in group.channels()])
    tables = nested_tables(tree, source, "TDMS", separator="/")
    lines = [line.partition("] ")[2] for line in log.getvalue().splitlines()]
    if not lines:
        return tables, ""
    remark = f"The file seems to be damaged: {listing(lines, 3)}."
    return [replace(table, notes=(*table.notes, remark)) for table in tables], remark


def _with_time(channels: dict[str, Any], properties: list[dict[str, Any]]) -> dict[str, Any]:
    """The channels of a group with the time of their samples, if they have one clock and no channel is it."""
    steps = {float(entry.get("wf_increment", 0.0)) for entry in properties}
    begins = {float(entry.get("wf_start_offset", 0.0)) for entry in properties}
    lengths = {len(channel) for channel in channels.values()}
    timed = any((column := match_column(name, ("time_s",))) and column.name == "time_s" for name in channels)
    if timed or not len(steps) == len(begins) == len(lengths) == 1 or next(iter(steps)) in _NO_CLOCK:
        return channels
    return {"time_s": begins.pop() + steps.pop() * np.arange(lengths.pop()), **channels}


_FULL_SCALE = {"int16": 2.0**15, "int32": 2.0**31, "int64": 2.0**63}
"""Integers of 24 bits are read shifted up to 32."""


def read_wav(content: bytes, source: str) -> tuple[list[RawTable], str]:
    """The one table of a recording: ``time_s`` and ``channel 1`` to ``channel n``, each from -1 to 1."""
    rate, samples = wavfile.read(io.BytesIO(content))
    samples = samples.reshape(len(samples), -1)
    if samples.dtype == np.uint8:
        scaled = (samples - 128.0) / 128.0
    else:
        scaled = samples / _FULL_SCALE.get(samples.dtype.name, 1.0)
    columns = {"time_s": np.arange(len(scaled)) / rate}
    columns |= {f"channel {k + 1}": scaled[:, k] for k in range(scaled.shape[1])}
    table = table_of_columns("samples", columns, source, f"WAV of {rate} samples a second")
    note = "the channels are parts of full scale, -1 to 1; a number as unit, --unit 'channel 1=2.5', is the gain"
    return [replace(table, notes=(note,))], ""


def read_xlsx(content: bytes, source: str) -> tuple[list[RawTable], str]:
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
