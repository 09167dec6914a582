"""Options of every command that reads a table: what a column is, and in which unit."""

from dataclasses import dataclass
from typing import Annotated, TypedDict

from cyclopts import Parameter

from femfit.core.errors import TableError


class Keywords(TypedDict):
    """Keywords of the functions that read tables."""

    columns: dict[str, str]
    units: dict[str, str]
    table: str | None


@dataclass(frozen=True)
class TableOptions:
    """What a table's columns are, where their headers do not say it."""

    column: Annotated[tuple[str, ...], Parameter(negative=(), show_default=False)] = ()
    """HEADER=COLUMN, for example "Kanal 3=force_N"; once for each column."""

    unit: Annotated[tuple[str, ...], Parameter(negative=(), show_default=False)] = ()
    """HEADER=UNIT, for example Kraft=gf, or a number that multiplies the column to SI; once for each column. A unit
    alone (gf) is that of the only column that it can be of."""

    table: Annotated[str | None, Parameter(show_default=False)] = None
    """Sheet, group or struct of a file that holds several tables (XLSX, MAT, HDF5, TDMS)."""

    @property
    def columns(self) -> dict[str, str]:
        """Header to column."""
        return dict(_pair(text, "--column", "force_N") for text in self.column)

    @property
    def units(self) -> dict[str, str]:
        """Header to unit."""
        alone = [text.strip() for text in self.unit if text.strip() and "=" not in text]
        return dict(_pair(text, "--unit", "mm") for text in self.unit if text.strip() not in alone) | {
            unit: unit for unit in alone
        }

    @property
    def keywords(self) -> Keywords:
        """All of them, as the functions that read tables take them."""
        return {"columns": self.columns, "units": self.units, "table": self.table}


NO_TABLE_OPTIONS = TableOptions()


def _pair(text: str, option: str, example: str) -> tuple[str, str]:
    header, mark, value = text.rpartition("=")
    if not (mark and header.strip() and value.strip()):
        raise TableError(f"{option} must be HEADER={example} or the like; instead received {text!r}.")
    return header.strip(), value.strip()
