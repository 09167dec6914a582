"""The sidecar of a measurement: declared noise per channel, test object and notes, in a ``.toml`` beside it."""

import json
import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from femfit.core.errors import TableError
from femfit.core.finding import Finding
from femfit.core.quoted import quoted
from femfit.tables.measurement_columns import match_column


@dataclass(frozen=True)
class Sidecar:
    """What a measurement's sidecar says; ``noise`` is a standard deviation per channel, in the channel's unit."""

    noise: Mapping[str, float] = field(default_factory=dict)
    test_object: str = ""
    notes: str = ""
    findings: tuple[Finding, ...] = ()


def read_sidecar(measurement: Path, channels: Sequence[str]) -> Sidecar:
    """Read ``NAME.csv.toml`` or else ``NAME.toml`` beside a measurement.

    Returns
    -------
    Sidecar
        Empty where there is none. A channel's noise stands at the top or under ``[noise]``: ``force_N = 2e-4``.

    Raises
    ------
    TableError
        If the file is no TOML, or a noise is no number > 0.
    """
    for file in (measurement.with_name(f"{measurement.name}.toml"), measurement.with_suffix(".toml")):
        if file.is_file() and file != measurement:
            return _parsed(file, channels)
    return Sidecar()


def read_settings(file: Path, example: str) -> dict[str, Any]:
    """Read a small TOML or JSON file of settings.

    Raises
    ------
    TableError
        If it cannot be read; ``example`` shows what a line of it looks like.
    """
    try:
        text = file.read_text(encoding="utf-8")
        data = tomllib.loads(text) if file.suffix == ".toml" else json.loads(text)
    except (OSError, ValueError, RecursionError) as error:
        kind = "TOML" if file.suffix == ".toml" else "JSON"
        reason = "it is nested too deeply" if isinstance(error, RecursionError) else quoted(error, 200)
        raise TableError(f"{file} must be {kind}, with lines like {example}; {reason}.") from error
    if not isinstance(data, dict):
        raise TableError(f"{file} must hold settings by name, like {example}; instead received {quoted(data)}.")
    return data


def _parsed(file: Path, channels: Sequence[str]) -> Sidecar:
    data = read_settings(file, "force_N = 2e-4")
    declared = data.pop("noise", {})
    if not isinstance(declared, dict):
        raise TableError(f"[noise] of {file} must hold lines like force_N = 2e-4; instead received {quoted(declared)}.")
    noise: dict[str, float] = {}
    findings: list[Finding] = []
    texts = {key: str(data.pop(key)) for key in ("test_object", "notes") if key in data}
    for key, value in (data | declared).items():
        column = match_column(key, channels)
        if column is None:
            text = f"{quoted(key)!r} in {file.name} is no channel of this kind of file ({', '.join(channels)})"
            findings.append(Finding("unused-setting", "info", f"{text} and was not used."))
            continue
        sigma = _number(value)
        if not 0.0 < sigma < math.inf:
            raise TableError(
                f"The noise {quoted(key)} in {file} must be a standard deviation > 0 in the unit of its name, for "
                f"example 2e-4; instead received {quoted(value)}."
            )
        noise[column.name] = sigma * column.factor
    return Sidecar(noise, texts.get("test_object", ""), texts.get("notes", ""), tuple(findings))


def _number(value: object) -> float:
    """A number of a settings file as float; NaN for anything else, infinite for what is too large."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return math.nan
    try:
        return float(value)
    except OverflowError:
        return math.inf
