"""What each number of a drawing changes over a sweep, as ``signatures.parquet`` and ``.json`` beside its table.

A row is of one number at one point; its ``force_N``, ``flux_linkage_Wb`` and ``hall_T`` are slopes, per unit of the
number as the drawing has it, or per one whole of a number without a unit.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import TypeAdapter, ValidationError

from femfit.core.errors import TableError
from femfit.core.files import replacing, write_json
from femfit.core.results import Printed
from femfit.core.sweep_columns import is_flux
from femfit.core.text import amount, quoted
from femfit.device.drawn_numbers import NumberFacts
from femfit.tables.files import read_settings

if TYPE_CHECKING:
    import pandas as pd

STEM = "signatures"


@dataclass(frozen=True, eq=False, repr=False)
class Signatures(Printed):
    """The drawing's numbers and their slopes.

    Parameters
    ----------
    rows : DataFrame
        ``number`` (a key path), the currents, ``distance_m``, and slopes of ``force_N``, of the flux linkages and, with
        a Hall element, of ``hall_T``.
    """

    numbers: tuple[NumberFacts, ...]
    rows: "pd.DataFrame"

    def of(self, number: NumberFacts) -> "pd.DataFrame":
        """The rows of a number."""
        return self.rows[self.rows["number"] == number.key].reset_index(drop=True)

    @property
    def channels(self) -> list[str]:
        """The columns that hold slopes."""
        return [name for name in map(str, self.rows) if name in {"force_N", "hall_T"} or is_flux(name)]

    def __str__(self) -> str:
        """What matters most first: rms change of each channel by one standard deviation of each number."""
        channels = self.channels
        sizes = {
            number: [number.tolerance * float(np.sqrt(np.nanmean(self.of(number)[name] ** 2))) for name in channels]
            for number in self.numbers
        }
        largest = np.max([*sizes.values()], axis=0, initial=0.0)
        largest = np.where(largest > 0.0, largest, 1.0)
        ranked = sorted(self.numbers, key=lambda number: -max(np.array(sizes[number]) / largest))
        return "\n".join(
            f"{number.title} +- {amount(number.tolerance, number.unit)}: "
            + ", ".join(f"{_words(name)} {amount(v, name)}" for name, v in zip(channels, sizes[number], strict=True))
            for number in ranked
        )


def _words(column: str) -> str:
    return "Hall field" if column == "hall_T" else column.rpartition("_")[0].replace("_", " ")


def write_signatures(signatures: Signatures | None, directory: Path) -> None:
    """Write both files, or remove those of an earlier sweep where there are none."""
    if signatures is None:
        for suffix in (".parquet", ".json"):
            (directory / f"{STEM}{suffix}").unlink(missing_ok=True)
        return
    with replacing(directory / f"{STEM}.parquet") as partial:
        signatures.rows.to_parquet(partial, index=False)
    write_json(directory / f"{STEM}.json", {"numbers": [asdict(number) for number in signatures.numbers]})


def read_signatures(directory: Path) -> Signatures | None:
    """Read what :func:`write_signatures` wrote; None where there is nothing.

    Raises
    ------
    TableError
        If a file is damaged.
    """
    import pandas as pd  # noqa: PLC0415  loads while a sweep's workers solve
    import pyarrow as pa  # noqa: PLC0415

    listed, file = directory / f"{STEM}.json", directory / f"{STEM}.parquet"
    if not (listed.is_file() and file.is_file()):
        return None
    try:
        rows = pd.read_parquet(file)
        numbers = _numbers(read_settings(listed, '"numbers": []'))
    except (OSError, ValueError, pa.ArrowException) as error:
        raise TableError(f"{file} cannot be read: {quoted(error, 300)}. Sweep again with --signatures.") from error
    lacking = {"number", "distance_m", "force_N"} - set(rows)
    if lacking:
        raise TableError(f"{file} lacks {', '.join(sorted(lacking))}. Sweep again with --signatures.")
    return Signatures(numbers, rows)


def _numbers(settings: Mapping[str, Any]) -> tuple[NumberFacts, ...]:
    try:
        return TypeAdapter(tuple[NumberFacts, ...]).validate_python(settings.get("numbers"))
    except ValidationError as error:
        raise ValueError(str(error)) from error
