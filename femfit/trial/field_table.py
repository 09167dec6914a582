"""Field solutions of drawings as smooth functions of distance and current.

Solved at Chebyshev nodes of log distance (of the distance itself where some are zero or below) and of current (powers
where all is linear), and interpolated by the polynomial through them: the fields are analytic in both, so the error of
the interpolation falls geometrically (L. N. Trefethen, Approximation Theory and Approximation Practice, SIAM 2013,
chapter 8).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.polynomial.chebyshev import chebvander

from femfit.core.arrays import FloatArray
from femfit.core.errors import DomainError, FieldSolverError
from femfit.device.parts import Actuator, NonlinearMaterial, SweepAxes
from femfit.device.variants import Variant, VariantSweep
from femfit.field.settings import SolverSettings
from femfit.field.sweep import Progress, run_sweep

LINEAR_DISTANCES, SATURATING_DISTANCES, CURRENTS = 16, 12, 13

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
    current: float  # Largest magnitude in A; the polynomials of a linear drawing hold beyond
    # For force, flux linkage and Hall field: Chebyshev polynomials in (log) distance times, for a linear drawing,
    # powers of the current, else Chebyshev polynomials in the current; shape (3, N_d, N_i)
    coefficients: FloatArray
    linear: bool

    def at(self, distance: FloatArray, current: FloatArray) -> Fields:
        """The fields at n points, in m and A; DomainError outside of what was solved."""
        count, x = self.coefficients.shape[1:], _place(distance, self.distances)
        largest = float(np.abs(current).max(initial=0.0))
        if np.abs(x).max(initial=0.0) > _EDGE or (not self.linear and largest > _EDGE * self.current):
            raise DomainError(
                f"The virtual bench must stay within {1e3 * self.distances[0]:.3g} to {1e3 * self.distances[1]:.3g} mm "
                f"and {self.current:.3g} A; instead received {1e3 * distance.min():.3g} to "
                f"{1e3 * distance.max():.3g} mm and {largest:.3g} A."
            )
        powers = np.vander(current, count[1], increasing=True)
        in_current = powers if self.linear else chebvander(current / self.current, count[1] - 1)
        values = np.einsum("na,cab,nb->cn", chebvander(x, count[0] - 1), self.coefficients, in_current, optimize=True)
        return Fields(values[0], values[1], values[2])


def solve_drawings(
    drawings: Mapping[str, Actuator], directory: Path, *, workers: int, progress: Progress | None = None
) -> dict[str, FieldTable]:
    """Solve forms of one actuator as the variants of one sweep, which is taken up again where it was interrupted.

    The range is a little wider than the sweep of the first drawing, for benches whose dials are off.
    """
    first = next(iter(drawings.values()))
    low, high = _range(first.sweep.distances_m)
    current = 1.05 * max(map(abs, first.sweep.currents_A))
    planned = {name: replace(one, sweep=_nodes(one, (low, high), current)) for name, one in drawings.items()}
    variants = tuple(Variant((name,), one.sweep, one) for name, one in planned.items())
    sweep = VariantSweep(next(iter(planned.values())), ("form",), variants)
    rows = run_sweep(sweep, directory, workers=workers, settings=SolverSettings(), progress=progress).rows
    for _, row in rows[rows["status"] != "ok"].iterrows():
        raise FieldSolverError(
            f"The virtual bench must solve {first.name} ({row['form']}) at {1e3 * row['distance_m']:.3g} mm; it "
            f"{row['status']}. Let the sweep begin at a larger distance, or end at a smaller one."
        )
    result = {}
    for name, one in planned.items():
        x, axes, linear = rows[rows["form"] == name], one.sweep, _is_linear(one)
        values = np.zeros((3, len(axes.distances_m), len(axes.currents_A)))
        for k, column in enumerate(("force_N", "flux_linkage_Wb", "hall_T")):
            if column in x:
                values[k] = x[column].to_numpy().reshape(len(axes.currents_A), -1).T
        i, count = np.array(axes.currents_A), len(axes.distances_m)
        basis = np.vander(i, 3, increasing=True) if linear else chebvander(i / current, len(i) - 1)
        in_distance = np.linalg.inv(chebvander(_chebyshev(count), count - 1))
        coefficients = np.einsum("ak,ckj,bj->cab", in_distance, values, np.linalg.inv(basis))
        result[name] = FieldTable((low, high), current, coefficients, linear)
    return result


def _is_linear(actuator: Actuator) -> bool:
    parts = (*actuator.fixed, *actuator.moving.regions)
    return not any(isinstance(region.material, NonlinearMaterial) for region in parts)


def _nodes(actuator: Actuator, distances: tuple[float, float], current: float) -> SweepAxes:
    linear = _is_linear(actuator)
    low, high = map(_coordinate(distances), distances)
    x = _chebyshev(LINEAR_DISTANCES if linear else SATURATING_DISTANCES)
    nodes = 0.5 * (low + high) + 0.5 * (high - low) * x
    currents = (-current, 0.0, current) if linear else tuple((current * _chebyshev(CURRENTS)).tolist())
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
    of = _coordinate(distances)
    low, high = map(of, distances)
    return np.asarray((2.0 * of(distance) - low - high) / (high - low))


def _chebyshev(count: int) -> FloatArray:
    return np.asarray(np.cos(np.pi * (np.arange(count) + 0.5) / count)[::-1])
