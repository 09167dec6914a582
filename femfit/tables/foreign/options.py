"""What a user can say about a foreign table where its text does not say it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

Form = Literal["auto", "long", "matrix"]
ForceSign = Literal["auto", "keep", "flip"]


@dataclass(frozen=True)
class ImportOptions:
    """Overrides of what the reader finds out by itself.

    Parameters
    ----------
    columns : mapping of str to str
        Quantity (a key of :data:`femfit.tables.foreign.quantities.QUANTITIES`) to the header that holds it.
    units : mapping of str to str
        Quantity to its unit in the file, or to a number that multiplies it to SI.
    column_names : tuple of str
        Names of the columns of a table without a header line, in order.
    form : {"auto", "long", "matrix"}
        One row a point, or force(distance, current) with the axes in the first row and column.
    matrix_rows : {"auto", "distance", "current"}
        What the first column of a matrix holds.
    delimiter : str or None
        One character, or a blank for any run of blanks; found out by default.
    encoding : str or None
        Python's name of it; found out by default.
    file_currents_A, file_distances_m : tuple of float
        Current (distance) of each file, in the order of the files, where no column holds it.
    distance_step_m, distance_start_m : float or None
        distance = start + step * column; a start without a step shifts the column.
    flip_distance : bool
        distance = start - column, for positions that count towards the electromagnet.
    flip_current : bool
        Negate current and flux linkage (co-energy and force stay what they are).
    accept : tuple of str
        Codes of error findings that shall not stop the import.
    """

    columns: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    column_names: tuple[str, ...] = ()
    form: Form = "auto"
    matrix_rows: Literal["auto", "distance", "current"] = "auto"
    decimal: str | None = None
    delimiter: str | None = None
    encoding: str | None = None
    file_currents_A: tuple[float, ...] = ()
    file_distances_m: tuple[float, ...] = ()
    distance_step_m: float | None = None
    distance_start_m: float | None = None
    flip_distance: bool = False
    flip_current: bool = False
    force_sign: ForceSign = "auto"
    without: tuple[str, ...] = ()
    accept: tuple[str, ...] = ()
