"""Impedances as LCR meters and network analysers write them, to the series equivalent Z = R + j w L.

Two numbers at a frequency make an impedance: magnitude and phase, real and imaginary part, inductance and resistance in
series or in parallel, or an inductance with its quality Q = X / R or dissipation D = 1 / Q. With several circuits each
column carries the circuit's name, all others open, or the names of two: the voltage of one over the other's current.
"""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pandas as pd

from femfit.core.errors import TableError
from femfit.core.numerics import FloatArray
from femfit.core.results import Finding, listing
from femfit.core.sweep_columns import is_current
from femfit.core.text import amount, quoted
from femfit.tables.columns import BENCH_COLUMNS
from femfit.tables.findings import finding, refused
from femfit.tables.header import OF_CIRCUITS, column_of, parse_header, parts_of
from femfit.tables.raw_table import RawTable
from femfit.tables.reading import ReadTable, Wants
from femfit.tables.units import suspicion

SERIES = ("resistance_ohm", "inductance_H")
"""Channels of an impedance."""

FORMS = (
    *("impedance_ohm", "phase_deg", "reactance_ohm", "parallel_resistance_ohm", "parallel_inductance_H"),
    *("Q", "D"),
)
"""Columns that stand for them beside a frequency."""

_ALL = (*SERIES, *FORMS)

IMPEDANCES = Wants(
    "bench table",
    (*(name for name in BENCH_COLUMNS if name != "voltage_V"), *FORMS),
    needs=("frequency_Hz",),
    one_of=_ALL,
    circuits=OF_CIRCUITS - {"voltage_V"},
)
"""A bench table of impedances; a voltage in it is that of the small current."""

_FORMS: Mapping[tuple[str, str], Callable[[FloatArray, FloatArray], Any]] = {
    ("impedance_ohm", "phase_deg"): lambda z, phase: z * np.exp(1j * np.radians(phase)),
    ("reactance_ohm", "resistance_ohm"): lambda x, r: r + 1j * x,
    ("inductance_H", "Q"): lambda x, q: 1.0 / q * x + 1j * x,
    ("inductance_H", "D"): lambda x, d: d * x + 1j * x,
    ("parallel_inductance_H", "parallel_resistance_ohm"): lambda x, r: 1.0 / (1.0 / r - 1j / x),
    ("parallel_inductance_H", "Q"): lambda x, q: 1.0 / (1.0 / q / x - 1j / x),
    ("parallel_inductance_H", "D"): lambda x, d: 1.0 / (d / x - 1j / x),
}
"""What goes with what, in the order in which it is taken, and Z of the two, inductances as reactances w L."""

_DIRECT = frozenset({"rdc", "dcresistance"})
"""Names of a resistance that is measured with direct current."""

_WITHOUT_NAME = ("Q", "D")
"""What cannot carry a circuit's name."""

_LARGEST_DEG = 91.0
"""Assumed: an instrument's largest error of a phase is 1 degree, beyond which no coil is."""


def in_series(table: ReadTable, raw: RawTable) -> ReadTable:
    """The table with each circuit's :data:`SERIES` in place of other forms, and what was converted or set aside."""
    rows, used, findings = table
    for name in (column.name for column in used if parts_of(column.name)[0] == "phase_deg" and column.assumed):
        largest = float(np.nanmax(np.abs(rows[name].to_numpy()), initial=0.0))
        if 0.0 < largest <= np.pi / 2.0:
            findings.append(suspicion(name, "rad", f"it goes up to {largest:.3g}"))
    carried = {parts_of(str(name))[1] for name in rows if parts_of(str(name))[0] not in _ALL}
    if not any(is_current(str(name)) for name in rows):
        rows = rows.assign(current_A=0.0)
        findings.append(finding("no-bias", column="current_A"))
    resistance = next((column.header for column in used if column.name == "resistance_ohm"), "")
    if parse_header(resistance).name in _DIRECT:  # at direct current, which is no part of an impedance
        rows = rows.drop(columns="resistance_ohm")
        findings.append(finding("unused-column direct", header=quoted(resistance)))

    def require(column: str | None, wrong: Callable[[FloatArray], Any], what: str, remedy: str) -> None:
        faulty = np.flatnonzero(wrong(rows[column].to_numpy()) if column else False)
        if len(faulty):
            held = amount(rows[column].iloc[faulty[0]], column or "", 3)
            line = raw.lines[faulty[0]]
            raise TableError(f"{column} of {raw.source} must be {what}; line {line} holds {held}. {remedy}")

    require("frequency_Hz", lambda f: f <= 0.0, "a frequency > 0", "Leave out what was read without one.")
    loose = [name for name in _WITHOUT_NAME if name in rows]
    named = (parts_of(str(name)) for name in rows if name not in loose)
    circuits = dict.fromkeys(circuit for quantity, circuit in named if quantity in _ALL)
    alone = len(circuits) == 1  # a quality beside inductance_inner_H is that of inner
    for circuit in circuits if alone or not loose else {**circuits, "": None}:
        columns = {name: name if alone and name in loose else column_of(name, circuit) for name in _ALL}
        held = {name: column for name, column in columns.items() if column in rows}
        # A name such as bias_control may be that of two circuits; it is of one whose current the table has
        mutual = "_" in circuit and not circuit.endswith("_shorted") and circuit not in carried
        require(held.get("impedance_ohm"), lambda z: z < 0.0, "a magnitude >= 0", "Name the part of Z.")
        if not mutual:
            column = held.get("phase_deg")
            remedy = f"Check its unit (--unit {column}=rad), or change its sign (--unit {column}=-1) or the leads."
            require(column, lambda phase: np.abs(phase) > _LARGEST_DEG, "a phase of -90 to 90 degrees", remedy)
        z, remarks = _one_in_series(rows, held, raw.source, mutual=mutual)
        findings += remarks
        rows = rows.drop(columns=list(held.values()))
        rows = rows.assign(**{column_of(name, circuit): values for name, values in z.items()})
    return rows, used, findings


def _one_in_series(
    rows: pd.DataFrame, held: Mapping[str, str], source: str, *, mutual: bool
) -> tuple[dict[str, FloatArray], list[Finding]]:
    """What there is of :data:`SERIES`, from the columns by form; that of two circuits is of either sign."""
    findings: list[Finding] = []
    readings = {name: rows[column].to_numpy(dtype=np.float64) for name, column in held.items()}
    series = {name: readings[name] for name in SERIES if name in held}
    frequency, circuit = rows["frequency_Hz"].to_numpy(), parts_of(next(iter(held.values())))[1]
    pair = next((pair for pair in _FORMS if set(pair) <= held.keys()), None)
    if len(series) < len(SERIES) and pair is not None:
        w = 2.0 * np.pi * frequency
        with np.errstate(divide="ignore", invalid="ignore"):  # a quality of 0 is no number, and its row has none
            z = _FORMS[pair](*(readings[name] * (w if name.endswith("_H") else 1.0) for name in pair))
        series = {"resistance_ohm": z.real, "inductance_H": z.imag / w}
        findings.append(finding("impedance", columns=" and ".join(held[name] for name in pair)))
    elif not series:
        form = next(iter(held))
        second = [column_of(name, circuit) for pair in _FORMS if form in pair for name in pair if name != form]
        facts = {"columns": listing(held.values()), "lacking": " or ".join(second), "second": second[0]}
        raise refused("half-impedance", source=source, **facts)
    inductance = series.get("inductance_H", np.zeros(0))
    wrong = inductance <= 0.0  # above the winding's own resonance
    if mutual or not wrong.any():
        return series, findings
    column = column_of("inductance_H", circuit)
    if wrong[np.isfinite(inductance)].all():
        raise refused("no-inductance", source=source, name=column)
    lowest, count = amount(float(np.min(frequency[wrong])), "frequency_Hz"), int(wrong.sum())
    findings.append(finding("resonance", size=float(count), column=column, readings=count, frequency=lowest))
    return {name: np.where(wrong, np.nan, values) for name, values in series.items()}, findings
