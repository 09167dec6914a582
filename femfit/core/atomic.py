"""Files that are written whole or not at all.

What is written goes to a file beside the target and takes its place when it is complete: a kill, a full disk or an
error in between leaves an earlier file of that name as it was.
"""

import errno
import json
import math
import os
import secrets
import stat
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
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
    device = Path(path).exists() and not Path(path).is_file() and not target.is_dir()
    # A name that nobody can foresee, of a file that must be new: a link laid in its place would be written through
    name = f".{target.stem[:40]}.{secrets.token_hex(8)}.partial{target.suffix}"
    # A pipe behind /dev/stdout has no path of its own
    partial = Path(path) if device else target.parent / name
    try:
        if device:
            yield partial
            return
        mode = _prepare(path, target, partial)
        yield partial
        if mode is not None:
            partial.chmod(mode)
        partial.replace(target)
    except OSError as error:
        if error.errno is not None and error.filename in (None, str(partial), partial):
            raise OSError(error.errno, error.strerror, str(path)) from error
        raise
    finally:
        if not device:
            with suppress(OSError):  # what cannot be made cannot be removed, and the first error says why
                partial.unlink(missing_ok=True)


def _prepare(path: str | Path, target: Path, partial: Path) -> int | None:
    """Make the file that is written to; return the permissions of the one that it replaces, if there is one."""
    if target.is_dir() or str(path).endswith(os.sep):
        raise IsADirectoryError(errno.EISDIR, "Is a directory, where a file is to be written", str(path))
    if target.is_symlink():  # a link that could be followed is resolved by now
        raise OSError(errno.ELOOP, os.strerror(errno.ELOOP), str(path))
    target.parent.mkdir(parents=True, exist_ok=True)
    mode = stat.S_IMODE(target.stat().st_mode) if target.exists() else None
    # Less what the umask denies; what replaces a secret is one before it is complete
    os.close(os.open(partial, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666 if mode is None else 0o600))
    return mode


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
