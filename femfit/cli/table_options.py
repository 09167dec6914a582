"""Options of every command that reads a table: what a column is, and in which unit."""

from dataclasses import dataclass
from typing import Annotated

from cyclopts import Parameter

from femfit.core.errors import UsageError


@Parameter(name="*")
@dataclass(frozen=True)
class TableOptions:
    """What a table's columns are, where their headers do not say it."""

    column: Annotated[tuple[str, ...], Parameter(negative=(), show_default=False)] = ()
    """HEADER=COLUMN, for example "Kanal 3=force_N"; once for each column."""

    unit: Annotated[tuple[str, ...], Parameter(negative=(), show_default=False)] = ()
    """HEADER=UNIT, for example Kraft=gf, or a number that multiplies the column to SI; once for each column."""

    @property
    def columns(self) -> dict[str, str]:
        """Header to column."""
        return dict(_pair(text, "--column", "force_N") for text in self.column)

    @property
    def units(self) -> dict[str, str]:
        """Header to unit."""
        return dict(_pair(text, "--unit", "mm") for text in self.unit)

    @property
    def keywords(self) -> dict[str, dict[str, str]]:
        """Both, as the functions that read tables take them."""
        return {"columns": self.columns, "units": self.units}


NO_TABLE_OPTIONS = TableOptions()


def _pair(text: str, option: str, example: str) -> tuple[str, str]:
    header, mark, value = text.rpartition("=")
    if not (mark and header.strip() and value.strip()):
        raise UsageError(f"{option} must be HEADER={example} or the like; instead received {text!r}.")
    return header.strip(), value.strip()
