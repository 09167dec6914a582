"""The sidecar of a measurement: declared noise per channel, test object and notes, in a ``.toml`` beside it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path

from femfit.core.errors import TableError
from femfit.core.finding import Finding
from femfit.core.quoted import quoted
from femfit.tables.columns import UsedColumn, match_column
from femfit.tables.header import same_header
from femfit.tables.settings_file import finite_number, read_settings


@dataclass(frozen=True)
class Sidecar:
    """What a measurement's sidecar says; ``noise`` is a standard deviation per channel, in the channel's unit."""

    noise: Mapping[str, float] = field(default_factory=dict)
    test_object: str = ""
    notes: str = ""
    findings: tuple[Finding, ...] = ()


def read_sidecar(measurement: Path, channels: Sequence[str], used: Sequence[UsedColumn] = ()) -> Sidecar:
    """Read ``NAME.csv.toml`` or else ``NAME.toml`` beside a measurement; what it says is empty where there is none.

    A channel's noise stands at the top or under ``[noise]``: ``force_N = 2e-4``, or ``force_mN = 0.2``, or with the
    header of its column, whose unit it then has.
    """
    for file in (measurement.with_name(f"{measurement.name}.toml"), measurement.with_suffix(".toml")):
        if file.is_file() and file != measurement:
            return _parsed(file, channels, used)
    return Sidecar()


def _parsed(file: Path, channels: Sequence[str], used: Sequence[UsedColumn]) -> Sidecar:
    data = read_settings(file, "force_N = 2e-4")
    declared = data.pop("noise", {})
    if not isinstance(declared, dict):
        raise TableError(f"[noise] of {file} must hold lines like force_N = 2e-4; instead received {quoted(declared)}.")
    noise: dict[str, float] = {}
    findings: list[Finding] = []
    texts = {key: str(data.pop(key)) for key in ("test_object", "notes") if key in data}
    for key, value in (data | declared).items():
        own = (column for column in used if column.name in channels and same_header(key, column.header))
        column = match_column(key, channels) if key in channels else next(own, match_column(key, channels))
        if key not in declared and isinstance(value, dict):
            column = None  # a table of another kind of file, a drawing's [hall] say
        if column is None:
            near = get_close_matches(key[:100], channels, n=1)
            if key in declared or (near and not isinstance(value, dict)):
                raise TableError(
                    f"{quoted(key)!r} in {file} is no channel of this kind of file, so that its noise would be lost. "
                    f"{f'Did you mean {near[0]}? ' if near else ''}The channels are {', '.join(channels)}."
                )
            text = f"{quoted(key)!r} in {file.name} is no channel of this kind of file ({', '.join(channels)})"
            findings.append(Finding("unused-setting", "info", f"{text} and was not used."))
            continue
        sigma = finite_number(value)
        if sigma is None or sigma <= 0.0:
            raise TableError(
                f"The noise {quoted(key)} in {file} must be a standard deviation > 0 in the unit of its name, for "
                f"example 2e-4; instead received {quoted(value)}."
            )
        noise[column.name] = sigma * column.factor
    return Sidecar(noise, texts.get("test_object", ""), texts.get("notes", ""), tuple(findings))
