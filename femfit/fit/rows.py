"""A sweep table's rows as arrays, checked for what every fit needs."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from femfit.core.errors import TableError
from femfit.core.numerics import BoolArray, FloatArray
from femfit.core.text import counted
from femfit.fit.constants import FAR_ABOVE_WEIGHT, FEWEST_DISTANCES, FEWEST_ROWS, SMALL_FORCE, STRAIGHT, TRAPEZOID
from femfit.tables.sweep_table import SweepTable
from femfit.tables.units import suspected_by_size


@dataclass(frozen=True, eq=False)
class FitRows:
    """Rows of a sweep, SI units, shape (n,) each."""

    distance: FloatArray
    current: FloatArray
    force: FloatArray
    flux_linkage: FloatArray | None
    hall: FloatArray | None
    force_error: FloatArray  # Estimated error of the force; zero where the table gives none
    weight: float | None  # Weight m g of the moving part in N, where the mass is known
    inductance: FloatArray | None = None  # d(flux linkage)/di, beside the flux linkage; NaN in rows without

    @property
    def currents(self) -> FloatArray:
        """Distinct currents, ascending."""
        return np.unique(self.current)

    @property
    def distances(self) -> FloatArray:
        """Distinct distances, ascending."""
        return np.unique(self.distance)

    @property
    def without_current(self) -> bool:
        """Whether no row carries a current, as of a pair of magnets."""
        return not self.current.any()

    @property
    def saturates(self) -> bool:
        """Whether the inductance, or the flux linkage's slope where none is given, changes with the current."""
        if self.inductance is not None:
            return True
        return self.flux_linkage is not None and _bends(self.distance, self.current, self.flux_linkage)

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
        ones on both sides of a distance at which every force changes its sign.
        """
        size = np.abs(self.force)
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


def rows_of_table(table: SweepTable, mass_kg: float | None, gravity_m_s2: float) -> FitRows:
    """Check a sweep table and give its rows."""
    rows = table.valid_rows()
    if rows.empty:
        raise TableError(
            f"A fit needs rows with status ok; the table has none among its {len(table.rows)}. Run the sweep again, or "
            "look at the status column for what failed."
        )
    columns: dict[str, FloatArray | None] = {
        name: _numbers(rows, name) for name in ("distance_m", "current_A", "force_N")
    }
    distance, current, force = (columns[name] for name in ("distance_m", "current_A", "force_N"))
    if distance is None or current is None or force is None:
        missing = ", ".join(name for name, values in columns.items() if values is None)
        raise TableError(f"A fit needs the columns distance_m, current_A and force_N; {missing} missing.")
    suspected = suspected_by_size(rows[["distance_m"]], solved=True)
    if suspected:
        raise TableError(f"{suspected[0].text} Divide the column, or read it with femfit import --unit distance_m=mm.")
    fewest = FEWEST_ROWS if current.any() else FEWEST_DISTANCES  # a pair of magnets has one row a distance
    if len(distance) < fewest or len(np.unique(distance)) < FEWEST_DISTANCES:
        raise TableError(
            f"A fit needs at least {fewest} usable rows at {FEWEST_DISTANCES} distances; instead received "
            f"{counted(len(distance), 'row')} at {counted(len(np.unique(distance)), 'distance')}. Sweep more distances."
        )
    duplicate = rows.duplicated(subset=["distance_m", "current_A"])
    if duplicate.any():
        first = rows[duplicate].iloc[0]
        raise TableError(
            f"Rows must differ in current or distance; {int(duplicate.sum())} repeat another, the first at "
            f"{first['current_A']:g} A and {1e3 * first['distance_m']:g} mm. Remove the repetitions."
        )
    error = _numbers(rows, "force_error_N")
    flux = _numbers(rows, "flux_linkage_Wb")
    return FitRows(
        distance=distance,
        current=current,
        force=force,
        flux_linkage=flux,
        hall=_numbers(rows, "hall_T"),
        force_error=np.zeros_like(force) if error is None else np.abs(error),
        weight=None if mass_kg is None else mass_kg * gravity_m_s2,
        inductance=None if flux is None else incremental_inductance(distance, current, flux, _inductance(rows)),
    )


def _inductance(rows: pd.DataFrame) -> FloatArray | None:
    """The inductance, with NaN where a row has none."""
    name = "inductance_H"
    present = rows[name].notna() if name in rows else np.zeros(len(rows), dtype=np.bool_)
    if not present.any():
        return None
    values = np.full(len(rows), np.nan)
    values[present] = column_numbers(rows[present].reset_index(drop=True), name)
    return values


def _numbers(rows: pd.DataFrame, name: str) -> FloatArray | None:
    """A column as floats; None where it is absent or empty, an error where it has holes or text."""
    return None if name not in rows or rows[name].isna().all() else column_numbers(rows, name)


def column_numbers(rows: pd.DataFrame, name: str) -> FloatArray:
    """A column as floats; an error where it has holes or text."""
    try:
        values = rows[name].to_numpy(dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise TableError(f"Column {name} must be numeric; {error}.") from error
    if not np.all(np.isfinite(values)):
        where = int(np.flatnonzero(~np.isfinite(values))[0])
        raise TableError(
            f"Column {name} must hold finite numbers in every row with status ok; row {where + 1} holds "
            f"{values[where]}. Remove the row, give it another status, or drop the column."
        )
    return values


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


def incremental_inductance(
    distance: FloatArray, current: FloatArray, flux_linkage: FloatArray, inductance: FloatArray | None
) -> FloatArray | None:
    """The inductance where it changes with the current and is the flux linkage's slope, not their quotient; else None.

    Programs give either d(flux linkage)/di or flux linkage / i under this name. Over each distance's currents, the
    integral of the former is the change of the flux linkage. NaN in rows without an inductance.
    """
    if inductance is None:
        return None
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
        return None
    slope_miss, quotient_miss = (
        float(np.linalg.norm(misses) / np.linalg.norm(changes)) for misses in (slope_misses, quotient_misses)
    )
    return inductance if slope_miss <= min(TRAPEZOID, 0.5 * quotient_miss) else None
