"""What a user can say about a foreign table where its text does not say it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from femfit.tables.units import column_unit

QUANTITIES: dict[str, str] = {
    "current": "current_A",
    "distance": "distance_m",
    "force": "force_N",
    "flux_linkage": "flux_linkage_Wb",
    "inductance": "inductance_H",
    "hall": "hall_T",
    "coenergy": "coenergy_J",
    "force_error": "force_error_N",
}
"""What a sweep table can hold, and its column there."""

REQUIRED = ("current", "distance", "force")


def si_unit(quantity: str) -> str:
    """Return the SI unit of a quantity."""
    return column_unit(QUANTITIES[quantity])[1]


@dataclass(frozen=True)
class ImportOptions:
    """Overrides of what the reader finds out by itself."""

    # Header to the column of the sweep table that it is; header or column to its unit, or to a factor to SI
    columns: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, str | float] = field(default_factory=dict)
    # Names of the columns of a table without a header line, in order; of a matrix, its first row
    column_names: tuple[str, ...] = ()
    # One row a point, or force(distance, current) with axes; and what the first column of such a matrix holds
    form: Literal["auto", "long", "matrix"] = "auto"
    matrix_rows: Literal["auto", "distance", "current"] = "auto"
    table: str | None = None  # Sheet, group or struct, where a file has several that could be meant
    decimal: str | None = None
    delimiter: str | None = None
    encoding: str | None = None
    # Current (distance) of each file, in the order of the files, where no column holds it
    file_currents_A: tuple[float, ...] = ()
    file_distances_m: tuple[float, ...] = ()
    # distance = start + step * column, or start - column for positions that count towards the electromagnet
    distance_step_m: float | None = None
    distance_start_m: float | None = None
    flip_distance: bool = False
    flip_current: bool = False  # Negate current and flux linkage (co-energy and force stay what they are)
    force_sign: Literal["auto", "keep", "flip"] = "auto"
    # Quantities that are left out; codes of error findings that shall not stop the import
    without: tuple[str, ...] = ()
    accept: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Turn ``flux-linkage`` into ``flux_linkage_Wb``; a header stays what it is."""
        columns = {header: QUANTITIES.get(name.replace("-", "_"), name) for header, name in self.columns.items()}
        units = {QUANTITIES.get(key.replace("-", "_"), key): unit for key, unit in self.units.items()}
        object.__setattr__(self, "columns", columns)
        object.__setattr__(self, "units", units)
