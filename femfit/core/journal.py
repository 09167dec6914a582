"""A journal of finished work that survives a kill at any moment, and a disk that is full for a while.

One JSON line a finished item with its checksum, written and synchronised before the next; the first line names the
configuration. A line that a kill cut short or that was changed is dropped on reading. Python writes floats with all
their digits, so that what is read again equals what was computed, bit for bit.
"""

import errno
import fcntl
import json
import os
import re
import zlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

from femfit.core.errors import RunDirectoryError

JOURNAL_NAME = "journal.jsonl"
NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""A full disk, a full quota, a file beyond the limit: what is finished waits in memory until there is room."""


@dataclass(frozen=True)
class JournalHeader:
    """What a journal belongs to: the hash of a whole configuration, and of each of its parts by name."""

    configuration_hash: str
    parts: Mapping[str, str]


class Journal:
    """Append-only record of finished items, used as a context manager; one process at a time.

    A journal of another configuration, an edited drawing's say, is kept under a name of its own and taken up again when
    that configuration comes back; ``changed`` names the parts that made this one start empty instead, none where it
    goes on.
    """

    def __init__(self, directory: Path, header: JournalHeader) -> None:
        try:
            directory.mkdir(parents=True, exist_ok=True)
        except (FileExistsError, NotADirectoryError) as error:
            raise RunDirectoryError(
                f"{directory} cannot be a run's directory: a file is in its place. Give another directory with -o."
            ) from error
        self.finished: dict[str, Any] = {}
        self._waiting: list[bytes] = []
        self.changed: tuple[str, ...] = ()
        self._file = (directory / JOURNAL_NAME).open("a+b", buffering=0)
        try:
            self._lock(directory)
            self._length = self._read(self._taken_up(header, directory))
            self._file.truncate(self._length)  # drops a line that a kill cut short
        except BaseException:
            self._file.close()
            raise
        if not self._length:
            self._write_line(asdict(header))

    @property
    def on_disk(self) -> int:
        """How many finished items are in the file; fewer than all while the disk is full."""
        return max(len(self.finished) - len(self._waiting), 0)

    def record(self, key: str, result: Mapping[str, Any]) -> None:
        """Append a finished item and wait until it is on disk, unless that is full."""
        self.finished[key] = result
        self._write_line({"key": key, "result": result, "checksum": _checksum(key, result)})

    def __enter__(self) -> "Journal":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()

    def _write_line(self, content: Mapping[str, Any]) -> None:
        """Write a line behind those that wait; what finds no room waits for the next time."""
        self._waiting.append(json.dumps(content).encode() + b"\n")
        while self._waiting:
            try:
                written, line = 0, self._waiting[0]
                while written < len(line):
                    written += self._file.write(line[written:]) or 0
                os.fsync(self._file.fileno())
            except OSError as error:
                if error.errno not in NO_ROOM:
                    raise
                self._file.truncate(self._length)  # what was written of the line
                return
            self._length += len(self._waiting.pop(0))

    def _lock(self, directory: Path) -> None:
        """Keep other processes out; the system unlocks when this one ends, however it does."""
        try:
            fcntl.flock(self._file.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise RunDirectoryError(
                f"{directory} is in use by another femfit process. Wait for it, or use another directory with -o."
            ) from error

    def _taken_up(self, header: JournalHeader, directory: Path) -> bytes:
        """What this configuration's journal holds, also where it was put aside; that of another is put aside."""
        self._file.seek(0)
        content = self._file.read()
        first = _header(content)
        if first is not None and first.configuration_hash == header.configuration_hash:
            return content
        aside = _kept(directory, header.configuration_hash)
        if first is not None:
            _kept(directory, first.configuration_hash).write_bytes(content)
        elif b"\n" in content and not aside.exists():
            self.changed = ("the journal's first line, which is damaged",)
        self._file.truncate(0)
        if aside.exists():
            again = aside.read_bytes()
            self._file.write(again)  # into the same file, which is the locked one
            aside.unlink()
            return again
        if first is not None:
            changed = tuple(name for name, content in header.parts.items() if first.parts.get(name) != content)
            self.changed = changed if first.parts else ("the version of femfit",)
        return b""

    def _read(self, content: bytes) -> int:
        """Fill ``finished`` from a journal; return the length of its complete lines."""
        if _header(content) is None:
            return 0
        length = content.index(b"\n") + 1
        for line in content[length:].splitlines(keepends=True):
            entry = _parse(line) or {}
            key, result = entry.get("key"), entry.get("result")
            if not isinstance(key, str) or not isinstance(result, dict):
                break
            if entry.get("checksum") != _checksum(key, result):
                break  # what is damaged is dropped with all behind it, and worked out again
            self.finished[key] = result
            length += len(line)
        return length


def holds(directory: Path, configuration_hash: str) -> bool:
    """Whether a directory has a configuration's journal, be it put aside."""
    try:
        with (directory / JOURNAL_NAME).open("rb") as file:
            first = _header(file.readline())
    except (FileNotFoundError, NotADirectoryError):
        return False
    current = first is not None and first.configuration_hash == configuration_hash
    return current or _kept(directory, configuration_hash).exists()


def _kept(directory: Path, configuration_hash: str) -> Path:
    """Where the journal of another configuration waits."""
    return directory / f"journal-{configuration_hash[:12]}.jsonl"


def _header(content: bytes) -> JournalHeader | None:
    """What a journal belongs to, by its first line; None where that does not say it."""
    entry = _parse(content[: content.find(b"\n") + 1]) or {}
    hashed, parts = entry.get("configuration_hash"), entry.get("parts", {})  # no parts before there were any
    if not isinstance(hashed, str) or not re.fullmatch(r"[0-9a-f]+", hashed) or not isinstance(parts, dict):
        return None
    return JournalHeader(hashed, parts)


def _checksum(key: str, result: Mapping[str, Any]) -> int:
    return zlib.crc32(json.dumps([key, result]).encode())


def _parse(line: bytes) -> dict[str, Any] | None:
    try:
        entry = json.loads(line)
    except (ValueError, RecursionError):
        return None
    return entry if isinstance(entry, dict) and line.endswith(b"\n") else None
