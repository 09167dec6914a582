"""Columns of several circuits: currents, voltages, flux linkages and impedances that carry the circuit's name.

``current_bias_A`` is the current of the circuit bias. A table is one of several circuits where its headers name two or
more; a lone ``current_coil_A`` is more likely a ``current_A`` by another name. An impedance may be that of one circuit
alone, or carry the names of two: ``inductance_bias_control_H``.
"""

import re
from collections.abc import Iterable

from femfit.tables.header import parse_header
from femfit.tables.units import CHANNELS, unit_factor

_OF_IMPEDANCE = {
    "resistance": "ohm",
    "inductance": "H",
    "impedance": "ohm",
    "phase": "deg",
    "reactance": "ohm",
    "parallel_resistance": "ohm",
    "parallel_inductance": "H",
}
_QUANTITIES = {"current": "A", "voltage_balance": "V", "voltage": "V", "flux_linkage": "Wb", **_OF_IMPEDANCE}

OF_CIRCUITS = frozenset(f"{quantity}_{unit}" for quantity, unit in _QUANTITIES.items())
"""Columns that may carry a circuit's name."""

_OF_CIRCUIT = re.compile(rf"({'|'.join(_QUANTITIES)})_([A-Za-z][\w-]*)_([^\W\d_]+|°)")
_BRACKETS = re.compile(r"\s*[\[(]([^\[\]()]+)[\])]$")

FEWEST = 2
"""Derived: circuits that are several."""

_OTHER_NAMES = frozenset(name for channel in CHANNELS.values() for name in channel.names)
"""A header ``phase_angle_deg`` is the phase of no circuit named angle."""


def circuit_columns(names: Iterable[str], fewest: int = FEWEST) -> tuple[str, ...]:
    """The columns in SI that headers of several circuits mean.

    There are none where fewer than so many circuits are named, and no impedance has a circuit's name. A unit in
    brackets counts beside such an impedance alone: ``current_coil [A]`` and ``voltage_supply [V]`` are of one circuit.

    Examples
    --------
    >>> circuit_columns(["time_s", "current_bias_mA", "current_diff_A", "voltage_bias_V"])
    ('current_bias_A', 'current_diff_A', 'voltage_bias_V')
    >>> circuit_columns(["frequency_Hz", "inductance_bias [uH]"])
    ('inductance_bias_H',)
    """
    circuit_of: dict[str, str] = {}
    in_brackets: dict[str, str] = {}
    several = False
    for name in names:
        plain = _BRACKETS.sub(r"_\1", name.strip())
        parts = _OF_CIRCUIT.fullmatch(plain)
        if parts is None or parse_header(name).name in _OTHER_NAMES:
            continue
        if unit_factor(parts[3], _QUANTITIES[parts[1]]) is not None:
            kind = circuit_of if plain == name.strip() else in_brackets
            kind[f"{parts[1]}_{parts[2]}_{_QUANTITIES[parts[1]]}"] = parts[2]
            several |= parts[1] in _OF_IMPEDANCE
    circuit_of |= in_brackets if several else {}
    return tuple(circuit_of) if several or len(set(circuit_of.values())) >= fewest else ()


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


def column_of(column: str, circuit: str) -> str:
    """A column as that of a circuit, or of none where its name is empty: :func:`parts_of` undone.

    Examples
    --------
    >>> column_of("flux_linkage_Wb", "bias")
    'flux_linkage_bias_Wb'
    """
    stem, _, unit = column.rpartition("_")
    return f"{stem}_{circuit}_{unit}" if circuit else column
