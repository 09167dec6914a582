"""The one reader of measured tables: which columns a kind of table wants, and what a file has of them in SI."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path

import pandas as pd

from femfit.core.errors import TableError
from femfit.core.results import Finding, listing
from femfit.core.text import amount, counted
from femfit.tables.circuit_columns import circuit_columns, parts_of
from femfit.tables.columns import UsedColumn, column_values, match_columns, recognise, remedy_for_columns
from femfit.tables.findings import finding
from femfit.tables.measurement_sidecar import NO_WORDS, Words
from femfit.tables.raw_table import RawTable, file_content
from femfit.tables.table_file import parse_table


@dataclass(frozen=True)
class Wants:
    """What a kind of table may have, and what of it it must have."""

    what: str
    names: tuple[str, ...]  # Columns that it may have; where a header could be two of them, it is the first
    needs: tuple[str, ...]
    one_of: tuple[str, ...] = ()
    circuits: Collection[str] = ()  # Those that may carry a circuit's name
    hints: Mapping[str, str] = field(default_factory=dict)  # What else can be done where a column is missing
    guess: bool = False  # Whether a name may stand inside a header, as in ``Fz, total``
    renamed: bool = False  # Whether the user can only rename columns, as no option says what they are

    def columns(self, headers: Iterable[str], words: Words) -> tuple[str, ...]:
        """What a table with such headers may have, those of several circuits after the others."""
        of_circuits = circuit_columns((*headers, *words.columns.values()))
        return (*self.names, *(name for name in of_circuits if parts_of(name)[0] in self.circuits))

    def fits(self, raw: RawTable, words: Words) -> bool:
        """Whether a table has what is needed, as its columns are recognised and named by the user."""
        names = self.columns(raw.headers, words)
        try:
            used, _, _ = match_columns(
                raw.headers, raw.source, names, words.columns, words.units, guess=self.guess, optional=names
            )
        except TableError:  # it lacks a column that the user named
            return False
        return not self.lacking([*(column.name for column in used.values()), *words.settings])

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
        remedies = [
            "Rename the columns or add them." if self.renamed else remedy,
            *(self.hints[name] for name in missing if name in self.hints),
        ]
        raise TableError(
            f"A {self.what} must have {', '.join(self.needs)}{' and at least one channel' if self.one_of else ''}, "
            f"with numbers in them; {source} lacks {' and '.join(missing)} (it has "
            f"{', '.join(columns) or 'none of the known columns'}). "
            f"{' '.join([*reasons[:4], *remedies])}"
        )


@dataclass(frozen=True, eq=False)
class ReadTable:
    """What a file has of the columns that were wanted."""

    rows: pd.DataFrame  # In SI; NaN where a cell holds no finite number
    used: list[UsedColumn]
    findings: list[Finding]


def read_raw_table(
    path: Path, what: str = "measurement", kinds: Sequence[Wants] = (), words: Words = NO_WORDS
) -> RawTable:
    """Read the cells of a measured file under their headers; of several tables in it, the one of such a kind."""
    raw = parse_table(
        file_content(path, what),
        str(path),
        table=words.table,
        wanted=(lambda table: any(kind.fits(table, words) for kind in kinds)) if kinds else None,
        open_decimal=",",
    )
    if not raw.headers:
        raise TableError(
            f"{path} must have as many column names as columns; there is no line of "
            f"{counted(raw.numbers.shape[1], 'name')} above "
            f"its rows of {counted(raw.numbers.shape[1], 'cell')}. Complete the line of names."
        )
    twice = [header for k, header in enumerate(raw.headers) if header and header in raw.headers[:k]]
    if twice:
        raise TableError(
            f"{path} has more than one column named {listing(dict.fromkeys(twice))}. Rename or remove one."
        )
    return raw


def read_columns(raw: RawTable, wants: Wants, words: Words) -> ReadTable:
    """What a file has of the columns that a kind of table may have, and what was the same in every row of it."""
    filled = [header for k, header in enumerate(raw.headers) if header or any(raw.texts[k])]
    names = wants.columns(raw.headers, words)
    used, recognised = recognise(filled, raw.source, names, words.columns, words.units)
    if not len(raw.lines):
        raise TableError(f"{raw.source} has column names and no row below them; it needs one row a reading.")
    rows, remarks = column_values(raw, used)
    findings = [finding("reading", note=note[0].upper() + note[1:]) for note in raw.notes] + recognised + remarks
    for name, value in words.settings.items():
        if name in rows and rows[name].notna().any():
            raise TableError(
                f"{raw.source} has a column {name}, so that it is no constant setting. Leave out the setting of "
                f"{amount(value, name, 4)}."
            )
        rows = rows.assign(**{name: value})
        findings.append(finding("constant-setting", column=name, value=amount(value, name, 4)))
    wants.require(list(map(str, rows)), raw.headers, raw.source, used, findings)
    return ReadTable(rows, used, findings)
