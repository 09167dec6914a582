"""A force law fitted to a sweep: nonlinear parameters, two stages and the joint fit beside them; as magnetics."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import t as student

from femfit.core.errors import FitError, UsageError
from femfit.core.numerics import BoolArray, FloatArray, first_best
from femfit.core.text import counted
from femfit.fit.bounded_qp import QPSolution, non_negative
from femfit.fit.constants import JACKKNIFE_BLOCKS, NEGLIGIBLE, STEPS
from femfit.fit.law_columns import (
    FUNCTIONS,
    CoefficientFunction,
    TermBounds,
    coefficient_bounds,
    design_matrix,
    fit_coefficient_function,
    fit_each_current,
    term_bounds,
)
from femfit.fit.rows import FitRows
from femfit.laws.catalogue import all_laws
from femfit.laws.law import LONGEST_M, ForceLaw
from femfit.model.magnetics import Coefficient, LawMagnetics


def search_shape(
    law: ForceLaw, residual: Callable[[Mapping[str, float]], FloatArray], start: Mapping[str, float] | None = None
) -> dict[str, float]:
    """The shape with the least sum of squares of ``residual(shape)``, which is of the order of one a row.

    Variable projection: the law's coefficients are solved for at every trial. Starts from ``start``, or from the law's
    first guess and two further ones; FitError if none reaches a minimum.

    References
    ----------
    G. Golub and V. Pereyra, SIAM J. Numer. Anal. 10 (1973) 413.
    """
    if not law.shape:
        return {}
    lower = np.array([p.lower for p in law.shape])

    def named(unit: FloatArray) -> dict[str, float]:
        values = lower * (LONGEST_M / lower) ** unit
        return {p.name: float(v) for p, v in zip(law.shape, values, strict=True)}

    first = np.array([p.start if start is None else start[p.name] for p in law.shape])
    unit = np.log(first / lower) / np.log(LONGEST_M / lower)

    def misfit(unit: FloatArray) -> FloatArray:
        return residual(named(unit))

    minima = [
        least_squares(
            misfit, np.clip(unit + step, 1e-3, 1.0 - 1e-3), bounds=(0.0, 1.0), xtol=1e-10, gtol=1e-10, ftol=1e-10
        )
        for step in (STEPS if start is None else STEPS[:1])
    ]
    best = minima[first_best([-float(r.cost) for r in minima])]
    if not best.success:
        raise FitError(f"The shape of law {law.name} was not found: {best.message} Try another law.")
    return named(best.x)


@dataclass(frozen=True, eq=False)
class LawFit:
    """A fitted law."""

    law: ForceLaw
    rows: FitRows
    shape: Mapping[str, float]
    functions: tuple[str, ...]
    stage_one: FloatArray  # Coefficient of each column at each current by itself; shape (m, k)
    stage_two: tuple[CoefficientFunction, ...]
    joint: QPSolution  # The one-stage fit of the same terms to all rows
    limits: TermBounds

    @property
    def terms(self) -> tuple[tuple[str, int], ...]:
        """Column and power of the current of each term, as :func:`design_matrix` has them."""
        columns = zip(self.law.basis, self.functions, strict=True)
        return tuple((basis, power) for basis, name in columns for power in FUNCTIONS[name])

    def refit(self, subset: BoolArray) -> tuple[dict[str, float], FloatArray]:
        """Shape and coefficients for some of the rows alone, within the same bounds."""
        fitted, sigma = self.rows.take(subset), law_sigma(self.rows)[subset]
        shape = fit_shape(self.law, fitted, sigma, self.shape)
        matrix = design_matrix(self.law, shape, self.functions, fitted.distance, fitted.current)
        return shape, self.limits.problem(matrix, fitted.force, sigma).solve_unproven()

    @cached_property
    def _jackknife(self) -> tuple[FloatArray, FloatArray]:
        """Covariance of all terms and shape parameters, and half of their 95 % intervals.

        By a delete-a-block jackknife over neighbouring distances with all their currents, shape parameters fitted again
        each time. Intervals for independent residuals would be too narrow: the law's own misfit is the same at
        neighbours and all currents.
        """
        count = min(JACKKNIFE_BLOCKS, len(self.rows.distances))
        blocks = np.array_split(self.rows.distances, count)
        again = [self.refit(~np.isin(self.rows.distance, block)) for block in blocks]
        table = np.array([np.concatenate([x, list(shape.values())]) for shape, x in again])
        centred = table - table.mean(axis=0)
        covariance = (count - 1) / count * centred.T @ centred
        return covariance, student.ppf(0.975, count - 1) * np.sqrt(np.diag(covariance))

    @property
    def covariance(self) -> FloatArray:
        """Of the terms, shape (terms, terms)."""
        return self._jackknife[0][: len(self.terms), : len(self.terms)]

    @property
    def interval(self) -> FloatArray:
        """95 % intervals of the terms, shape (terms, 2)."""
        half = self._jackknife[1][: len(self.terms)]
        return np.stack([self.joint.x - half, self.joint.x + half], axis=1)

    @property
    def shape_interval(self) -> dict[str, tuple[float, float]]:
        """95 % interval of each nonlinear parameter."""
        halves = zip(self.shape.items(), self._jackknife[1][len(self.terms) :].tolist(), strict=True)
        return {name: (value - half, value + half) for (name, value), half in halves}

    @property
    def operations(self) -> int:
        """Floating-point operations of one evaluation with the chosen functions."""
        return self.law.operations_with([FUNCTIONS[name] for name in self.functions])

    @property
    def active(self) -> tuple[str, ...]:
        """The bounds that the coefficients stand on, in words."""
        return self.limits.active(self.joint)

    @property
    def coefficients(self) -> tuple[Coefficient, ...]:
        """The terms as a model has them; one on its bound has no interval."""
        sides = self.limits.active_sides(self.joint)
        units = dict(zip(self.law.basis, self.law.coefficient_units, strict=True))
        return tuple(
            Coefficient(
                basis=basis,
                current_power=power,
                value=float(self.joint.x[n]),
                unit=f"{units[basis]} A^-{power}" if power else units[basis],
                ci95=None if sides[n] else (float(self.interval[n, 0]), float(self.interval[n, 1])),
                bounds=(float(self.limits.lower[n]), float(self.limits.upper[n])),
                active=sides[n],
            )
            for n, (basis, power) in enumerate(self.terms)
        )

    @property
    def term_rows(self) -> list[tuple[str, int, float | None, tuple[float, float], str]]:
        """Column, power of the current, value, interval and unit of each coefficient, then of each nonlinear parameter.

        A value is None where the table leaves its sign open.
        """
        rows: list[tuple[str, int, float | None, tuple[float, float], str]] = []
        for c, (low, high) in zip(self.coefficients, self.interval.tolist(), strict=True):
            open_sign = low < 0.0 < high and not c.active
            rows.append((c.basis, c.current_power, None if open_sign else c.value, (low, high), c.unit))
        shape = self.shape_interval
        return rows + [(p.name, 0, self.shape[p.name], shape[p.name], "m") for p in self.law.shape]

    def magnetics(self, inductance_H: float | None = None) -> LawMagnetics:
        """The law with its coefficients; inductance and flux linkage at the farthest point follow the table."""
        rows, farthest = self.rows, float(self.rows.distances[-1])
        law = LawMagnetics(
            self.law.name, self.coefficients, dict(self.shape), inductance_H or 0.0, reference_distance_m=farthest
        )
        if rows.flux_linkage is None:
            return law
        remaining = rows.flux_linkage[:, 0] - law.flux_linkage(rows.distance, rows.circuit_currents)[:, 0]
        # Columns for an inductance >= 0 and a flux linkage of either sign.
        constant, largest = np.ones_like(rows.current), float(np.max(np.abs(rows.current))) or 1.0
        matrix = np.stack([rows.current / largest, constant, -constant], axis=1)
        inductance, plus, minus = non_negative(matrix, remaining)[0].tolist()
        return replace(law, constant_inductance_H=inductance / largest, constant_flux_linkage_Wb=plus - minus)


def law_sigma(rows: FitRows) -> FloatArray:
    """Standard deviation in N for which a law's rows are weighted: the same everywhere, and the row's own error.

    A thousandth of the weight, or of the rms force: with an equal sigma the weighted sum is the plain sum of squares.
    """
    return np.hypot(1e-3 * rows.error_scale[0], rows.force_error)


def fit_law(
    law: ForceLaw,
    rows: FitRows,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    functions: Sequence[str] | None = None,
) -> LawFit:
    """Fit a force law in two stages, and jointly, within bounds of single columns and else the law's own."""
    if functions is not None and (len(functions) != len(law.basis) or not set(functions) <= set(FUNCTIONS)):
        raise UsageError(
            f"Coefficient functions must be one of {', '.join(FUNCTIONS)} for each of "
            f"{counted(len(law.basis), 'column')} "
            f"({', '.join(law.basis)}); instead received {', '.join(functions)}."
        )
    if rows.distances[0] <= 0.0 and not law.passes_face:
        raise FitError(
            f"Law {law.name} must have distances > 0, because it is infinite near the face; instead the least is "
            f"{1e3 * rows.distances[0]:g} mm. Take the co-energy, or one of the laws "
            f"{', '.join(name for name, candidate in all_laws().items() if candidate.passes_face)}."
        )
    if rows.without_current:
        functions = ("constant",) * len(law.basis)
    sigma, within = law_sigma(rows), coefficient_bounds(law, rows.currents, bounds)
    shape = fit_shape(law, rows, sigma)
    stage_one = fit_each_current(law, shape, rows, sigma, within)
    scale, _ = rows.error_scale
    typical = np.sqrt(np.mean(law.columns(rows.distance, shape) ** 2, axis=0))
    negligible = NEGLIGIBLE * scale / typical
    stage_two = tuple(
        fit_coefficient_function(
            rows.currents,
            stage_one[:, k],
            basis,
            within[:, :, [k]],
            None if functions is None else functions[k],
            float(negligible[k]),
        )
        for k, basis in enumerate(law.basis)
    )
    chosen = tuple(function.name for function in stage_two)
    matrix = design_matrix(law, shape, chosen, rows.distance, rows.current)
    limits = term_bounds(chosen, law.basis, rows.currents, within)
    joint = limits.problem(matrix, rows.force, sigma).solve()
    return LawFit(law, rows, shape, chosen, stage_one, stage_two, joint, limits)


def fit_shape(
    law: ForceLaw, rows: FitRows, sigma: FloatArray, start: Mapping[str, float] | None = None
) -> dict[str, float]:
    """The law's nonlinear parameters for a table's forces, with quadratic coefficient functions."""
    # As free in the current as the table allows, since stage two chooses the functions only afterwards.
    functions = ({1: "constant", 2: "affine"}.get(len(rows.currents), "quadratic"),) * len(law.basis)
    target = rows.force / sigma

    def residual(shape: Mapping[str, float]) -> FloatArray:
        matrix = design_matrix(law, shape, functions, rows.distance, rows.current) / sigma[:, None]
        q_factor = np.linalg.qr(matrix / np.linalg.norm(matrix, axis=0))[0]
        return np.asarray(target - q_factor @ (q_factor.T @ target))

    return search_shape(law, residual, start)
