"""Columns of several circuits: currents, voltages and flux linkages that carry the circuit's name.

``current_bias_A`` is the current of the circuit bias. A table is one of several circuits where its headers name two or
more; a lone ``current_coil_A`` is more likely a ``current_A`` by another name.
"""

import re
from collections.abc import Iterable

from femfit.tables.units import unit_factor

_QUANTITIES = {"current": "A", "voltage_balance": "V", "voltage": "V", "flux_linkage": "Wb"}

_OF_CIRCUIT = re.compile(rf"({'|'.join(_QUANTITIES)})_([A-Za-z]\w*)_([A-Za-z]+)")

FEWEST = 2
"""Derived: circuits that are several."""


def circuit_columns(names: Iterable[str]) -> tuple[str, ...]:
    """The columns in SI that headers of several circuits mean; none where fewer than two circuits are named.

    Examples
    --------
    >>> circuit_columns(["time_s", "current_bias_mA", "current_diff_A", "voltage_bias_V"])
    ('current_bias_A', 'current_diff_A', 'voltage_bias_V')
    """
    found: dict[str, str] = {}
    for name in names:
        parts = _OF_CIRCUIT.fullmatch(name.strip())
        if parts is not None and unit_factor(parts[3], _QUANTITIES[parts[1]]) is not None:
            found[f"{parts[1]}_{parts[2]}_{_QUANTITIES[parts[1]]}"] = parts[2]
    return tuple(found) if len(set(found.values())) >= FEWEST else ()


def parts_of(column: str) -> tuple[str, str]:
    """A column's name without a circuit's, and that circuit's name, empty where it is of none.

    Examples
    --------
    >>> parts_of("flux_linkage_bias_Wb"), parts_of("current_A")
    (('flux_linkage_Wb', 'bias'), ('current_A', ''))
    """
    parts = _OF_CIRCUIT.fullmatch(column)
    if parts is None or _QUANTITIES[parts[1]] != parts[3]:
        return column, ""
    return f"{parts[1]}_{parts[3]}", parts[2]
