"""What each number of a drawing changes of the inductances at frequencies, as ``impedance_slopes.npz``."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path

from pydantic import TypeAdapter

from femfit.core.arrays import ComplexArray, FloatArray
from femfit.core.errors import TableError
from femfit.core.quoted import quoted
from femfit.device.drawn_numbers import NumberFacts
from femfit.tables.eddy_table import DAMAGED, load_arrays, save_arrays

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
    if slopes is None:
        (directory / NAME).unlink(missing_ok=True)
        return
    numbers = json.dumps([asdict(one) for one in slopes.numbers])
    save_arrays(directory / NAME, vars(slopes) | {"numbers": numbers})


def read_slopes(directory: Path) -> ImpedanceSlopes | None:
    """Read what :func:`write_slopes` wrote; None where there is nothing.

    Raises
    ------
    TableError
        If the file is damaged.
    """
    file = directory / NAME
    if not file.is_file():
        return None
    try:
        arrays = load_arrays(file)
        numbers = TypeAdapter(tuple[NumberFacts, ...]).validate_json(str(arrays["numbers"]))
        return ImpedanceSlopes(**arrays | {"numbers": numbers})
    except (*DAMAGED, TypeError) as error:
        raise TableError(f"{file} cannot be read: {quoted(error, 300)}. Sweep again with --signatures.") from error
