"""Files that are written whole or not at all.

What is written goes to a file beside the target and takes its place when it is complete: a kill, a full disk or an
error in between leaves an earlier file of that name as it was.
"""

import errno
import json
import math
import os
import secrets
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """Give a file to write to, which replaces ``path`` when the block ends without an error.

    The file has the target's suffix, because many writers choose their format by it. A symbolic link stays one: the
    file that it points to is replaced. A device such as ``/dev/stdout`` is written to directly.

    Examples
    --------
    >>> with replacing("runs/table.csv") as partial:  # doctest: +SKIP
    ...     rows.to_csv(partial)
    """
    target = Path(os.path.realpath(path))
    if Path(path).exists() and not Path(path).is_file() and not target.is_dir():
        yield Path(path)  # a pipe behind /dev/stdout has no path of its own
        return
    # A name that nobody can foresee, of a file that must be new: a link laid in its place would be written through
    partial = target.with_name(f".{target.stem}.{secrets.token_hex(8)}.partial{target.suffix}")
    try:
        if target.is_dir():
            raise IsADirectoryError(errno.EISDIR, "Is a directory, where a file is to be written", str(target))
        target.parent.mkdir(parents=True, exist_ok=True)
        os.close(os.open(partial, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666))  # less what the umask denies
        yield partial
        partial.replace(target)
    except OSError as error:
        if error.errno is not None and error.filename in (None, str(partial), partial):
            raise OSError(error.errno, error.strerror, str(path)) from error
        raise
    finally:
        partial.unlink(missing_ok=True)


def write_text(path: str | Path, text: str) -> None:
    """Write a text file in UTF-8, whole or not at all; its directory is made."""
    with replacing(path) as partial:
        partial.write_text(text, encoding="utf-8")


def write_json(path: str | Path, data: Mapping[str, Any]) -> None:
    """Write strict JSON, whole or not at all; its directory is made, and what is no finite number is null."""
    write_text(path, json.dumps(json_ready(data), indent=1, allow_nan=False) + "\n")


def json_ready(value: Any) -> Any:
    """Tuples as lists, and NaN and infinity, which JSON does not have, as null."""
    if isinstance(value, Mapping):
        return {key: json_ready(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [json_ready(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
