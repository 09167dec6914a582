"""Field solutions of one drawing as smooth functions of distance and current.

Solved at Chebyshev nodes of log distance (and of current, where iron saturates) and interpolated by the polynomial
through them: force, flux linkage and Hall field are analytic in both, so the interpolation error falls geometrically.

References
----------
L. N. Trefethen, Approximation Theory and Approximation Practice (SIAM, 2013), chapter 8.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.polynomial.chebyshev import chebvander

from femfit.core.arrays import FloatArray
from femfit.device.parts import Actuator, NonlinearMaterial, SweepAxes

LINEAR_DISTANCES, SATURATING_DISTANCES, CURRENTS = 16, 12, 13


@dataclass(frozen=True, eq=False)
class Fields:
    """What the field does at some points.

    Parameters
    ----------
    force, flux_linkage, hall : array, shape (n,)
        In N, Wb and T; the last is zero where there is no Hall element.
    """

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
    """Fields of a drawing.

    Parameters
    ----------
    distances : (float, float)
        Range in m.
    current : float
        Largest magnitude in A; the polynomials of a linear drawing hold beyond.
    coefficients : array, shape (3, N_d, N_i)
        Of force, flux linkage and Hall field: Chebyshev polynomials in log distance times, for a linear drawing, powers
        of the current, else Chebyshev polynomials in the current.
    """

    distances: tuple[float, float]
    current: float
    coefficients: FloatArray
    linear: bool

    def at(self, distance: FloatArray, current: FloatArray) -> Fields:
        """The fields at points.

        Parameters
        ----------
        distance, current : array, shape (n,)
            In m and A.
        """
        count = self.coefficients.shape[1:]
        in_distance = chebvander(_unit(distance, self.distances), count[0] - 1)
        powers = np.vander(current, count[1], increasing=True)
        in_current = powers if self.linear else chebvander(current / self.current, count[1] - 1)
        values = np.einsum("na,cab,nb->cn", in_distance, self.coefficients, in_current)
        return Fields(values[0], values[1], values[2])


def _unit(distance: FloatArray, limits: tuple[float, float]) -> FloatArray:
    low, high = np.log(limits)
    return np.asarray((2.0 * np.log(distance) - low - high) / (high - low))


def _nodes(count: int) -> FloatArray:
    return np.cos(np.pi * (np.arange(count) + 0.5) / count)[::-1]


def solve_field_table(actuator: Actuator, distances: tuple[float, float], current: float) -> FieldTable:
    """Solve a drawing at the nodes.

    Parameters
    ----------
    distances : (float, float)
        Range in m.
    current : float
        Largest magnitude in A.
    """
    from ngsolve import SetNumThreads  # noqa: PLC0415  the solver loads where it is used

    from femfit.field.layout import layout_of, stretch_groups  # noqa: PLC0415
    from femfit.field.problem import prepare  # noqa: PLC0415
    from femfit.field.settings import SolverSettings  # noqa: PLC0415

    SetNumThreads(1)  # drawings are the parallel axis
    parts = (*actuator.fixed, *actuator.moving.regions)
    linear = not any(isinstance(region.material, NonlinearMaterial) for region in parts)
    x = _nodes(LINEAR_DISTANCES if linear else SATURATING_DISTANCES)
    low, high = np.log(distances)
    at = tuple(np.exp(0.5 * (low + high) + 0.5 * (high - low) * x).tolist())
    currents = (-current, 0.0, current) if linear else tuple((current * _nodes(CURRENTS)).tolist())
    planned = replace(actuator, sweep=SweepAxes(currents_A=currents, distances_m=at))
    settings = SolverSettings()
    layout = layout_of(planned, settings)
    values = np.zeros((3, len(at), len(currents)))
    for group in stretch_groups(at, layout, settings):
        problem = prepare(planned, group, layout, settings)
        for distance in group:
            rows = problem.rows(distance, currents)
            k = at.index(distance)
            values[0, k], values[1, k] = rows["force_N"], rows["flux_linkage_Wb"]
            if "hall_T" in rows:
                values[2, k] = rows["hall_T"]
    in_distance = np.linalg.inv(chebvander(x, len(x) - 1))
    i = np.array(currents)
    basis = np.vander(i, 3, increasing=True) if linear else chebvander(i / current, len(i) - 1)
    coefficients = np.einsum("ak,ckj,bj->cab", in_distance, values, np.linalg.inv(basis))
    return FieldTable(distances, current, coefficients, linear)


def save_field_table(table: FieldTable, path: Path) -> None:
    """Write a table."""
    head = np.array([*table.distances, table.current, float(table.linear)])
    np.savez(path, head=head, coefficients=table.coefficients)


def load_field_table(path: Path) -> FieldTable:
    """Read a table that was written."""
    with np.load(path) as data:
        low, high, current, linear = data["head"]
        return FieldTable((float(low), float(high)), float(current), data["coefficients"], bool(linear))
