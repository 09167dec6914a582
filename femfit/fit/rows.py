"""A sweep table's rows as arrays, checked for what every fit needs."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from femfit.core.errors import TableError
from femfit.core.numerics import GRAVITY, BoolArray, FloatArray
from femfit.core.results import listing
from femfit.core.sweep_columns import flux_columns, inductance_columns
from femfit.core.text import counted
from femfit.fit.constants import (
    FAR_ABOVE_WEIGHT,
    FEWEST_DISTANCES,
    FEWEST_ROWS,
    NETWORK_IDLE,
    SMALL_CIRCUIT_FORCE,
    SMALL_FORCE,
    STRAIGHT,
    TRAPEZOID,
)
from femfit.model.validity import ActuatorKind
from femfit.tables.sweep_table import SweepTable, column_numbers, current_names, snap_axis
from femfit.tables.units import suspected_by_size


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
        if self.inductance is not None:
            return True
        return self.flux_linkage is not None and _bends(self.distance, self.current, self.flux_linkage[:, 0])

    @property
    def hanging_weight(self) -> float | None:
        """The weight, where the moving part can hang within the sweep and its forces are of that order.

        Some force is below and some above it, and the rms force is at most :data:`FAR_ABOVE_WEIGHT` times as large: a
        holding magnet that pulls a thousand times its armature's weight passes it near zero current, where nobody
        uses it.
        """
        if self.weight is None or not np.min(self.force) <= self.weight <= np.max(self.force):
            return None
        return None if self.rms_force > FAR_ABOVE_WEIGHT * self.weight else self.weight

    @property
    def rms_force(self) -> float:
        """Root mean square of the force, N."""
        return rms(self.force)

    @property
    def error_scale(self) -> tuple[float, str]:
        """What a law's errors are a part of, in N, and its name: the weight where the part can hang, or the rms."""
        weight = self.hanging_weight
        return (weight, "weight") if weight else (self.rms_force, "rms force")

    @property
    def force_scale(self) -> FloatArray:
        """What a relative error of each row's force is measured against, shape (n,).

        The force itself, but at least :data:`SMALL_FORCE` of the largest one at the same distance, and of the largest
        ones on both sides of a distance at which every force changes its sign; of several circuits, at least
        :data:`SMALL_CIRCUIT_FORCE` of the largest one.
        """
        size = np.abs(self.force)
        if self.several:
            return np.asarray(np.maximum(size, SMALL_CIRCUIT_FORCE * np.max(size)))
        largest = np.array([np.max(size[self.distance == d]) for d in self.distances])
        nearer, farther = np.maximum.accumulate(largest), np.maximum.accumulate(largest[::-1])[::-1]
        around = np.maximum(np.minimum(nearer, farther), 1e-4 * np.max(size) or 1.0)
        return np.maximum(size, SMALL_FORCE * around[np.searchsorted(self.distances, self.distance)])

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
    swept = current_names(rows)
    names = tuple(name.removeprefix("current_").removesuffix("_A") for name in swept) if len(swept) > 1 else ()
    fluxes = flux_columns(names) if names else ["flux_linkage_Wb"]
    needed = ["distance_m", *(swept if names else ["current_A"]), "force_N", *(fluxes if names else ())]
    columns = {name: _numbers(rows, name) for name in needed}
    numbers = [column for column in columns.values() if column is not None]
    if len(numbers) < len(needed):
        raise TableError(
            f"A fit needs the columns {', '.join(needed)}; "
            f"{', '.join(name for name, column in columns.items() if column is None)} missing. Sweep again, or import "
            "these columns."
        )
    suspected = suspected_by_size(rows[["distance_m"]], solved=True)
    if suspected:
        raise TableError(f"{suspected[0].text} Divide the column, or read it with femfit import --unit distance_m=mm.")
    circuits = max(1, len(names))
    distance, force = numbers[0], numbers[1 + circuits]
    currents = np.column_stack(numbers[1 : 1 + circuits])
    if names:
        distance, currents = snap_axis(distance), np.column_stack([snap_axis(column) for column in currents.T])
    _require_settings(distance, currents)
    if names and not force.any():
        raise TableError("force_N is 0 in every row, and nothing would move the body. Give the column of the force.")
    partial = bool(names) and "force_error_N" in rows and bool(rows["force_error_N"].isna().any())
    error = None if partial else _numbers(rows, "force_error_N")
    linked = [_numbers(rows, name) for name in fluxes]
    measured = FitRows(
        names=names,
        distance=distance,
        circuit_currents=currents,
        force=force,
        force_error=np.zeros_like(force) if error is None else np.abs(error),
        flux_linkage=None if linked[0] is None else np.array(linked).T,
        hall=_numbers(rows, "hall_T"),
        weight=None if names or mass_kg is None else mass_kg * gravity_m_s2,
    )
    magnet = not names or (kind is not None and kind.has_magnet)
    if names and kind is None:  # nobody described the device: does it pull without a current, or leave that open?
        idle = ~currents.any(axis=1)
        values = np.array([column / rms(column) for column in (force, *measured.linked.T)])
        magnet = not idle.any() or float(np.abs(values[:, idle]).max()) > NETWORK_IDLE
    inductance = _inductances(rows, names) if names else _inductance(rows, measured)
    return replace(measured, inductance=inductance, magnet=magnet)


def _require_settings(distance: FloatArray, currents: FloatArray) -> None:
    """Refuse too few rows or distances, and rows that repeat another."""
    # A pair of magnets has one row a distance, and each row of several circuits has as many flux linkages
    fewest = FEWEST_ROWS if currents.shape[1] == 1 and currents.any() else FEWEST_DISTANCES
    if len(distance) < fewest or len(np.unique(distance)) < FEWEST_DISTANCES:
        raise TableError(
            f"A fit needs at least {fewest} usable rows at {FEWEST_DISTANCES} distances; instead received "
            f"{counted(len(distance), 'row')} at {counted(len(np.unique(distance)), 'distance')}. Sweep more distances."
        )
    duplicate = pd.DataFrame(np.column_stack([distance, currents])).duplicated().to_numpy()
    if duplicate.any():
        first = int(np.argmax(duplicate))
        raise TableError(
            f"Rows must differ in current or distance; {int(duplicate.sum())} repeat another, the first at "
            f"{listing(f'{i:g} A' for i in currents[first])} and {1e3 * distance[first]:g} mm. Remove the repetitions."
        )


def _inductances(rows: pd.DataFrame, names: tuple[str, ...]) -> FloatArray | None:
    """All inductances of several circuits, (rows, n, n), where the table has them in every row."""
    places = inductance_columns(names)
    if not all(column in rows and bool(rows[column].notna().all()) for column in places):
        return None
    result = np.empty((len(rows), len(names), len(names)))
    for column, (j, k) in places.items():
        result[:, j, k] = result[:, k, j] = column_numbers(rows, column)
    return result


def _inductance(rows: pd.DataFrame, measured: FitRows) -> FloatArray | None:
    """One circuit's inductance, (rows, 1, 1), with NaN where a row has none; None where it says nothing more."""
    name = "inductance_H"
    present = rows[name].notna() if name in rows else np.zeros(len(rows), dtype=np.bool_)
    if measured.flux_linkage is None or not present.any():
        return None
    values = np.full(len(rows), np.nan)
    values[present] = column_numbers(rows[present].reset_index(drop=True), name)
    follows = is_incremental(measured.distance, measured.current, measured.flux_linkage[:, 0], values)
    return values[:, None, None] if follows else None


def _numbers(rows: pd.DataFrame, name: str) -> FloatArray | None:
    """A column as floats; None where it is absent or empty, an error where it has holes or text."""
    return None if name not in rows or rows[name].isna().all() else column_numbers(rows, name)


def _bends(distance: FloatArray, current: FloatArray, flux_linkage: FloatArray) -> bool:
    """Whether the flux linkage is no straight function of the current at some distance."""
    bends, largest = [0.0], 0.0
    for d in np.unique(distance):
        order = np.flatnonzero(distance == d)
        order = order[np.argsort(current[order])]
        slopes = np.diff(flux_linkage[order]) / np.diff(current[order])
        if len(slopes):
            bends.append(float(np.ptp(slopes)))
            largest = max(largest, float(np.abs(slopes).max()))
    return max(bends) > STRAIGHT * largest


def is_incremental(distance: FloatArray, current: FloatArray, flux_linkage: FloatArray, inductance: FloatArray) -> bool:
    """Whether the inductance changes with the current and is the flux linkage's slope, not their quotient.

    Programs give either d(flux linkage)/di or flux linkage / i under this name. Over each distance's currents, the
    integral of the former is the change of the flux linkage. NaN stands in rows without an inductance.
    """
    slope_misses, quotient_misses, changes, bends = [], [], [], []
    for d in np.unique(distance):
        order = np.flatnonzero((distance == d) & np.isfinite(inductance))
        if len(order) < 2:
            continue
        order = order[np.argsort(current[order])]
        i, flux, slope = current[order], flux_linkage[order], inductance[order]
        change = np.diff(flux)
        slope_misses.append(np.sum(0.5 * (slope[1:] + slope[:-1]) * np.diff(i)) - np.sum(change))
        quotient_misses.append(np.max(np.abs(slope * i - flux)))
        changes.append(np.sum(np.abs(change)))
        bends.append(np.ptp(slope))
    if not bends or max(bends) < STRAIGHT * float(np.nanmax(np.abs(inductance))):
        return False
    slope_miss, quotient_miss = (
        float(np.linalg.norm(misses) / np.linalg.norm(changes)) for misses in (slope_misses, quotient_misses)
    )
    return slope_miss <= min(TRAPEZOID, 0.5 * quotient_miss)
