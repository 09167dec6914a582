"""From a sweep table of several circuits to an actuator model."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from femfit.core.errors import FitError, TableError
from femfit.core.numerics import FloatArray
from femfit.core.sweep_columns import flux_columns, inductance_columns
from femfit.device.electrics import Circuit
from femfit.fit.circuit_system import CircuitRows, require_currents
from femfit.fit.circuits_fit import CircuitsFit, fit_circuits
from femfit.fit.constants import NETWORK_IDLE, SAME_SETTING
from femfit.fit.eddy import with_eddy_currents
from femfit.fit.misfit import as_written, import_notes, sheet_notes
from femfit.fit.model_parts import (
    MASS_UNKNOWN,
    circuits_of,
    hall_sensor_of,
    kind_of,
    mechanics_of,
    other_sensors_of,
    with_period,
    within_sweep,
)
from femfit.fit.result import FitResult
from femfit.fit.rows import FitRows, column_numbers, rms
from femfit.fit.sensed_field import SensedRows, fit_pickups, fit_sensed
from femfit.model.actuator_model import ActuatorModel
from femfit.model.hall import HallSensor
from femfit.model.several_magnetics import CoenergyMatrix
from femfit.model.validity import ActuatorKind, Misfit, ValidityBox
from femfit.tables.sweep_table import SweepTable, current_names


def fit_several(table: SweepTable, entry: Mapping[str, Any]) -> FitResult:
    """Fit a table with a current column for each of several circuits.

    Raises
    ------
    TableError
        If a circuit's flux linkage is missing, or a column holds no numbers.
    FitError
        As of :func:`femfit.fit.circuits_fit.fit_circuits`.
    """
    kind = kind_of(entry)
    rows = circuit_rows(table, kind)
    if kind is not None and kind.saturates:
        require_currents(rows, "The drawing's iron has a magnetisation curve")
    fit = fit_circuits(rows)
    circuits, notes = circuits_of(entry, rows.names)
    validity, remarks = _validity(fit, rows)
    notes = (*notes, *remarks, *_absent(rows), *_one_sided(circuits, *validity.current_limits_A.T))
    motion = mechanics_of(entry)
    notes = (*notes, *([] if motion else [MASS_UNKNOWN]))
    motion, beyond = within_sweep(motion, rows.distances)
    other_sensors, not_held = other_sensors_of(entry, fit_pickups(table))
    notes = (*notes, *beyond, *not_held, *sheet_notes(table))
    hall, remarks = _hall(table, entry, rows)
    notes = (*notes, *remarks)
    notes = (*notes, *fit.notes())
    model = ActuatorModel(
        name=str(entry.get("name") or table.manifest.get("name") or "actuator"),
        magnetics=fit.magnetics,
        validity=validity,
        circuits=circuits,
        motion=motion,
        sensor=hall,
        reference_distances_m=tuple(float(d) for d in entry.get("reference_distances_m") or ()),
        kind=kind,
        other_sensors=other_sensors,
    )
    model = with_period(with_eddy_currents(model, table), entry)
    model = replace(model, misfit=misfit_of_circuits(as_written(model), rows, _hall_values(table)))
    first_rows = FitRows(
        rows.distance, rows.currents[:, 0], rows.force, rows.flux_linkage[:, 0], None, rows.force_error, None
    )
    result = FitResult(model, None, None, None, None, first_rows, notes, import_notes(table), circuits=fit)
    return result.with_provenance(table.manifest)


def _absent(rows: CircuitRows) -> list[str]:
    """What points that the grid of a sweep lacks mean for the co-energy between the others."""
    absent = rows.grid_points - len(rows.distance)
    if absent <= 0:
        return []
    return [
        (
            f"{absent} of the {rows.grid_points} points of the grid failed or are missing, and the co-energy is less "
            "sure around them. Mend what made them fail, or move these points, and sweep again before anything else."
        )
    ]


def _validity(fit: CircuitsFit, rows: CircuitRows) -> tuple[ValidityBox, tuple[str, ...]]:
    """The distances and currents that the co-energy holds for, and which signs of the currents were not swept.

    A quadratic form holds for currents of either sign. A spline holds where it was swept and, without a magnet, where
    all of these currents flow the other way, which is a box again where all circuits but one were swept to both sides.
    """
    low, high = rows.currents.min(axis=0), rows.currents.max(axis=0)
    either = np.minimum(low, -high), np.maximum(high, -low)
    mirrored, notes = False, tuple[str, ...]()
    if isinstance(fit.magnetics, CoenergyMatrix):
        low, high = either
    elif not rows.magnet:
        lopsided = (low != -high).sum()
        if lopsided == 1 and np.all(low * high <= 0.0):
            low, high = either
        mirrored = bool(lopsided > 1)
    if mirrored:
        notes = (
            (
                f"The currents of {' and '.join(rows.names)} were swept with these signs, and the co-energy also holds "
                "with all of them reversed, for there is no magnet. Other signs together were not swept: sweep all "
                "circuits but one to both sides of 0 A."
            ),
        )
    first, *other_limits = zip(low.tolist(), high.tolist(), strict=True)
    ends = float(rows.distances[0]), float(rows.distances[-1])
    return ValidityBox(*ends, *first, tuple(other_limits), mirrored), notes


def _one_sided(circuits: Sequence[Circuit], low: FloatArray, high: FloatArray) -> list[str]:
    """What to do about circuits that a simulation drives below zero at once, where the sweep says nothing."""
    free = [circuit.drive.kind == "voltage" and circuit.drive.diode_V is None for circuit in circuits]
    if not circuits:
        return []
    names = [
        circuit.name
        for circuit, free_to_reverse, a, b in zip(circuits, free, low, high, strict=True)
        if free_to_reverse and a * b == 0.0
    ]
    if not names:
        return []
    text = (
        f"The sweep has currents of {' and '.join(names)} to one side of 0 A alone, and a simulation ends where other "
        "circuits induce a current of the other sign. Sweep both sides, or draw diode_V for a driver that blocks."
    )
    return [text]


def circuit_rows(table: SweepTable, kind: ActuatorKind | None) -> CircuitRows:
    """The rows of a table of several circuits, checked; of what the device is made, where that is known."""
    rows = table.valid_rows()
    columns = current_names(rows)
    names = tuple(column.removeprefix("current_").removesuffix("_A") for column in columns)
    fluxes = flux_columns(names)
    missing = [name for name in ("distance_m", "force_N", *fluxes) if name not in rows]
    if missing:
        raise TableError(
            f"A table of the circuits {', '.join(names)} must have the columns {', '.join(missing)} as well. Sweep it "
            "with femfit, or import these columns."
        )
    force = column_numbers(rows, "force_N")
    if not force.any():
        raise TableError("force_N is 0 in every row, and nothing would move the body. Give the column of the force.")
    has_errors = "force_error_N" in rows and bool(rows["force_error_N"].notna().all())
    measured = CircuitRows(
        names,
        _on_grid(column_numbers(rows, "distance_m")),
        np.column_stack([_on_grid(column_numbers(rows, column)) for column in columns]),
        force,
        np.array([column_numbers(rows, column) for column in fluxes]).T,
        np.abs(column_numbers(rows, "force_error_N")) if has_errors else np.zeros_like(force),
        _inductances(rows, names),
    )
    return replace(measured, magnet=_pulls_without_current(measured) if kind is None else kind.has_magnet)


def _on_grid(values: FloatArray) -> FloatArray:
    """Values of which those count as one that differ by rounding, as of a table that was written with few digits."""
    distinct, place = np.unique(values, return_inverse=True)
    first = np.diff(distinct, prepend=-np.inf) > SAME_SETTING * np.abs(distinct).max()
    return np.asarray(distinct[first][np.cumsum(first) - 1][place])


def _inductances(rows: pd.DataFrame, names: tuple[str, ...]) -> FloatArray | None:
    """All inductances, (rows, n, n), where the table has them in every row."""
    places = inductance_columns(names)
    if not all(column in rows and bool(rows[column].notna().all()) for column in places):
        return None
    result = np.empty((len(rows), len(names), len(names)))
    for column, (j, k) in places.items():
        result[:, j, k] = result[:, k, j] = column_numbers(rows, column)
    return result


def _pulls_without_current(rows: CircuitRows) -> bool:
    """Whether a table of a device that nobody described looks like one with a magnet, or leaves that open."""
    idle = ~rows.currents.any(axis=1)
    values = np.column_stack([rows.force / rms(rows.force), rows.flux_linkage / rows.flux_scale])
    return not idle.any() or float(np.abs(values[idle]).max()) > NETWORK_IDLE


def _hall(table: SweepTable, entry: Mapping[str, Any], rows: CircuitRows) -> tuple[HallSensor | None, tuple[str, ...]]:
    """The Hall element with the field of all currents, and what is said of one that is not in the model."""
    values = _hall_values(table)
    if not entry.get("hall"):
        return None, ()
    if values is None:
        return None, ("The Hall element is not in the model: the table has no hall_T. Sweep the drawing again.",)
    try:
        sensed = fit_sensed(SensedRows(rows.distance, rows.currents, values), "The field at the Hall element")
    except FitError as error:
        return None, (f"The Hall element is not in the model: {error}",)
    return hall_sensor_of(entry["hall"], sensed.field), (sensed.said("The field at the Hall element", "T"),)


def _hall_values(table: SweepTable) -> FloatArray | None:
    rows = table.valid_rows()
    return column_numbers(rows, "hall_T") if "hall_T" in rows else None


def misfit_of_circuits(model: ActuatorModel, rows: CircuitRows, hall: FloatArray | None = None) -> Misfit:
    """Model minus table, of the force, of all flux linkages together and of the field in T at a Hall element."""
    force = model.magnetics.force(rows.distance, rows.currents) - rows.force
    missed = model.magnetics.flux_linkage(rows.distance, rows.currents) - rows.flux_linkage
    hall_rms = None
    if hall is not None and model.sensor is not None:
        hall_rms = rms(model.sensor.field.field(rows.distance, rows.currents) - hall)
    return Misfit(
        force_rms_N=rms(force),
        force_max_N=float(np.max(np.abs(force))),
        force_rms_relative=rms(force / rows.force_scale),
        force_rms_of_weight=None,
        flux_linkage_rms_Wb=rms(missed),
        hall_rms_T=hall_rms,
        rows=len(force),
        against="sweep",
        force_share=rms(force) / rms(rows.force),
        flux_linkage_share=rows.worst_flux_share(missed),
    )
