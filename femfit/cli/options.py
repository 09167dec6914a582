"""Options that several commands have: what a table's columns are, names with commas, names with their numbers."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypedDict, TypeVar

from cyclopts import Parameter
from cyclopts.validators import Number

from femfit.core.errors import UsageError
from femfit.tables.units import is_unit

if TYPE_CHECKING:
    from femfit.tables.measurement import Measurement

Value = TypeVar("Value")

POSITIVE, NOT_NEGATIVE = Parameter(validator=Number(gt=0.0)), Parameter(validator=Number(gte=0.0))
AT_LEAST_ONE = Parameter(validator=Number(gte=1))
REPEATED = Parameter(negative=(), show_default=False)
FLAG = Parameter(negative=())

_TO_SI = {"_mm": ("_m", 1e-3), "_um": ("_m", 1e-6), "_ms": ("_s", 1e-3), "_uV": ("_V", 1e-6), "_g": ("_kg", 1e-3)}


def in_si(options: object) -> dict[str, Any]:
    """A group of options as keywords of the library: what is given in mm, um, ms, uV or g becomes SI, name and all."""
    keywords = {}
    for name, value in vars(options).items():
        stem, mark, unit = name.rpartition("_")
        si, factor = _TO_SI.get(mark + unit, (mark + unit, None))
        keywords[stem + si] = value if value is None or factor is None else factor * value
    return keywords


def names_of(text: str | None) -> tuple[str, ...]:
    """Names with commas between them."""
    return tuple(name for part in (text or "").split(",") if (name := part.strip()))


def parsed(text: str, option: str, form: str, example: str, value_of: Callable[[str], Value]) -> Value:
    """The value of an option's text; a ValueError of ``value_of`` is a wrong use of the option."""
    try:
        return value_of(text)
    except ValueError as error:
        raise UsageError(f"{option} must read {form}, as in {example}; instead received {text!r}.") from error


def pairs(
    texts: Iterable[str], option: str, form: str, example: str, value_of: Callable[[str], Value]
) -> dict[str, Value]:
    """What an option gives as NAME=VALUE, by name."""

    def pair(text: str) -> tuple[str, Value]:
        name, _, value = (part.strip() for part in text.rpartition("="))
        if not (name and value):
            raise ValueError(text)
        return name, value_of(value)

    return dict(parsed(text, option, form, example, pair) for text in texts)


def numbers(texts: Iterable[str], option: str, name: str, example: str) -> dict[str, float]:
    """Numbers of an option that gives them by name."""
    return pairs(texts, option, f"{name}=NUMBER", example, float)


class Keywords(TypedDict):
    """Keywords of the functions that read tables."""

    columns: dict[str, str]
    units: dict[str, str]
    table: str | None


@Parameter(name="*")
@dataclass(frozen=True)
class TableOptions:
    """What a table's columns are, where their headers do not say it.

    Attributes
    ----------
    column : tuple of str
        Column of a header as HEADER=COLUMN, for example "Kanal 3=force_N"; may be repeated.
    unit : tuple of str
        Unit of a header as HEADER=UNIT (Kraft=gf), HEADER=FACTOR to SI, or alone (gf) for the only fitting column.
    table : str
        Sheet, group or struct of a file that holds several tables (XLSX, MAT, HDF5, TDMS).
    """

    column: Annotated[tuple[str, ...], REPEATED] = ()
    unit: Annotated[tuple[str, ...], REPEATED] = ()
    table: Annotated[str | None, Parameter(show_default=False)] = None

    @property
    def keywords(self) -> Keywords:
        """All of them, as the functions that read tables take them."""
        alone = {text.strip(): text.strip() for text in self.unit if "=" not in text and is_unit(text)}
        named = (text for text in self.unit if text.strip() not in alone)
        return {
            "columns": pairs(self.column, "--column", "HEADER=COLUMN", "Kraft=force_N", str),
            "units": alone | pairs(named, "--unit", "HEADER=UNIT", "Kraft=mN", str),
            "table": self.table,
        }


@Parameter(name="*")
@dataclass(frozen=True)
class MeasurementOptions(TableOptions):
    """What a measurement's columns are, and how large their noise is.

    Attributes
    ----------
    noise : tuple of str
        Noise of one reading as CHANNEL=STANDARD DEVIATION (force_N=2e-4), which counts before the sidecar's.
    setting : tuple of str
        Setting without a column that was the same throughout, as COLUMN=NUMBER in any unit (distance_mm=2).
    """

    noise: Annotated[tuple[str, ...], REPEATED] = ()
    setting: Annotated[tuple[str, ...], REPEATED] = ()

    def read(self, path: Path) -> "Measurement":
        """A bench table or a record over time, as its sidecar and these options say."""
        from femfit.tables.measurement_file import read_measurement

        return read_measurement(path, **self.keywords, **self.stated)

    @property
    def stated(self) -> dict[str, dict[str, float]]:
        """Noise and settings, as the functions that read measurements take them."""
        return {
            "noise": numbers(self.noise, "--noise", "CHANNEL", "force_N=2e-4"),
            "settings": numbers(self.setting, "--setting", "COLUMN", "distance_mm=2"),
        }


NO_TABLE_OPTIONS = TableOptions()
NO_MEASUREMENT_OPTIONS = MeasurementOptions()
