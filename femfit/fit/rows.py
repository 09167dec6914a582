"""A sweep table's rows as arrays, checked for what every fit needs."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from femfit.core.errors import TableError
from femfit.core.numerics import GRAVITY, BoolArray, FloatArray, IntArray
from femfit.core.results import listing
from femfit.core.sweep_columns import current_columns, flux_columns, inductance_columns
from femfit.core.text import counted
from femfit.fit import constants
from femfit.model.validity import ActuatorKind
from femfit.tables.checks import suspected_units
from femfit.tables.sweep_table import SweepTable, column_numbers, current_names, snap_axis


@dataclass(frozen=True, eq=False)
class FitRows:
    """Rows of a sweep of n circuits, or none, in SI units; shape (rows,) where no other is given."""

    names: tuple[str, ...]  # Of several circuits; empty for one
    distance: FloatArray
    circuit_currents: FloatArray  # (rows, n); of zeros, n = 1, where there is no circuit
    force: FloatArray
    force_error: FloatArray  # Estimated error of the force; zero where the table gives none
    flux_linkage: FloatArray | None = None  # (rows, n)
    # Slopes of the flux linkages over the currents, (rows, n, n): of one circuit NaN in rows without, of several all
    inductance: FloatArray | None = None
    hall: FloatArray | None = None
    weight: float | None = None  # Weight m g in N of the moving part of one circuit, where the mass is known
    magnet: bool = True  # Of several circuits: without one W' is even, and no current gives no force

    @property
    def several(self) -> bool:
        """Whether there is more than one circuit."""
        return len(self.names) > 1

    @property
    def current(self) -> FloatArray:
        """The current of the circuit, or of the first one."""
        return self.circuit_currents[:, 0]

    @property
    def currents(self) -> FloatArray:
        """Distinct currents of the circuit, or of the first one, ascending."""
        return self.axes[0]

    @property
    def axes(self) -> list[FloatArray]:
        """Distinct currents of each circuit, ascending."""
        return [np.unique(column) for column in self.circuit_currents.T]

    @property
    def distances(self) -> FloatArray:
        """Distinct distances, ascending."""
        return np.unique(self.distance)

    @property
    def linked(self) -> FloatArray:
        """The flux linkages of a table that has them; (rows, n)."""
        assert self.flux_linkage is not None  # noqa: S101  a fit that needs them asks first
        return self.flux_linkage

    @property
    def without_current(self) -> bool:
        """Whether no row carries a current, as of a pair of magnets."""
        return not self.circuit_currents.any()

    @property
    def saturates(self) -> bool:
        """Whether the inductance, or the flux linkage's slope where none is given, changes with the current."""
        if self.inductance is not None or self.flux_linkage is None:
            return self.inductance is not None
        bends = [np.ptp(slopes) for slopes in self.slopes(self.flux_linkage[:, 0]) if len(slopes)]
        return bool(max(bends, default=0.0) > constants.STRAIGHT * np.abs(self.inductances).max(initial=0.0))

    @property
    def inductances(self) -> FloatArray:
        """Those of the table's only circuit, where it has them, or else the slopes of its flux linkage."""
        if self.inductance is None:
            return np.concatenate(self.slopes(self.linked[:, 0]))
        return self.inductance[np.isfinite(self.inductance)]

    def slopes(self, flux_linkage: FloatArray) -> list[FloatArray]:
        """Of each distance, the changes of a flux linkage (rows,) over those of the current, from one to the next."""
        return [np.diff(flux_linkage[k]) / np.diff(self.current[k]) for k in _by_distance(self.distance, self.current)]

    @property
    def hanging_weight(self) -> float | None:
        """The weight, where the moving part can hang within the sweep and its forces are of that order.

        Some force is below and some above it, and the rms force is at most :data:`FAR_ABOVE_WEIGHT` times as large: a
        holding magnet that pulls a thousand times its armature's weight passes it near zero current, where nobody
        uses it.
        """
        if self.weight is None or not np.min(self.force) <= self.weight <= np.max(self.force):
            return None
        return None if rms(self.force) > constants.FAR_ABOVE_WEIGHT * self.weight else self.weight

    def share(self, quantity: str, errors: FloatArray) -> float:
        """Rms of errors of the force or, where the iron saturates, of the inductance, over the table's rms of it."""
        return rms(errors) / (rms(self.force if quantity == "force" else self.inductances) or 1.0)

    @property
    def error_scale(self) -> tuple[float, str]:
        """What a law's errors are a part of, in N, and its name: the weight where the part can hang, or the rms."""
        weight = self.hanging_weight
        return (weight, "weight") if weight else (rms(self.force), "rms force")

    @property
    def force_scale(self) -> FloatArray:
        """What a relative error of each row's force is measured against, shape (n,).

        The force itself, but at least :data:`SMALL_FORCE` of the largest one at the same distance, and of the largest
        ones on both sides of a distance at which every force changes its sign; of several circuits, at least
        :data:`SMALL_CIRCUIT_FORCE` of the largest one.
        """
        size = np.abs(self.force)
        if self.several:
            return np.asarray(np.maximum(size, constants.SMALL_CIRCUIT_FORCE * np.max(size)))
        largest = np.array([np.max(size[self.distance == d]) for d in self.distances])
        nearer, farther = np.maximum.accumulate(largest), np.maximum.accumulate(largest[::-1])[::-1]
        around = np.maximum(np.minimum(nearer, farther), 1e-4 * np.max(size) or 1.0)
        return np.maximum(size, constants.SMALL_FORCE * around[np.searchsorted(self.distances, self.distance)])

    def take(self, which: BoolArray) -> "FitRows":
        """The rows of a boolean mask."""
        columns: dict[str, Any] = {
            name: column[which] for name, column in vars(self).items() if isinstance(column, np.ndarray)
        }
        return replace(self, **columns)


def rms(values: FloatArray) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(values**2)))


def rms_share(errors: FloatArray, values: FloatArray) -> float | None:
    """Rms error over the values' rms, of several columns the largest; None where a column's values are all zero."""
    sizes = np.sqrt(np.mean(values**2, axis=0))
    return float(np.max(np.sqrt(np.mean(errors**2, axis=0)) / sizes)) if np.all(sizes > 0.0) else None


def _by_distance(distance: FloatArray, current: FloatArray) -> list[IntArray]:
    """The rows of each distance, ascending, by current."""
    order = np.lexsort((current, distance))
    return np.split(order, np.flatnonzero(np.diff(distance[order])) + 1)


def rows_of_table(
    table: SweepTable, mass_kg: float | None = None, gravity_m_s2: float = GRAVITY, kind: ActuatorKind | None = None
) -> FitRows:
    """Check a sweep table and give its rows; the kind says of several circuits' device whether it has a magnet."""
    rows = table.valid_rows()
    if rows.empty:
        raise TableError(
            f"A fit needs rows with status ok; the table has none among its {len(table.rows)}. Run the sweep again, or "
            "look at the status column for what failed."
        )
    if rows.get("force_error_N", pd.Series(dtype=float)).isna().any() and len(current_names(rows)) > 1:
        rows = rows.drop(columns="force_error_N")
    swept = current_names(rows)
    names = tuple(name.removeprefix("current_").removesuffix("_A") for name in swept) if len(swept) > 1 else ()
    circuits = names or ("",)
    settings, fluxes = ["distance_m", *current_columns(circuits)], flux_columns(circuits)
    columns: dict[str, Any] = {
        name: column_numbers(rows, name) if name in rows and rows[name].notna().any() else None
        for name in (*settings, "force_N", *fluxes, "force_error_N", "hall_T")
    }
    needed = [*settings, "force_N", *(fluxes if names else ())]
    if missing := [name for name in needed if columns[name] is None]:
        raise TableError(
            f"A fit needs the columns {', '.join(needed)}; {', '.join(missing)} missing. Sweep again, or import these "
            "columns."
        )
    if suspected := suspected_units(rows[["distance_m"]], None, solved=True):
        raise TableError(f"{suspected[0].text} Divide the column, or read it with femfit import --unit distance_m=mm.")
    distance, *currents = (snap_axis(columns[name]) if names else columns[name] for name in settings)
    _require_settings(distance, np.column_stack(currents))
    force, error, linked = columns["force_N"], columns["force_error_N"], [columns[name] for name in fluxes]
    if not force.any():
        raise TableError("force_N is 0 in every row, and nothing would move the body. Give the column of the force.")
    if silent := [name for name in fluxes if columns[name] is not None and not columns[name].any()]:
        raise TableError(f"{silent[0]} is 0 in every row. Give the column of the flux linkage, or rows with a current.")
    measured = FitRows(
        names=names,
        distance=distance,
        circuit_currents=np.column_stack(currents),
        force=force,
        force_error=np.zeros_like(force) if error is None else np.abs(error),
        flux_linkage=None if linked[0] is None else np.array(linked).T,
        hall=columns["hall_T"],
        weight=None if names or mass_kg is None else mass_kg * gravity_m_s2,
        magnet=not names or (kind is not None and kind.has_magnet),
    )
    if names and kind is None:  # nobody described the device: does it pull without a current, or leave that open?
        idle = ~measured.circuit_currents.any(axis=1)
        values = np.array([column / rms(column) for column in (force, *measured.linked.T)])
        magnet = not idle.any() or float(np.abs(values[:, idle]).max()) > constants.NETWORK_IDLE
        measured = replace(measured, magnet=magnet)
    return replace(measured, inductance=_inductance(rows, measured, circuits))


def _require_settings(distance: FloatArray, currents: FloatArray) -> None:
    """Refuse too few rows or distances, and rows that repeat another."""
    # A pair of magnets has one row a distance, and each row of several circuits has as many flux linkages
    fewest = constants.FEWEST_ROWS if currents.shape[1] == 1 and currents.any() else constants.FEWEST_DISTANCES
    if len(distance) < fewest or len(np.unique(distance)) < constants.FEWEST_DISTANCES:
        raise TableError(
            f"A fit needs at least {fewest} usable rows at {constants.FEWEST_DISTANCES} distances; instead received "
            f"{counted(len(distance), 'row')} at {counted(len(np.unique(distance)), 'distance')}. Sweep more distances."
        )
    duplicate = pd.DataFrame(np.column_stack([distance, currents])).duplicated().to_numpy()
    if duplicate.any():
        first = int(np.argmax(duplicate))
        raise TableError(
            f"Rows must differ in current or distance; {int(duplicate.sum())} repeat another, the first at "
            f"{listing(f'{i:g} A' for i in currents[first])} and {1e3 * distance[first]:g} mm. Remove the repetitions."
        )


def _inductance(rows: pd.DataFrame, measured: FitRows, circuits: Sequence[str]) -> FloatArray | None:
    """All inductances (rows, n, n); of one circuit NaN where a row has none, and None where they say nothing more."""
    places, n = inductance_columns(circuits), len(circuits)
    complete = all(name in rows and bool(rows[name].notna().all()) for name in places)
    if measured.flux_linkage is None or (not complete and (measured.several or "inductance_H" not in rows)):
        return None
    result = np.full((len(rows), n, n), np.nan)
    for name, (j, k) in places.items():
        present = rows[name].notna().to_numpy()
        result[present, j, k] = result[present, k, j] = column_numbers(rows[present].reset_index(drop=True), name)
    return result if measured.several or is_incremental(measured, result[:, 0, 0]) else None


def is_incremental(rows: FitRows, inductance: FloatArray) -> bool:
    """Whether the inductance changes with the current and is the flux linkage's slope, not their quotient.

    Programs give either d(flux linkage)/di or flux linkage / i under this name. Over each distance's currents, the
    integral of the former is the change of the flux linkage. NaN stands in rows without an inductance.
    """
    finite = np.isfinite(inductance)
    d, i, flux, slope = rows.distance[finite], rows.current[finite], rows.linked[finite, 0], inductance[finite]
    misses, bends = [], [0.0]
    for k in _by_distance(d, i):
        if len(k) > 1:
            change = np.diff(flux[k])
            integral = np.sum(0.5 * (slope[k][1:] + slope[k][:-1]) * np.diff(i[k]))
            quotient = np.max(np.abs(slope[k] * i[k] - flux[k]))
            misses.append((integral - np.sum(change), quotient, np.sum(np.abs(change))))
            bends.append(float(np.ptp(slope[k])))
    if max(bends) < constants.STRAIGHT * np.abs(slope).max(initial=0.0) or not misses:
        return False
    slope_miss, quotient_miss, changes = np.linalg.norm(misses, axis=0)
    return bool(slope_miss <= min(constants.TRAPEZOID * changes, 0.5 * quotient_miss))
