"""Identify a magnet's field for its current from lab runs: the bounded QP over polynomial, play operators, eddy lags.

Strengths of plays and lags are bounded below by zero: a loop runs in one direction, and an eddy current delays.

References
----------
P. Arpaia et al., Sensors 22 (2022) 182, section 5 (the wish for a nonlinear current-to-field model).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from femfit.core.arrays import BoolArray, FloatArray
from femfit.core.errors import FitError
from femfit.fit.bounded_qp import active_set_least_squares, solve_bounded_qp
from femfit.integrate.field_of_current import FieldModel, FieldTerms, field_columns, precycled

PATH_INTERVAL = 0.01
"""Seconds of a lab run that are averaged to one step of the current's path."""

ROW_STEPS = 10
"""Steps of the path that are averaged, field and columns alike, to one row of the fit."""

ROW_SIGMA = 1e-5
"""Believed error of a row, relative to the largest field."""

STRENGTH_SIGMA = 1e-2
"""Believed size of a play's or a lag's strength, relative to largest field over largest current: it decides between
columns that the runs do not tell apart."""

LEAST_SHARE = 0.01
"""Conventional: a current below zero by more than this part of the largest one is a second polarity, and no offset."""

FOLDS = 6
"""Stretches that are left out in turn to find the model's error."""

# Radii as fractions of the largest current: small ones for the loop's tips, large ones for its width.
_RADII = (1 / 64, 1 / 32, 1 / 16, 1 / 8, 1 / 4, 3 / 8, 1 / 2)


@dataclass(frozen=True, eq=False)
class LabRun:
    """Currents and the field that a drift-free filter found, from a magnet cycled to its largest current before.

    Parameters
    ----------
    time, current, field : array, shape (n,)
        In s, A and T.
    """

    time: FloatArray
    current: FloatArray
    field: FloatArray


def usual_terms(current_max: float, lag_times: Sequence[float] = (3.0, 10.0, 30.0)) -> FieldTerms:
    """Polynomial of degree 7, seven play operators, three lags, for cycles up to a largest current."""
    return FieldTerms(current_max, 7, tuple(current_max * fraction for fraction in _RADII), tuple(lag_times))


def identify_field(runs: Sequence[LabRun], terms: FieldTerms | None = None) -> FieldModel:
    """Fit the field to the current over lab runs.

    Parameters
    ----------
    terms : FieldTerms or None
        The usual ones for the largest current of the runs where None.
    """
    if not runs:
        raise FitError("A field model needs at least one lab run; instead received none.")
    paths = [_path(run) for run in runs]
    top = max(float(run.current.max()) for run in paths)
    if terms is None:
        if top <= 0.0:
            raise FitError(f"A lab run must reach a current > 0 A; instead the largest is {top:g} A.")
        terms = usual_terms(top)
    low = min(float(run.current.min()) for run in paths)
    if low < -LEAST_SHARE * top:
        raise FitError(
            f"A lab run must stay between 0 A and its largest current, {top:g} A, to which the magnet was cycled; "
            f"instead it goes down to {low:g} A. Record and integrate one polarity at a time."
        )
    matrices = [_means(field_columns(terms, precycled(terms), run.time, run.current)[1], ROW_STEPS) for run in paths]
    whole, target = np.concatenate(matrices), np.concatenate([_means(run.field, ROW_STEPS) for run in paths])
    used = np.flatnonzero(np.any(whole != 0.0, axis=0))
    whole = whole[:, used]
    free = terms.degree + 1
    lower = np.where(used < free, -np.inf, 0.0)
    names = [terms.names[k] for k in used]
    problem = _Problem(whole, target, lower, float(np.abs(target).max()), top)
    solution = solve_bounded_qp(*problem.rows(np.ones(len(target), dtype=np.bool_)), lower, names=names)
    coefficients = np.zeros(len(terms.names))
    coefficients[used] = solution.x
    current = np.concatenate([_means(run.current, ROW_STEPS) for run in paths])
    return FieldModel(terms, coefficients, _left_out_rms(problem, current))


def _path(run: LabRun) -> LabRun:
    """A run with a sample each :data:`PATH_INTERVAL`."""
    size = max(1, round(PATH_INTERVAL / float(np.median(np.diff(run.time)))))
    return LabRun(_means(run.time, size), _means(run.current, size), _means(run.field, size))


def _means(values: FloatArray, size: int) -> FloatArray:
    """Means of so many consecutive rows; the incomplete last ones are dropped."""
    rows = len(values) // size
    return np.asarray(values[: rows * size].reshape(rows, size, *values.shape[1:]).mean(axis=1))


@dataclass(frozen=True, eq=False)
class _Problem:
    """Rows of the fit, and what is believed of the strengths without them."""

    matrix: FloatArray
    target: FloatArray
    lower: FloatArray
    field_max: float
    current_max: float

    def rows(self, kept: BoolArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Matrix, target and sigma of the kept rows, and one prior row for each bounded strength."""
        bounded = np.flatnonzero(np.isfinite(self.lower))
        prior = np.zeros((len(bounded), len(self.lower)))
        prior[np.arange(len(bounded)), bounded] = 1.0
        strength = STRENGTH_SIGMA * self.field_max / self.current_max
        sigma = np.r_[np.full(int(kept.sum()), ROW_SIGMA * self.field_max), np.full(len(bounded), strength)]
        target = np.r_[self.target[kept], np.zeros(len(bounded))]
        return np.concatenate([self.matrix[kept], prior]), target, sigma


def _left_out_rms(problem: _Problem, current: FloatArray) -> float:
    """Rms error on each stretch of the runs when fitted to the others, at currents that the others reach."""
    squares = []
    for rows in np.array_split(np.arange(len(current)), FOLDS):
        others = np.ones(len(current), dtype=np.bool_)
        others[rows] = False
        reached = rows[(current[rows] <= current[others].max()) & (current[rows] >= current[others].min())]
        x = active_set_least_squares(*problem.rows(others), problem.lower)
        squares.append(np.square(problem.matrix[reached] @ x - problem.target[reached]))
    return float(np.sqrt(np.mean(np.concatenate(squares))))
