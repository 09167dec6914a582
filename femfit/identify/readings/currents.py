"""The currents of a bench table as a model takes them: one, or one of each circuit."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pandas as pd

from femfit.core.arrays import FloatArray
from femfit.core.finding import Finding
from femfit.core.sweep_columns import circuit_currents
from femfit.model.actuator_model import ActuatorModel
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


def with_leading_current(model: ActuatorModel, table: BenchTable) -> BenchTable:
    """The table with ``current_A`` as the leading one of several currents."""
    names = current_names(model)
    if not names:
        return table
    columns = dict(zip(names, currents_in(model, table.rows).T, strict=True))
    return replace(table, rows=table.rows.assign(current_A=columns[leading_current(model, columns)]))
