"""The columns of a sweep table.

With one circuit, or none, they are those of :data:`COLUMNS`. With several a column of a circuit carries its name:
``current_bias_A``, ``flux_linkage_bias_Wb``, ``inductance_bias_H``, and ``inductance_bias_control_H`` of two. A
pickup coil's flux linkage stands in ``pickup_NAME_Wb``.
"""

import re
from collections.abc import Sequence
from itertools import combinations

COLUMNS: dict[str, str] = {
    "current_A": "Current of the circuit; a positive one makes a field along +z on the axis of a coil with the sign +.",
    "distance_m": "From the fixed part's reference face to the nearest face of the moving part.",
    "force_N": "Force on the moving part, positive towards smaller distance.",
    "flux_linkage_Wb": "Flux linkage of the circuit.",
    "inductance_H": "Slope of the flux linkage over the current.",
    "coenergy_J": "Co-energy W'(d, i), up to a constant.",
    "hall_T": "Flux density at the Hall element, along its direction.",
    "force_error_N": "Estimated discretisation error of the force.",
    "newton_iterations": "Iterations of a point with saturating parts.",
    "newton_residual": "Last correction relative to the solution, in the norm of the energy.",
    "status": "`ok`, or why the point has no result.",
}
"""The contract's columns, in their order; further axes of a sweep follow as further columns."""

VARIANT = "variant"
"""Column of a parameter sweep: the number of the variant, from 1; the parameters follow it."""


def current_columns(circuits: Sequence[str]) -> list[str]:
    """One column a circuit; one of zeros where there is none."""
    return circuit_currents(circuits) or ["current_A"]


def circuit_currents(circuits: Sequence[str]) -> list[str]:
    """One column a circuit."""
    return _named("current_A", circuits)


def voltage_columns(circuits: Sequence[str]) -> list[str]:
    """One column a circuit."""
    return _named("voltage_V", circuits)


def flux_columns(circuits: Sequence[str]) -> list[str]:
    """One column a circuit."""
    return _named("flux_linkage_Wb", circuits)


def is_current(column: str) -> bool:
    """Whether a column is the current of a circuit."""
    return column.startswith("current_") and column.endswith("_A")


def is_flux(column: str) -> bool:
    """Whether a column is a flux linkage, of any circuit."""
    return column.startswith("flux_linkage_")


def inductance_columns(circuits: Sequence[str]) -> dict[str, tuple[int, int]]:
    """The columns of the circuits' own inductances and, after them, of each two's, with the two circuits' places.

    Examples
    --------
    >>> list(inductance_columns(["upper", "lower"]))
    ['inductance_upper_H', 'inductance_lower_H', 'inductance_upper_lower_H']
    """
    columns = {name: (k, k) for k, name in enumerate(_named("inductance_H", circuits))}
    pairs = combinations(range(len(circuits)), 2)
    return columns | {f"inductance_{circuits[j]}_{circuits[k]}_H": (j, k) for j, k in pairs}


def resistance_column(inductance: str) -> str:
    """The column of the resistance in series with an inductance.

    Examples
    --------
    >>> resistance_column("inductance_upper_H")
    'resistance_upper_ohm'
    """
    return f"resistance{inductance.removeprefix('inductance').removesuffix('H')}ohm"


PICKUP_COLUMN = re.compile(r"pickup_(.+)_Wb")
"""What :func:`pickup_column` makes."""


def pickup_column(coil: str) -> str:
    """The column of the flux linkage of a winding without current."""
    return f"pickup_{coil}_Wb"


def sweep_columns(circuits: Sequence[str], pickups: Sequence[str] = ()) -> list[str]:
    """All columns of a sweep of these circuits and pickup coils, in their order."""
    columns = {
        "current_A": current_columns(circuits),
        "flux_linkage_Wb": flux_columns(circuits),
        "inductance_H": list(inductance_columns(circuits)),
        "hall_T": ["hall_T", *map(pickup_column, pickups)],
    }
    return [name for column in COLUMNS for name in columns.get(column, [column])]


def _named(column: str, circuits: Sequence[str]) -> list[str]:
    stem, unit = column.rsplit("_", 1)
    return [column] if len(circuits) == 1 else [f"{stem}_{name}_{unit}" for name in circuits]
