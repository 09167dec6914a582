"""The one reader of measured tables: which columns a kind of table wants, and what a file has of them in SI.

What a user says of a table, in the call or in a ``.toml`` beside the file, its sidecar.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from itertools import chain
from pathlib import Path
from typing import Any, TypeVar

import pandas as pd

from femfit.core.errors import TableError
from femfit.core.files import finite_number, read_settings
from femfit.core.results import Finding, listing
from femfit.core.sweep_columns import is_current
from femfit.core.text import amount, quoted
from femfit.tables.columns import UsedColumn, column_values, match_column, match_columns, remedy_for_columns
from femfit.tables.containers import parse_table
from femfit.tables.findings import finding, refused
from femfit.tables.header import circuit_columns, matching_headers, parts_of
from femfit.tables.measurement import OF_RUNS, SETTINGS
from femfit.tables.raw_table import RawTable, file_content
from femfit.tables.units import possible_range

_EXAMPLE = "force_N = 2e-4"
_MISSPELT = 0.75
"""Assumed: likeness of a table's name from which another one is meant."""

_OF_OTHERS = frozenset({"schema", "sweep", "sample_rate_Hz"})
"""Keys that an actuator file, or the layout of a raw coil record, has and a sidecar does not."""

_LINES: dict[str, tuple[str, tuple[type, ...]]] = {
    "columns": ('"Kanal 3" = "force_N"', (str,)),
    "units": ('"Kanal 3" = "gf", or "channel 1" = 2.5', (str, int, float)),
    "noise": (_EXAMPLE, (object,)),
    "settings": ("distance_mm = 2.0", (object,)),
}
"""What a user says of columns: lines like this one, with values of these types."""


def _lines(value: Any, key: str, what: str) -> dict[str, Any]:
    """What is said of columns by name, in a sidecar or a call; refused where it is of another form."""
    example, kinds = _LINES[key]
    named = isinstance(value, Mapping) and all(isinstance(name, str) for name in value)
    if not named or not all(isinstance(meant, kinds) for meant in value.values()):
        raise TableError(f"{what} must hold lines like {example}; instead received {quoted(value)}.")
    return dict(value)


@dataclass(frozen=True)
class Words:
    """How a table is to be read, and what is known of it beside its readings."""

    columns: Mapping[str, str] = field(default_factory=dict)  # Header to the column that it is
    units: Mapping[str, str | float] = field(default_factory=dict)  # Header or column to its unit, or factor to SI
    table: str | None = None  # Which of a file's tables
    noise: Mapping[str, float] = field(default_factory=dict)  # As the caller declares it
    settings: Mapping[str, float] = field(default_factory=dict)  # What was the same in every row, once read in SI
    sidecar: Path | None = None
    noted: Mapping[str, Any] = field(default_factory=dict)  # What else the sidecar says, the noise among it

    def __post_init__(self) -> None:
        """Refuse what cannot be read, whoever says it."""
        for key in _LINES:
            _lines(getattr(self, key), key, key)

    @property
    def texts(self) -> dict[str, str]:
        """What the sidecar says of the test object, and its notes."""
        return {key: str(self.noted.get(key, "")) for key in ("test_object", "notes")}


NO_WORDS = Words()
Said = TypeVar("Said", bound=Words)


def words_of(measurement: Path, caller: Said) -> Said:
    """Return what the caller says of a table, before what ``NAME.csv.toml`` or else ``NAME.toml`` beside it says."""
    file, noted = _sidecar(measurement)
    columns, units, settings = (
        _lines(noted.pop(key, {}), key, f"[{key}] of {file}") for key in ("columns", "units", "settings")
    )
    settings = constant_settings(settings, str(file)) | constant_settings(caller.settings, "the options")
    table = noted.pop("table", None)
    if not isinstance(table, str | None):
        raise TableError(f'table in {file} must be a name like "Messung 2"; instead received {quoted(table)}.')
    table = table if caller.table is None else caller.table
    columns, units = columns | dict(caller.columns), units | dict(caller.units)
    return replace(caller, columns=columns, units=units, table=table, settings=settings, sidecar=file, noted=noted)


def _sidecar(measurement: Path) -> tuple[Path | None, dict[str, Any]]:
    """The sidecar and what is in it; a drawing or a raw record's layout of the same name is none."""
    if not measurement.is_file():  # a directory such as . has no name
        return None, {}
    for file in (measurement.with_name(f"{measurement.name}.toml"), measurement.with_suffix(".toml")):
        if file.is_file() and file != measurement:
            data = read_settings(file, _EXAMPLE)
            if not _OF_OTHERS.intersection(data):
                return file, data
    return None, {}


def constant_settings(settings: Mapping[str, Any], where: str) -> dict[str, float]:
    """Column to value in SI of what a sidecar or an option says: ``distance_mm = 2.0``."""
    names = (*SETTINGS, *filter(is_current, circuit_columns(map(str, settings), fewest=1)))
    result = {}
    for key, value in settings.items():
        column, number = match_column(str(key), names), finite_number(value)
        if column is None or column.assumed or number is None:
            raise refused("no-setting", where=where, settings=", ".join(SETTINGS), line=quoted(f"{key} = {value}"))
        result[column.name] = column.factor * number
        low, high = possible_range(parts_of(column.name)[0])
        if not low <= result[column.name] <= high:
            line, limits = quoted(f"{key} = {value}"), f"{low:g} to {high:g}"
            raise refused("impossible-setting", where=where, column=column.name, limits=limits, line=line)
    return result


def declared_noise(
    words: Words, channels: Sequence[str], used: Sequence[UsedColumn]
) -> tuple[dict[str, float], list[Finding]]:
    """The standard deviation of each channel that one is declared of, in the channel's unit.

    In a sidecar it stands at the top or under ``[noise]``: ``force_N = 2e-4``, or ``force_mN = 0.2``, or with the
    header of its column, whose unit it then has; that of what all readings of a run share under ``[noise.run]``, or as
    ``run.force_N``. What the caller declares counts in its place.
    """
    beside = {key: value for key, value in words.noted.items() if key not in words.texts}
    listed = _lines(beside.pop("noise", {}), "noise", f"[noise] of {words.sidecar}")
    of_runs = _lines(listed.pop("run", {}), "noise", f"[noise.run] of {words.sidecar}")
    listed |= {OF_RUNS + key: value for key, value in of_runs.items()}
    findings, loose = [], dict(beside)
    for key, value in beside.items():
        # What nobody calls noise may be a table of another kind of file, a drawing's [hall] say
        kind = isinstance(value, dict)
        if kind and (near := get_close_matches(key.casefold()[:100], _LINES, n=1, cutoff=_MISSPELT)):
            raise refused("misspelt-table", key=quoted(key), file=words.sidecar, near=near[0])
        if kind or not (_channel(key, channels, used) or get_close_matches(key[:100], channels, n=1)):
            del loose[key]
            facts = {"key": quoted(key), "file": Path(str(words.sidecar)).name, "channels": ", ".join(channels)}
            findings.append(finding("unused-setting", **facts))
    noise = {}
    for where, entries in ((words.sidecar, (loose, listed)), ("the declared noise", (words.noise,))):
        keys: dict[str, str] = {}
        for key, value in (line for lines in entries for line in lines.items()):
            column, sigma = _channel(key, channels, used), finite_number(value)
            if column is None:
                raise refused("noise-of-no-channel", key=quoted(key), where=where, channels=", ".join(channels))
            if sigma is None or sigma <= 0.0:
                raise refused("no-noise", key=quoted(key), where=where, value=quoted(value))
            if first := keys.get(column.name):
                raise refused("noise-twice", where=where, name=column.name, first=quoted(first), second=quoted(key))
            noise[column.name], keys[column.name] = sigma * column.factor, key
    return noise, findings


def _channel(key: str, channels: Sequence[str], used: Sequence[UsedColumn]) -> UsedColumn | None:
    """The channel that a key means: by its name, with another unit, or by the header of its column."""
    prefix = OF_RUNS if key.startswith(OF_RUNS) else ""
    key, names = key.removeprefix(prefix), [name.removeprefix(prefix) for name in channels if name.startswith(prefix)]
    headed = (column for column in used if column.name in names and matching_headers(key, [column.header]))
    channel = match_column(key, names) if key in names else next(headed, match_column(key, names))
    return replace(channel, name=prefix + channel.name) if channel else None


@dataclass(frozen=True)
class Wants:
    """What a kind of table may have, and what of it it must have."""

    what: str
    names: tuple[str, ...]  # Columns that it may have; where a header could be two of them, it is the first
    needs: tuple[str, ...]
    one_of: tuple[str, ...] = ()
    circuits: Collection[str] = ()  # Those that may carry a circuit's name
    hints: Mapping[str, str] = field(default_factory=dict)  # What else can be done where a column is missing

    def columns(self, headers: Iterable[str], words: Words) -> tuple[str, ...]:
        """What a table with such headers may have, those of several circuits after the others."""
        of_circuits = circuit_columns((*headers, *words.columns.values()))
        return (*self.names, *(name for name in of_circuits if parts_of(name)[0] in self.circuits))

    def fits(self, raw: RawTable, words: Words) -> bool:
        """Whether a table has what is needed, as its columns are recognised and named by the user."""
        names = self.columns(raw.headers, words)
        try:
            used, _ = match_columns(raw.headers, raw.source, names, words.columns, words.units, names)
        except TableError:  # it lacks a column that the user named
            return False
        return not self.lacking([*(column.name for column in used), *words.settings])

    def lacking(self, columns: Iterable[str]) -> dict[str, tuple[str, ...]]:
        """What is missing beside some columns, each with the columns that would do."""
        quantities = {parts_of(column)[0] for column in columns}
        missing: dict[str, tuple[str, ...]] = {name: (name,) for name in self.needs if name not in quantities}
        if self.one_of and quantities.isdisjoint(self.one_of):
            missing[f"one of {', '.join(self.one_of)}"] = self.one_of
        return missing

    def require(
        self,
        columns: Collection[str],
        headers: Iterable[str],
        source: str,
        used: Iterable[UsedColumn],
        findings: Iterable[Finding] = (),
    ) -> None:
        """Refuse a table whose columns lack what is needed, and say which of its headers may be it."""
        missing = self.lacking(columns)
        if not missing:
            return
        taken = {column.header for column in used}
        unused = [header for header in headers if header.strip() and header not in taken]
        reasons = [remark.text for remark in findings if remark.column and remark.column not in columns]
        remedy = remedy_for_columns(unused, [*chain(*missing.values())])
        remedies = [remedy, *(self.hints[name] for name in missing if name in self.hints)]
        raise refused(
            "lacking-columns",
            what=self.what,
            needs=", ".join(self.needs),
            channel=" and at least one channel" if self.one_of else "",
            source=source,
            lacking=" and ".join(missing),
            columns=", ".join(columns) or "none of the known columns",
            remedies=" ".join([*reasons[:4], *remedies]),
        )


ReadTable = tuple[pd.DataFrame, list[UsedColumn], list[Finding]]
"""What a file has of the columns that were wanted: rows in SI, NaN where a cell holds no finite number."""


def read_raw_table(
    path: Path, what: str = "measurement", kinds: Sequence[Wants] = (), words: Words = NO_WORDS
) -> RawTable:
    """Read the cells of a measured file under their headers; of several tables in it, the one of such a kind."""
    raw = parse_table(
        file_content(path, what),
        str(path),
        table=words.table,
        wanted=lambda table: not kinds or any(kind.fits(table, words) for kind in kinds),
        open_decimal=",",
    )
    if not raw.headers:
        width = len(raw.cells)
        raise refused("lacking-names", path=path, names=width, cells=width)
    require_single_names(raw.headers, str(path))
    return raw


def require_single_names(headers: Sequence[str], source: str) -> None:
    """Refuse a table with two columns of one name."""
    twice = [header for k, header in enumerate(headers) if header and header in headers[:k]]
    if twice:
        raise refused("same-names", source=source, headers=listing(dict.fromkeys(twice)))


def read_columns(raw: RawTable, wants: Wants, words: Words) -> ReadTable:
    """What a file has of the columns that a kind of table may have, and what was the same in every row of it."""
    names = wants.columns(raw.headers, words)
    used, findings = match_columns(raw.headers, raw.source, names, words.columns, words.units)
    if not len(raw.lines):
        raise TableError(f"{raw.source} has column names and no row below them; it needs one row a reading.")
    rows, remarks = column_values(raw, used)
    notes = [finding("reading", note=note[0].upper() + note[1:]) for note in raw.notes]
    conversions = [column.conversion() for column in used if column.header.strip() != column.name]
    findings = [*notes, *findings, *conversions, *remarks]
    for name, value in words.settings.items():
        if name in rows and rows[name].notna().any():
            raise refused("setting-and-column", source=raw.source, name=name, value=amount(value, name, 4))
        rows = rows.assign(**{name: value})
        findings.append(finding("constant-setting", column=name, value=amount(value, name, 4)))
    wants.require(list(map(str, rows)), raw.headers, raw.source, used, findings)
    return rows, used, findings
