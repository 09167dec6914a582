"""Arrays by their names in an ``.npz`` file, which is whole or not there."""

import zlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar
from zipfile import BadZipFile

import numpy as np

from femfit.core.atomic import replacing
from femfit.core.errors import TableError
from femfit.core.quoted import quoted

Made = TypeVar("Made")

_DAMAGED = (OSError, ValueError, KeyError, TypeError, EOFError, NotImplementedError, BadZipFile, zlib.error)


def write_arrays(arrays: Mapping[str, Any] | None, file: Path) -> None:
    """Write what is not None of them, or remove an earlier file where there are no arrays."""
    if arrays is None:
        file.unlink(missing_ok=True)
        return
    held: dict[str, Any] = {name: np.asarray(value) for name, value in arrays.items() if value is not None}
    with replacing(file) as partial, partial.open("wb") as out:
        np.savez_compressed(out, **held)


def read_arrays(file: Path, make: Callable[[dict[str, Any]], Made], remedy: str) -> Made | None:
    """What is made of a file's arrays; None where there is no file.

    Raises
    ------
    TableError
        If the file is damaged.
    """
    if not file.is_file():
        return None
    try:
        with file.open("rb") as source, np.load(source, allow_pickle=False) as held:
            return make({name: held[name] for name in held.files})
    except _DAMAGED as error:
        raise TableError(f"{file} cannot be read: {quoted(error, 300)}. {remedy}") from error
