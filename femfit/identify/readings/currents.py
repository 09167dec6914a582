"""The currents of a bench table as a model takes them: one, or one of each circuit."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pandas as pd

from femfit.core.arrays import FloatArray
from femfit.core.errors import TableError
from femfit.core.finding import Finding
from femfit.core.sweep_columns import circuit_currents, resistance_column
from femfit.model.actuator_model import ActuatorModel
from femfit.model.impedance import impedances_by_column
from femfit.tables.circuit_columns import parts_of
from femfit.tables.impedance import SERIES, without_capacitive
from femfit.tables.measurement import BenchTable


def current_names(model: ActuatorModel) -> tuple[str, ...]:
    """Columns of the currents of several circuits; none of one, whose column is ``current_A``."""
    if not model.validity.further_A:
        return ()
    return tuple(circuit_currents(getattr(model.without_effects.magnetics, "names", model.circuit_names)))


def hall_not_compared(model: ActuatorModel, given: Sequence[str]) -> tuple[Finding, ...]:
    """That a recorded Hall voltage of several circuits is left out, where it is."""
    if not model.validity.further_A or "hall_V" not in given:
        return ()
    text = "hall_V is neither compared nor diagnosed: with several circuits no effect on a Hall element is known."
    return (Finding("hall-not-compared", "info", text, "femfit observe reads it.", column="hall_V"),)


def currents_in(model: ActuatorModel, rows: pd.DataFrame) -> FloatArray:
    """Currents of the rows in A, in the shape that the model takes; NaN where a column is missing."""
    names = current_names(model)
    if not names:
        return rows["current_A"].to_numpy(dtype=np.float64)
    return np.stack([rows.get(name, pd.Series(np.nan, rows.index)).to_numpy(np.float64) for name in names], axis=1)


def current_directions(model: ActuatorModel) -> list[FloatArray]:
    """A unit change of each current, that broadcasts with :func:`currents_in`."""
    names = current_names(model)
    return list(np.eye(len(names))) if names else [np.ones(())]


def leading_current(model: ActuatorModel, columns: Mapping[str, FloatArray]) -> str:
    """Column of the current that was varied most, counted in widths of its range; the only one of one circuit."""
    names = current_names(model)
    if not names:
        return "current_A"
    widths = np.ptp(model.validity.current_limits_A, axis=1)
    spread = np.nan_to_num([np.nanstd(columns[name]) for name in names]) / np.maximum(widths, 1e-300)
    return names[int(np.argmax(spread))]


def without_bias(model: ActuatorModel, table: BenchTable) -> BenchTable:
    """The table with no current in any of several circuits where it has ``current_A`` alone, of 0 A."""
    names = current_names(model)
    if not names or "current_A" not in table.given:
        return table
    currents = currents_in(model, table.rows)
    currents[np.isnan(currents).all(axis=1) & (table.rows["current_A"] == 0.0).to_numpy()] = 0.0
    rows = table.rows.assign(**dict(zip(names, currents.T, strict=True)))
    known = [name for name in names if name not in table.given and rows[name].notna().any()]
    return replace(table, rows=rows, given=(*table.given, *known))


def _require_currents(model: ActuatorModel, table: BenchTable) -> None:
    """Refuse a table without currents beside a model with a circuit."""
    several = current_names(model)
    if several:
        lacking = [name for name in several if name not in table.given]
        if lacking:
            raise TableError(
                f"A bench table beside model {model.name!r} must have a current of each circuit; {table.source} lacks "
                f"{', '.join(lacking)} (it has {', '.join(table.given)}). Add a column of zeros for one that carries "
                "none."
            )
        return
    if "current_A" in table.given or not model.circuits:
        return
    unused = " ".join(str(one) for one in table.findings if one.code == "unused-column")
    raise TableError(
        f"A bench table beside model {model.name!r}, which has a circuit, must have current_A with numbers in it; "
        f"{table.source} has {', '.join(table.given)}. {unused}{' ' * bool(unused)}Rename a column, or say what it is "
        "with --column HEADER=current_A."
    )


def _require_impedances_of(model: ActuatorModel, table: BenchTable) -> None:
    """Refuse an impedance of which it is not said to which of several circuits it belongs."""
    if not current_names(model):
        return
    circuits = model.without_effects.circuit_names
    inductances = list(impedances_by_column(np.eye(len(circuits), dtype=np.complex128), circuits))
    known = {*inductances, *map(resistance_column, inductances)}
    other = [name for name in table.channels if parts_of(name)[0] in SERIES and name not in known]
    if other:
        raise TableError(
            f"An impedance beside model {model.name!r} must be that of its circuits {', '.join(circuits)}; "
            f"{table.source} has {', '.join(other)}. Name each column after its circuit, all others open "
            f"({inductances[0]}), or after two: the voltage of one over the current of the other ({inductances[1]}), "
            f"or the one with the other shorted ({inductances[2]}). For example --column HEADER={inductances[0]}."
        )


def with_currents(model: ActuatorModel, table: BenchTable) -> BenchTable:
    """The table with the current of each circuit, and with ``current_A`` as the leading one of several.

    Raises
    ------
    TableError
        If a current is missing, or it is not said to which circuit an impedance belongs.
    """
    table = without_bias(model, table)
    _require_currents(model, table)
    _require_impedances_of(model, table)
    return with_leading_current(model, table)


def inductive(model: ActuatorModel, table: BenchTable) -> BenchTable:
    """The table without what no inductance gives; by its name alone it may take that of ``coil_1`` for one of two."""
    circuits = model.without_effects.circuit_names if "frequency_Hz" in table.given else ()
    for name in (one for one in map("inductance_{}_H".format, circuits) if one in table.given):
        rows, of = table.rows, {SERIES[1]: name, SERIES[0]: resistance_column(name)}
        found = {one: rows[column].to_numpy() for one, column in of.items() if column in rows}
        kept, said = without_capacitive(found, rows["frequency_Hz"].to_numpy(), table.source, name)
        rows = rows.assign(**{of[one]: values for one, values in kept.items()})
        table = replace(table, rows=rows, findings=(*table.findings, *said))
    return table


def with_leading_current(model: ActuatorModel, table: BenchTable) -> BenchTable:
    """The table with ``current_A`` as the leading one of several currents."""
    names = current_names(model)
    if not names:
        return table
    columns = dict(zip(names, currents_in(model, table.rows).T, strict=True))
    return replace(table, rows=table.rows.assign(current_A=columns[leading_current(model, columns)]))
