"""The sidecar of a measurement, a ``.toml`` beside it: noise, columns, units, test object and notes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from femfit.core.errors import TableError
from femfit.core.results import Finding
from femfit.core.text import quoted
from femfit.tables.columns import UsedColumn, match_column
from femfit.tables.files import finite_number, read_settings
from femfit.tables.findings import finding
from femfit.tables.header import same_header
from femfit.tables.measured_columns import constant_settings
from femfit.tables.measurement import OF_RUNS

_EXAMPLE = "force_N = 2e-4"
_EXAMPLES: Mapping[str, tuple[tuple[type, ...], str]] = {
    "columns": ((str,), '"Kanal 3" = "force_N"'),
    "units": ((str, int, float), '"Kanal 3" = "gf", or "channel 1" = 2.5'),
}

_OF_DRAWINGS = frozenset({"schema", "sweep"})
"""Keys that an actuator file has and a sidecar does not."""


@dataclass(frozen=True)
class Sidecar:
    """What a measurement's sidecar says.

    ``noise`` is a standard deviation per channel, in the channel's unit; ``run.force_N`` is that of what all readings
    of a run share.
    """

    noise: Mapping[str, float] = field(default_factory=dict)
    test_object: str = ""
    notes: str = ""
    findings: tuple[Finding, ...] = ()


@dataclass(frozen=True)
class Reading:
    """How a table is to be read: its columns and units, constant settings, which table of a file, the noise."""

    columns: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, str | float] = field(default_factory=dict)
    table: str | None = None
    noise: Mapping[str, float] = field(default_factory=dict)
    settings: Mapping[str, float] = field(default_factory=dict)  # In SI


def reading_of(
    measurement: Path,
    columns: Mapping[str, str] | None = None,
    units: Mapping[str, str | float] | None = None,
    table: str | None = None,
    noise: Mapping[str, float] | None = None,
    settings: Mapping[str, float] | None = None,
) -> Reading:
    """Return what the caller says of a table, before what its sidecar says."""
    file, data = _sidecar_file(measurement)
    tables: dict[str, dict[str, Any]] = {}
    for key, (kinds, example) in _EXAMPLES.items():
        value = data.get(key, {})
        if not isinstance(value, dict) or not all(isinstance(meant, kinds) for meant in value.values()):
            raise TableError(f"[{key}] of {file} must hold lines like {example}; instead received {quoted(value)}.")
        tables[key] = value
    if not isinstance(data.get("table", ""), str):
        raise TableError(f'table in {file} must be a name like "Messung 2"; instead received {quoted(data["table"])}.')
    return Reading(
        tables["columns"] | dict(columns or {}),
        tables["units"] | dict(units or {}),
        table if table is not None else data.get("table"),
        noise or {},
        constant_settings(data.get("settings", {}), str(file)) | constant_settings(settings or {}, "the options"),
    )


def read_sidecar(
    measurement: Path,
    channels: Sequence[str],
    used: Sequence[UsedColumn] = (),
    noise: Mapping[str, float] | None = None,
) -> Sidecar:
    """Read ``NAME.csv.toml`` or else ``NAME.toml`` beside a measurement; what it says is empty where there is none.

    A channel's noise stands at the top or under ``[noise]``: ``force_N = 2e-4``, or ``force_mN = 0.2``, or with the
    header of its column, whose unit it then has; its offset from run to run under ``[noise.run]``, or as
    ``run.force_N``. The ``noise`` that the caller declares counts in its place.
    """
    file, data = _sidecar_file(measurement)
    sidecar = Sidecar() if file is None else _parsed(file, data, channels, used)
    declared: dict[str, float] = {}
    for key, value in (noise or {}).items():
        column = _channel(key, channels, used)
        if column is None:
            raise TableError(_no_channel(key, "the declared noise", channels))
        declared[column.name] = _deviation(key, value, "the declared noise") * column.factor
    return replace(sidecar, noise={**sidecar.noise, **declared})


def _sidecar_file(measurement: Path) -> tuple[Path | None, dict[str, Any]]:
    """The sidecar and what is in it; a drawing of the same name is none."""
    if not measurement.is_file():  # a directory such as . has no name
        return None, {}
    for file in (measurement.with_name(f"{measurement.name}.toml"), measurement.with_suffix(".toml")):
        if file.is_file() and file != measurement:
            data = read_settings(file, _EXAMPLE)
            if not _OF_DRAWINGS.intersection(data):
                return file, data
    return None, {}


def _parsed(file: Path, settings: dict[str, Any], channels: Sequence[str], used: Sequence[UsedColumn]) -> Sidecar:
    data = dict(settings)
    for key in ("columns", "units", "table", "settings"):
        data.pop(key, None)
    declared = data.pop("noise", {})
    if not isinstance(declared, dict):
        raise TableError(f"[noise] of {file} must hold lines like {_EXAMPLE}; instead received {quoted(declared)}.")
    noise: dict[str, float] = {}
    findings: list[Finding] = []
    offsets = declared.pop(OF_RUNS.rstrip("."), {})
    if not isinstance(offsets, dict):
        raise TableError(f"[noise.run] of {file} must hold lines like {_EXAMPLE}; instead received {quoted(offsets)}.")
    declared |= {OF_RUNS + key: value for key, value in offsets.items()}
    texts = {key: str(data.pop(key)) for key in ("test_object", "notes") if key in data}
    for key, value in (data | declared).items():
        column = _channel(key, channels, used)
        if key not in declared and isinstance(value, dict):
            column = None  # a table of another kind of file, a drawing's [hall] say
        if column is None:
            near = get_close_matches(key[:100], channels, n=1)
            if key in declared or (near and not isinstance(value, dict)):
                raise TableError(_no_channel(key, str(file), channels))
            facts = {"key": quoted(key), "file": file.name, "channels": ", ".join(channels)}
            findings.append(finding("unused-setting", **facts))
            continue
        noise[column.name] = _deviation(key, value, str(file)) * column.factor
    return Sidecar(noise, texts.get("test_object", ""), texts.get("notes", ""), tuple(findings))


def _channel(key: str, channels: Sequence[str], used: Sequence[UsedColumn]) -> UsedColumn | None:
    """The channel that a key means: by its name, with another unit, or by the header of its column."""
    if key.startswith(OF_RUNS):
        of_runs = [name.removeprefix(OF_RUNS) for name in channels if name.startswith(OF_RUNS)]
        channel = _channel(key.removeprefix(OF_RUNS), of_runs, used) if of_runs else None
        return replace(channel, name=OF_RUNS + channel.name) if channel else None
    headed = (column for column in used if column.name in channels and same_header(key, column.header))
    return match_column(key, channels) if key in channels else next(headed, match_column(key, channels))


def _no_channel(key: str, where: str, channels: Sequence[str]) -> str:
    near = get_close_matches(key[:100], channels, n=1)
    return (
        f"{quoted(key)!r} in {where} is no channel of this kind of file, so that its noise would be lost. "
        f"{f'Did you mean {near[0]}? ' if near else ''}The channels are {', '.join(channels)}."
    )


def _deviation(key: str, value: object, where: str) -> float:
    sigma = finite_number(value)
    if sigma is None or sigma <= 0.0:
        raise TableError(
            f"The noise {quoted(key)} in {where} must be a standard deviation > 0 in the unit of its name, for "
            f"example 2e-4; instead received {quoted(value)}."
        )
    return sigma
