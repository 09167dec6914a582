"""Field solutions of drawings as smooth functions of distance and current.

Solved at Chebyshev nodes of log distance (of the distance itself where some are zero or below) and interpolated by the
polynomial through them: the fields are analytic in the distance, so the error of the interpolation falls geometrically
(L. N. Trefethen, Approximation Theory and Approximation Practice, SIAM 2013, chapter 8). In the current a linear
drawing is a parabola. Where iron saturates the knee is sharp at small gaps: a polynomial through 13 currents misses the
force of a solenoid by 3 % of its largest. Such a drawing is measured at the currents that were solved, where nothing is
interpolated; a cubic spline serves for the small shifts that errors of the bench make.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.polynomial.chebyshev import chebvander
from scipy.interpolate import CubicSpline

from femfit.core.errors import DomainError, FieldSolverError
from femfit.core.numerics import FloatArray
from femfit.device.parts import Actuator, SweepAxes
from femfit.device.rewrite import Variant, VariantSweep
from femfit.field.sweep import Progress, run_sweep
from femfit.field.tolerance import SolverSettings
from femfit.trial.drawing_variants import has_magnet

LINEAR_DISTANCES, SATURATING_DISTANCES, CURRENTS = 16, 12, 8

_FREE_CURRENTS = 15
"""Of the saturating form of a linear drawing, whose knee is round: its gap is wide."""

_CURRENT_MARGIN = 0.05
"""Beyond the largest current, for meters that are off."""

_MARGIN = 0.06
"""Beyond either end of distances that are not positive throughout, over their span."""

_EDGE = 1.02
"""How far beyond its nodes a polynomial of this degree still holds: its last term grows at most tenfold there."""


@dataclass(frozen=True, eq=False)
class Fields:
    """What the field does at n points."""

    # In N, Wb and T; the last is zero where there is no Hall element; shape (n,)
    force: FloatArray
    flux_linkage: FloatArray
    hall: FloatArray

    def __add__(self, other: "Fields") -> "Fields":
        return Fields(self.force + other.force, self.flux_linkage + other.flux_linkage, self.hall + other.hall)

    def __sub__(self, other: "Fields") -> "Fields":
        return self + other.times(-1.0)

    def times(self, factor: FloatArray | float) -> "Fields":
        """Every field by a factor, one number or shape (n,)."""
        return Fields(factor * self.force, factor * self.flux_linkage, factor * self.hall)


@dataclass(frozen=True, eq=False)
class FieldTable:
    """Fields of a drawing."""

    distances: tuple[float, float]  # Range in m
    # For force, flux linkage and Hall field: Chebyshev polynomials in (log) distance times, for a linear drawing,
    # powers of the current, else values at the solved currents; shape (3, N_d, N_i)
    coefficients: FloatArray
    currents: tuple[float, ...] = ()  # Those that were solved, in A, ascending; empty for a linear drawing

    def at(self, distance: FloatArray, current: FloatArray) -> Fields:
        """The fields at n points, in m and A; DomainError outside of what was solved."""
        count, x = self.coefficients.shape[1:], _place(distance, self.distances)
        if np.abs(x).max(initial=0.0) > _EDGE:
            raise DomainError(_outside("distances", 1e3 * distance, 1e3 * np.array(self.distances), "mm"))
        if not self.currents:
            in_current = np.vander(current, count[1], increasing=True)
        elif current.size and (current.min() < self.currents[0] or current.max() > self.currents[-1]):
            raise DomainError(_outside("currents", current, np.array(self.currents), "A"))
        else:
            in_current = CubicSpline(self.currents, np.eye(count[1]))(current)
        values = np.einsum("na,cab,nb->cn", chebvander(x, count[0] - 1), self.coefficients, in_current, optimize=True)
        return Fields(values[0], values[1], values[2])


def _outside(what: str, values: FloatArray, solved: FloatArray, unit: str) -> str:
    return (
        f"The {what} of a virtual bench must be between {solved[0]:.3g} and {solved[-1]:.3g} {unit}, which were "
        f"solved; instead received {values.min():.3g} to {values.max():.3g} {unit}."
    )


def solve_drawings(
    drawings: Mapping[str, Actuator], directory: Path, *, workers: int, progress: Progress | None = None
) -> dict[str, FieldTable]:
    """Solve forms of one actuator as the variants of one sweep, which is taken up again where it was interrupted.

    The range is a little wider than the sweep of the first drawing, for benches whose dials are off.
    """
    first = next(iter(drawings.values()))
    distances = _range(first.sweep.distances_m)
    planned = {
        name: replace(form, sweep=_nodes(form, distances, not first.saturates)) for name, form in drawings.items()
    }
    variants = tuple(Variant((name,), form.sweep, form) for name, form in planned.items())
    sweep = VariantSweep(next(iter(planned.values())), ("form",), variants)
    rows = run_sweep(sweep, directory, workers=workers, settings=SolverSettings(), progress=progress).rows
    for _, row in rows[rows["status"] != "ok"].iterrows():
        raise FieldSolverError(
            f"The virtual bench must solve {first.name} ({row['form']}) at {1e3 * row['distance_m']:.3g} mm; it "
            f"{row['status']}. Let the sweep begin at a larger distance, or end at a smaller one."
        )
    return {name: _table(form, distances, rows[rows["form"] == name]) for name, form in planned.items()}


def _table(actuator: Actuator, distances: tuple[float, float], rows: pd.DataFrame) -> FieldTable:
    """The table of a form, of which the rows of its sweep are given."""
    axes = actuator.sweep
    currents, count = np.array(axes.currents_A), len(axes.distances_m)
    values = np.zeros((3, count, len(currents)))
    for k, column in enumerate(("force_N", "flux_linkage_Wb", "hall_T")):
        if column in rows:
            values[k] = rows[column].to_numpy().reshape(len(currents), -1).T
    in_distance = np.linalg.inv(chebvander(_chebyshev(count), count - 1))
    coefficients = np.einsum("ak,ckj->caj", in_distance, values)
    if not actuator.saturates:
        basis = np.linalg.inv(np.vander(currents, 3, increasing=True))
        return FieldTable(distances, np.einsum("caj,bj->cab", coefficients, basis))
    if currents[0] == 0.0:  # solved one way alone: a force is even in the current then, a flux odd
        mirrored = coefficients[:, :, :0:-1] * np.array([1.0, -1.0, -1.0])[:, None, None]
        coefficients = np.concatenate([mirrored, coefficients], axis=2)
        currents = np.concatenate([-currents[:0:-1], currents])
    return FieldTable(distances, coefficients, tuple(currents.tolist()))


def dialled_currents(actuator: Actuator) -> tuple[float, ...]:
    """Currents at which a saturating drawing is measured: even steps over its sweep."""
    currents = actuator.sweep.currents_A
    both = min(currents) < 0.0
    largest = max(map(abs, currents))
    return tuple(np.linspace(-largest if both else 0.0, largest, CURRENTS + (CURRENTS + 1) % 2 * both).tolist())


def _nodes(actuator: Actuator, distances: tuple[float, float], free: bool) -> SweepAxes:
    """Where a drawing is solved; ``free`` where the bench takes any current, as of a linear drawing's forms."""
    low, high = map(_coordinate(distances), distances)
    x = _chebyshev(SATURATING_DISTANCES if actuator.saturates else LINEAR_DISTANCES)
    nodes = 0.5 * (low + high) + 0.5 * (high - low) * x
    largest = (1.0 + _CURRENT_MARGIN) * max(map(abs, actuator.sweep.currents_A))
    currents: tuple[float, ...] = (-largest, 0.0, largest)
    if actuator.saturates and free:
        currents = tuple(np.linspace(-largest, largest, _FREE_CURRENTS).tolist())
    elif actuator.saturates:
        dialled = dialled_currents(actuator)
        first = dialled[0] - _CURRENT_MARGIN * dialled[-1]
        currents = (first, *dialled, largest) if has_magnet(actuator) else (*(i for i in dialled if i >= 0), largest)
    return SweepAxes(currents, tuple((np.exp(nodes) if distances[0] > 0.0 else nodes).tolist()))


def _range(swept: tuple[float, ...]) -> tuple[float, float]:
    """A little more than was swept; not where the parts touch."""
    low, high = swept[0], swept[-1]
    if low > 0.0:
        return 0.8 * low, 1.06 * high
    margin = _MARGIN * (high - low)
    return low - margin if low < 0.0 else low, high + margin


def _coordinate(distances: tuple[float, float]) -> Callable[[FloatArray | float], FloatArray | float]:
    return np.log if distances[0] > 0.0 else np.asarray


def _place(distance: FloatArray, distances: tuple[float, float]) -> FloatArray:
    """Distances between -1 and 1 of their range."""
    coordinate = _coordinate(distances)
    low, high = map(coordinate, distances)
    return np.asarray((2.0 * coordinate(distance) - low - high) / (high - low))


def _chebyshev(count: int) -> FloatArray:
    return np.asarray(np.cos(np.pi * (np.arange(count) + 0.5) / count)[::-1])
