"""TDMS files of LabVIEW and DIAdem: groups of channels, each with its unit and its step of time."""

import io
from dataclasses import replace
from typing import Any

import numpy as np

from femfit.core.finding import listing
from femfit.tables.columns import match_column
from femfit.tables.containers.named_table import NamedTable, require_library
from femfit.tables.containers.nested import nested_tables
from femfit.tables.header import with_unit

_NO_CLOCK = (0.0, 1.0)
"""Increments that LabVIEW writes where there is no clock."""


def read_tdms(content: bytes, source: str) -> tuple[list[NamedTable], str]:
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
    return [replace(table, raw=replace(table.raw, notes=(*table.raw.notes, remark))) for table in tables], remark


def _with_time(channels: dict[str, Any], properties: list[dict[str, Any]]) -> dict[str, Any]:
    """The channels of a group with the time of their samples, if they have one clock and no channel is it."""
    steps = {float(entry.get("wf_increment", 0.0)) for entry in properties}
    begins = {float(entry.get("wf_start_offset", 0.0)) for entry in properties}
    lengths = {len(channel) for channel in channels.values()}
    timed = any((column := match_column(name, ("time_s",))) and column.name == "time_s" for name in channels)
    if timed or not len(steps) == len(begins) == len(lengths) == 1 or next(iter(steps)) in _NO_CLOCK:
        return channels
    return {"time_s": begins.pop() + steps.pop() * np.arange(lengths.pop()), **channels}
