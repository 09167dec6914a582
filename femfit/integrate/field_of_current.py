"""A magnet's field from its current: polynomial, hysteresis by play operators, eddy lag. Linear in its coefficients.

B = sum_n p_n T_n(2 x - 1) + sum_j (u_j (1 - x^2)^2 + 2 m_j x^2 (1 - x^2) + s_j x^4) (P_j - I) - sum_l c_l e_l,

with x = I / I_max, Chebyshev polynomials T_n, and the play operators P_j = max(I - r_j, min(I + r_j, P_j)), which lag
behind the current by at most r_j and carry the hysteresis with its wiping-out; their strengths at zero, medium and full
current are apart because saturation narrows the loop; and the eddy lags e_l' = -e_l / tau_l + dI/dt.

The coefficients are fitted to lab runs. Strengths of plays and lags are bounded below by zero: a loop runs in one
direction, and an eddy current delays.

I. Mayergoyz, Mathematical Models of Hysteresis and their Applications (Elsevier, 2003), 1.3 (wiping-out); A. Visintin,
Differential Models of Hysteresis (Springer, 1994), III.1 (play); G. Moritz, arXiv:1103.1800 (eddy currents).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from femfit.core.errors import FitError
from femfit.core.numerics import FloatArray
from femfit.fit.bounded_qp import BoundedQP

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
_LAG_TIMES_S = (3.0, 10.0, 30.0)


@dataclass(frozen=True)
class FieldTerms:
    """Which terms a field model has; the magnet was cycled to ``current_max_A`` before the record."""

    current_max_A: float
    degree: int = 7
    play_radii_A: tuple[float, ...] = ()
    lag_times_s: tuple[float, ...] = ()


@dataclass(frozen=True, eq=False)
class MagnetState:
    """What a magnet remembers: P_j and e_l in A, and time and current of the last sample, NaN before the first."""

    plays: FloatArray
    lags: FloatArray
    time: float = float("nan")
    current: float = float("nan")


@dataclass(frozen=True, eq=False)
class FieldModel:
    """A field model with its coefficients, in the order of :func:`field_columns`, and the rms of its error in T."""

    terms: FieldTerms
    coefficients: FloatArray
    rms_T: float

    def advance(self, state: MagnetState, time: FloatArray, current: FloatArray) -> tuple[MagnetState, FloatArray]:
        """Field in T of a stretch of currents, shape (n,)."""
        state, columns = field_columns(self.terms, state, time, current)
        return state, columns @ self.coefficients


def precycled(terms: FieldTerms) -> MagnetState:
    """A magnet that was cycled to I_max and rests at zero: P_j = min(r_j, I_max - r_j), no eddy currents."""
    radii = np.array(terms.play_radii_A, dtype=np.float64)
    return MagnetState(np.clip(terms.current_max_A - radii, 0.0, radii), np.zeros(len(terms.lag_times_s)))


def field_columns(
    terms: FieldTerms, state: MagnetState, time: FloatArray, current: FloatArray
) -> tuple[MagnetState, FloatArray]:
    """The state after the last sample, and the columns (n, k) that a model's coefficients multiply."""
    x = current / terms.current_max_A
    plays = play_paths(np.array(terms.play_radii_A, dtype=np.float64), state.plays, current)
    lags = _lag_paths(terms, state, time, current)
    behind, square = plays - current[:, None], (x**2)[:, None]
    columns = np.concatenate(
        [
            np.polynomial.chebyshev.chebvander(2.0 * x - 1.0, terms.degree),
            behind * (1.0 - square) ** 2,
            behind * (2.0 * square * (1.0 - square)),
            behind * square**2,
            -lags,
        ],
        axis=1,
    )
    return MagnetState(plays[-1], lags[-1], float(time[-1]), float(current[-1])), columns


def play_paths(radii: FloatArray, start: FloatArray, current: FloatArray) -> FloatArray:
    """Play operators P_j in A after each sample of a current, shape (n, j), from P_j before the first."""
    paths = np.empty((len(current), len(radii)))
    state = start
    for row, value in enumerate(current):
        paths[row] = state = np.minimum(np.maximum(state, value - radii), value + radii)
    return paths


def _lag_paths(terms: FieldTerms, state: MagnetState, time: FloatArray, current: FloatArray) -> FloatArray:
    """e_l after each sample for a current that is linear between samples, shape (n, l)."""
    times = np.array(terms.lag_times_s, dtype=np.float64)
    begin = np.isnan(state.time)
    dt = np.diff(time, prepend=time[0] if begin else state.time)
    di = np.diff(current, prepend=current[0] if begin else state.current)
    keep = np.exp(-dt[:, None] / times)
    rate = np.divide(di, dt, out=np.zeros_like(dt), where=dt > 0.0)
    paths, lag = (1.0 - keep) * times * rate[:, None], state.lags
    for row, share in enumerate(keep):
        paths[row] = lag = share * lag + paths[row]
    return paths


class LabRun(NamedTuple):
    """Time in s, current in A and field in T, shape (n,), of a magnet that was cycled to its largest current before."""

    time: FloatArray
    current: FloatArray
    field: FloatArray


def field_of_ratio(ratio: float, rms_T: float) -> FieldModel:
    """B = I / g with the ratio g in A/T, without hysteresis and eddy currents."""
    return FieldModel(FieldTerms(1.0, degree=1), np.array([0.5, 0.5]) / ratio, rms_T)


def identify_field(runs: Sequence[LabRun], terms: FieldTerms | None = None) -> FieldModel:
    """Fit the field to the current over lab runs; without ``terms`` by those for the runs' largest current."""
    sizes = [max(1, round(PATH_INTERVAL / float(np.median(np.diff(run.time))))) for run in runs]
    paths = [LabRun(*(stepped_means(column, size) for column in run)) for run, size in zip(runs, sizes, strict=True)]
    top = max(float(run.current.max()) for run in paths)
    if terms is None:
        if top <= 0.0:
            raise FitError(f"A lab run must reach a current > 0 A; instead the largest is {top:g} A.")
        terms = FieldTerms(top, 7, tuple(top * fraction for fraction in _RADII), _LAG_TIMES_S)
    low = min(float(run.current.min()) for run in paths)
    if low < -LEAST_SHARE * top:
        raise FitError(
            f"A lab run must stay between 0 A and its largest current, {top:g} A, to which the magnet was cycled; "
            f"instead it goes down to {low:g} A. Record and integrate one polarity at a time."
        )
    columns = [field_columns(terms, precycled(terms), run.time, run.current)[1] for run in paths]
    matrix, field, current = (
        np.concatenate([stepped_means(column, ROW_STEPS) for column in of_runs])
        for of_runs in (columns, [run.field for run in paths], [run.current for run in paths])
    )
    used = np.flatnonzero(np.any(matrix != 0.0, axis=0))
    lower = np.where(used <= terms.degree, -np.inf, 0.0)
    prior = np.eye(len(used))[np.isfinite(lower)]  # A row for each strength, of which little is believed without runs
    largest = float(np.abs(field).max())
    sigma = np.repeat([ROW_SIGMA * largest, STRENGTH_SIGMA * largest / top], [len(field), len(prior)])
    rows, target = np.concatenate([matrix[:, used], prior]), np.concatenate([field, np.zeros(len(prior))])
    names = [f"coefficient {k}" for k in used]
    coefficients = np.zeros(matrix.shape[1])
    coefficients[used] = BoundedQP(rows, target, sigma, lower, names=names).solve().x
    rms = _left_out_rms(rows, target, sigma, lower, current)
    if not rms < field.std():
        raise FitError(
            f"The lab run does not show which field belongs to a current: fitted to the rest of it, its left-out "
            f"stretches are wrong by {rms:.3g} T (rms), more than the {field.std():.3g} T by which the field varies. "
            "Record several cycles between 0 A and the largest current."
        )
    return FieldModel(terms, coefficients, rms)


def stepped_means(values: FloatArray, size: int) -> FloatArray:
    """Means of so many consecutive rows; the incomplete last ones are dropped."""
    rows = len(values) // size
    return np.asarray(values[: rows * size].reshape(rows, size, *values.shape[1:]).mean(axis=1))


def _left_out_rms(
    rows: FloatArray, target: FloatArray, sigma: FloatArray, lower: FloatArray, current: FloatArray
) -> float:
    """Rms error on each stretch of the runs when fitted to the others, at currents that the others reach."""
    squares = []
    for stretch in np.array_split(np.arange(len(current)), FOLDS):
        elsewhere, remaining = np.delete(current, stretch), np.delete(np.arange(len(rows)), stretch)
        reached = stretch[(current[stretch] <= elsewhere.max()) & (current[stretch] >= elsewhere.min())]
        x = BoundedQP(rows[remaining], target[remaining], sigma[remaining], lower).solve_unproven()
        squares.append(np.square(rows[reached] @ x - target[reached]))
    return float(np.sqrt(np.mean(np.concatenate(squares))))
