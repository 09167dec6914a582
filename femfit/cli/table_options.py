"""Options of every command that reads a table: what a column is, and in which unit."""

from dataclasses import dataclass
from typing import Annotated, TypedDict

from cyclopts import Parameter

from femfit.core.errors import UsageError
from femfit.tables.units import is_unit


class Keywords(TypedDict):
    """Keywords of the functions that read tables."""

    columns: dict[str, str]
    units: dict[str, str]
    table: str | None


@Parameter(name="*")
@dataclass(frozen=True)
class TableOptions:
    """What a table's columns are, where their headers do not say it."""

    column: Annotated[tuple[str, ...], Parameter(negative=(), show_default=False)] = ()
    """Column of a header as HEADER=COLUMN, for example "Kanal 3=force_N"; may be repeated."""

    unit: Annotated[tuple[str, ...], Parameter(negative=(), show_default=False)] = ()
    """Unit of a header as HEADER=UNIT (Kraft=gf), HEADER=FACTOR to SI, or alone (gf) for the only fitting column."""

    table: Annotated[str | None, Parameter(show_default=False)] = None
    """Sheet, group or struct of a file that holds several tables (XLSX, MAT, HDF5, TDMS)."""

    @property
    def columns(self) -> dict[str, str]:
        """Header to column."""
        return dict(_pair(text, "--column", "force_N") for text in self.column)

    @property
    def units(self) -> dict[str, str]:
        """Header to unit."""
        alone = {text.strip(): text.strip() for text in self.unit if "=" not in text and is_unit(text)}
        return alone | dict(_pair(text, "--unit", "mm") for text in self.unit if text.strip() not in alone)

    @property
    def keywords(self) -> Keywords:
        """All of them, as the functions that read tables take them."""
        return {"columns": self.columns, "units": self.units, "table": self.table}


class MeasurementKeywords(Keywords):
    """Keywords of the functions that read measurements."""

    noise: dict[str, float]
    settings: dict[str, float]


@Parameter(name="*")
@dataclass(frozen=True)
class MeasurementOptions(TableOptions):
    """What a measurement's columns are, and how large their noise is."""

    noise: Annotated[tuple[str, ...], Parameter(negative=(), show_default=False)] = ()
    """Noise of one reading as CHANNEL=STANDARD DEVIATION (force_N=2e-4), which counts before the sidecar's."""

    setting: Annotated[tuple[str, ...], Parameter(negative=(), show_default=False)] = ()
    """Setting without a column that was the same throughout, as COLUMN=NUMBER in any unit (distance_mm=2)."""

    @property
    def keywords(self) -> MeasurementKeywords:
        """All of them, as the functions that read measurements take them."""
        noise = dict(_number(text, "--noise", "force_N", "2e-4") for text in self.noise)
        settings = dict(_number(text, "--setting", "distance_mm", "2") for text in self.setting)
        return {**super().keywords, "noise": noise, "settings": settings}


NO_TABLE_OPTIONS = TableOptions()
NO_MEASUREMENT_OPTIONS = MeasurementOptions()


def _pair(text: str, option: str, example: str, name: str = "HEADER") -> tuple[str, str]:
    header, mark, value = text.rpartition("=")
    if not (mark and header.strip() and value.strip()):
        raise UsageError(f"{option} must be {name}={example} or the like; instead received {text!r}.")
    return header.strip(), value.strip()


def _number(text: str, option: str, name: str, example: str) -> tuple[str, float]:
    key, value = _pair(text, option, example, name)
    try:
        return key, float(value)
    except ValueError as error:
        raise UsageError(f"{option} must be a number, as in {name}={example}; instead received {text!r}.") from error
