"""What each number of a drawing changes of the inductances at frequencies, as ``impedance_slopes.npz``."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from femfit.core.arrays import ComplexArray, FloatArray
from femfit.device.drawn_numbers import NumberFacts
from femfit.tables.array_file import read_arrays, write_arrays

NAME = "impedance_slopes.npz"


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


def write_slopes(slopes: ImpedanceSlopes | None, directory: Path) -> None:
    """Write the file, or remove that of an earlier sweep where there are none."""
    numbers = None if slopes is None else json.dumps([asdict(number) for number in slopes.numbers])
    write_arrays(None if slopes is None else vars(slopes) | {"numbers": numbers}, directory / NAME)


def read_slopes(directory: Path) -> ImpedanceSlopes | None:
    """Read what :func:`write_slopes` wrote; None where there is nothing.

    Raises
    ------
    TableError
        If the file is damaged.
    """
    return read_arrays(directory / NAME, _of_arrays, "Sweep again with --signatures.")


def _of_arrays(arrays: dict[str, Any]) -> ImpedanceSlopes:
    numbers = TypeAdapter(tuple[NumberFacts, ...]).validate_json(str(arrays["numbers"]))
    return ImpedanceSlopes(**arrays | {"numbers": numbers})
