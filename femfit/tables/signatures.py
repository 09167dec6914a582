"""What each number of a drawing changes over a sweep, as files beside its table.

``signatures.parquet`` and ``.json`` are of the force, the flux linkages and the Hall field at rest,
``impedance_slopes.npz`` of the inductances at frequencies.

A row is of one number at one point; its ``force_N``, ``flux_linkage_Wb`` and ``hall_T`` are slopes, per unit of the
number as the drawing has it, or per one whole of a number without a unit.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import TypeAdapter

from femfit.core.files import read_arrays, read_settings, reading, replacing, write_json
from femfit.core.numerics import LARGEST, ComplexArray, FloatArray
from femfit.core.results import Printed
from femfit.core.sweep_columns import is_flux
from femfit.core.text import amount
from femfit.device.drawn_numbers import NumberFacts

if TYPE_CHECKING:
    import pandas as pd

STEM = "signatures"
_NUMBERS = TypeAdapter(tuple[NumberFacts, ...])
_REMEDY = "Sweep again with --signatures."


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
        words = {name: name.rpartition("_")[0].replace("_", " ") for name in channels} | {"hall_T": "Hall field"}
        sizes = {
            number: number.tolerance * np.sqrt(np.nanmean(self.of(number)[channels].to_numpy() ** 2, axis=0))
            for number in self.numbers
        }
        largest = np.max([*sizes.values()], axis=0, initial=np.finfo(np.float64).tiny)
        lines = []
        for number in sorted(self.numbers, key=lambda number: -max(sizes[number] / largest)):
            changes = (f"{words[name]} {amount(v, name)}" for name, v in zip(channels, sizes[number], strict=True))
            lines.append(f"{number.title} +- {amount(number.tolerance, number.unit)}: {', '.join(changes)}")
        return "\n".join(lines)


def write_signatures(signatures: Signatures | None, directory: Path) -> None:
    """Write both files, or remove those of an earlier sweep where there are none."""
    parquet, listed = (directory / f"{STEM}{suffix}" for suffix in (".parquet", ".json"))
    if signatures is None:
        parquet.unlink(missing_ok=True)
        listed.unlink(missing_ok=True)
        return
    with replacing(parquet) as partial:
        signatures.rows.to_parquet(partial, index=False)
    write_json(listed, {"numbers": signatures.numbers})


def read_signatures(directory: Path) -> Signatures | None:
    """Read what :func:`write_signatures` wrote; None where there is nothing.

    Raises
    ------
    TableError
        If a file is damaged.
    """
    import pandas as pd  # noqa: PLC0415  loads while a sweep's workers solve

    parquet, listed = (directory / f"{STEM}{suffix}" for suffix in (".parquet", ".json"))
    if not (listed.is_file() and parquet.is_file()):
        return None
    with reading(parquet, _REMEDY):
        rows = pd.read_parquet(parquet)
        numbers = _NUMBERS.validate_python(read_settings(listed, '"numbers": []').get("numbers"))
        if lacking := {"number", "distance_m", "force_N"} - set(rows) or {n.key for n in numbers} - set(rows["number"]):
            raise ValueError(f"it lacks {', '.join(sorted(lacking))}")
        steepest = np.nanmax(np.abs(rows.select_dtypes("number").to_numpy()), initial=0.0)
        if not (steepest < LARGEST and all(number.tolerance < LARGEST for number in numbers)):
            raise ValueError("it has slopes or tolerances that no number of a drawing has")
    return Signatures(numbers, rows)


SLOPES_NAME = "impedance_slopes.npz"


@dataclass(frozen=True, eq=False)
class ImpedanceSlopes:
    """Slopes of L(s) in Z = R + s L at some distances of a sweep, in their order.

    Parameters
    ----------
    distances_m : array, shape (d,)
    frequencies_Hz : array, shape (f,)
    slopes : array, shape (numbers, d, f, n, n)
        In H per unit of the number, or per one whole of a number without a unit.
    """

    numbers: tuple[NumberFacts, ...]
    distances_m: FloatArray
    frequencies_Hz: FloatArray
    slopes: ComplexArray

    def arrays(self) -> dict[str, Any]:
        """The fields as they are written."""
        return vars(self) | {"numbers": _NUMBERS.dump_json(self.numbers).decode()}


def read_slopes(directory: Path) -> ImpedanceSlopes | None:
    """Read ``impedance_slopes.npz``; None where there is nothing.

    Raises
    ------
    TableError
        If the file is damaged.
    """
    return read_arrays(
        directory / SLOPES_NAME,
        lambda arrays: ImpedanceSlopes(**arrays | {"numbers": _NUMBERS.validate_json(str(arrays["numbers"]))}),
        _REMEDY,
    )
