"""A journal of finished work that survives a kill at any moment.

One JSON line a finished item, written and synchronised before the next; the first line names the configuration. A line
cut short by a kill is dropped on reading. Python writes floats with all their digits, so that what is read again equals
what was computed, bit for bit.
"""

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import IO, Any

from femfit.core.errors import RunDirectoryError

JOURNAL_NAME = "journal.jsonl"


@dataclass(frozen=True)
class JournalHeader:
    """What a journal belongs to.

    Parameters
    ----------
    configuration_hash : str
        Of everything that the results depend on.
    """

    configuration_hash: str


class Journal:
    """Append-only record of finished items, used as a context manager.

    Parameters
    ----------
    directory : Path
        Run directory; made if absent.
    header : JournalHeader
        Of this run.

    Raises
    ------
    RunDirectoryError
        If the directory's journal belongs to another configuration.
    """

    def __init__(self, directory: Path, header: JournalHeader) -> None:
        directory.mkdir(parents=True, exist_ok=True)
        self._path = directory / JOURNAL_NAME
        self.finished: dict[str, Any] = {}
        complete = self._read(header, directory)
        self._file: IO[bytes] = self._path.open("r+b" if complete else "wb")
        if complete:
            self._file.truncate(complete)  # drops a line that a kill cut short
            self._file.seek(complete)
        else:
            self._write_line({"configuration_hash": header.configuration_hash})

    def record(self, key: str, result: Mapping[str, Any]) -> None:
        """Append a finished item and wait until it is on disk.

        Parameters
        ----------
        key : str
            Of the item; unique in the run.
        result : mapping
            JSON-ready.
        """
        self._write_line({"key": key, "result": result})
        self.finished[key] = result

    def __enter__(self) -> "Journal":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()

    def _write_line(self, content: Mapping[str, Any]) -> None:
        self._file.write(json.dumps(content).encode() + b"\n")
        self._file.flush()
        os.fsync(self._file.fileno())

    def _read(self, header: JournalHeader, directory: Path) -> int:
        """Fill ``finished`` from an existing journal; return the length of its complete lines."""
        if not self._path.exists():
            return 0
        length, first = 0, True
        for line in self._path.read_bytes().splitlines(keepends=True):
            entry = _parse(line)
            if entry is None:
                break
            if first and entry.get("configuration_hash") != header.configuration_hash:
                raise RunDirectoryError(
                    f"{directory} holds the journal of another configuration (actuator, solver settings or versions "
                    "differ). Use another directory with -o, or delete this one to start afresh."
                )
            if not first:
                self.finished[entry["key"]] = entry["result"]
            first = False
            length += len(line)
        return length


def _parse(line: bytes) -> dict[str, Any] | None:
    if not line.endswith(b"\n"):
        return None
    try:
        entry = json.loads(line)
    except ValueError:
        return None
    return entry if isinstance(entry, dict) else None
