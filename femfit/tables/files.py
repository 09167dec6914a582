"""Arrays by their names in an ``.npz`` file, which is whole or not there.

Small TOML and JSON files of settings beside a table: sidecars and manifests.
"""

import json
import math
import tomllib
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar
from zipfile import BadZipFile

import numpy as np

from femfit.core.errors import TableError
from femfit.core.files import replacing
from femfit.core.text import quoted

Made = TypeVar("Made")

_DAMAGED = (OSError, ValueError, KeyError, TypeError, EOFError, NotImplementedError, BadZipFile, zlib.error, IndexError)


def write_arrays(arrays: Mapping[str, Any] | None, file: Path) -> None:
    """Write what is not None of them, or remove an earlier file where there are no arrays."""
    if arrays is None:
        file.unlink(missing_ok=True)
        return
    held: dict[str, Any] = {name: np.asarray(value) for name, value in arrays.items() if value is not None}
    with replacing(file) as partial, partial.open("wb") as out:
        np.savez_compressed(out, **held)


@contextmanager
def reading(file: Path, remedy: str) -> Iterator[None]:
    """Say of what a sweep has written, and what cannot be read any more, what to do."""
    try:
        yield
    except _DAMAGED as error:
        raise TableError(f"{file} cannot be read: {quoted(error, 300)}. {remedy}") from error


def read_arrays(file: Path, make: Callable[[dict[str, Any]], Made], remedy: str) -> Made | None:
    """What is made of a file's arrays; None where there is no file.

    Raises
    ------
    TableError
        If the file is damaged.
    """
    if not file.is_file():
        return None
    with reading(file, remedy), file.open("rb") as source, np.load(source, allow_pickle=False) as held:
        return make({name: held[name] for name in held.files})


def read_settings(file: Path, example: str) -> dict[str, Any]:
    """Read a small TOML or JSON file of settings."""
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


def finite_number(value: object) -> float | None:
    """Return a number of a settings file as a float; None for anything else, and for what a float does not hold."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        return float(value) if math.isfinite(value) else None
    except OverflowError:
        return None
