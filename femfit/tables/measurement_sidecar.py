"""The sidecar of a measurement: declared noise per channel, test object and notes, in a ``.toml`` beside it."""

import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from femfit.core.errors import TableError
from femfit.tables.measurement import CHANNELS
from femfit.tables.measurement_columns import match_column


@dataclass(frozen=True)
class Sidecar:
    """What a measurement's sidecar says.

    Parameters
    ----------
    noise : mapping of str to float
        Standard deviation of a reading per channel, in the channel's unit.
    findings : tuple of str
        What was not used, one plain sentence each.
    """

    noise: Mapping[str, float] = field(default_factory=dict)
    test_object: str = ""
    notes: str = ""
    findings: tuple[str, ...] = ()


def read_sidecar(measurement: Path, channels: Sequence[str] = CHANNELS) -> Sidecar:
    """Read ``NAME.csv.toml`` or else ``NAME.toml`` beside a measurement.

    Parameters
    ----------
    channels : sequence of str
        That such a measurement can have.

    Returns
    -------
    Sidecar
        Empty where there is none. A channel's noise stands at the top or under ``[noise]``: ``force_N = 2e-4``.

    Raises
    ------
    TableError
        If the file is no TOML, or a noise is no number > 0.
    """
    measurement = Path(measurement)
    for file in (measurement.with_name(f"{measurement.name}.toml"), measurement.with_suffix(".toml")):
        if file.is_file() and file != measurement:
            return _parsed(file, channels)
    return Sidecar()


def _parsed(file: Path, channels: Sequence[str]) -> Sidecar:
    try:
        data = tomllib.loads(file.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise TableError(f"{file} must be TOML, with lines like force_N = 2e-4; {error}.") from error
    declared = data.pop("noise", {})
    if not isinstance(declared, dict):
        raise TableError(f"[noise] of {file} must hold lines like force_N = 2e-4; instead received {declared!r}.")
    noise: dict[str, float] = {}
    findings: list[str] = []
    texts = {key: str(data.pop(key)) for key in ("test_object", "notes") if key in data}
    for key, value in (data | declared).items():
        column, _ = match_column(key, channels)
        if column is None:
            findings.append(
                f"{key!r} in {file.name} is no channel of this kind of file ({', '.join(channels)}) and was not used."
            )
            continue
        if isinstance(value, bool) or not isinstance(value, int | float) or not (0.0 < value < math.inf):
            raise TableError(
                f"The noise {key} in {file} must be a standard deviation > 0 in the unit of its name, for example "
                f"2e-4; instead received {value!r}."
            )
        noise[column.name] = float(value) * column.factor
    return Sidecar(noise, texts.get("test_object", ""), texts.get("notes", ""), tuple(findings))
