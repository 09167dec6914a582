"""A magnet's field from its current: polynomial, hysteresis by play operators, eddy lag. Linear in its coefficients.

B = sum_n p_n T_n(2 x - 1) + sum_j (u_j (1 - x^2)^2 + 2 m_j x^2 (1 - x^2) + s_j x^4) (P_j - I) - sum_l c_l e_l,

with x = I / I_max, Chebyshev polynomials T_n, and the play operators P_j = max(I - r_j, min(I + r_j, P_j)), which lag
behind the current by at most r_j and carry the hysteresis with its wiping-out; their strengths at zero, medium and full
current are apart because saturation narrows the loop; and the eddy lags e_l' = -e_l / tau_l + dI/dt.

I. Mayergoyz, Mathematical Models of Hysteresis and their Applications (Elsevier, 2003), 1.3 (wiping-out); A. Visintin,
Differential Models of Hysteresis (Springer, 1994), III.1 (play); G. Moritz, arXiv:1103.1800 (eddy currents).
"""

from dataclasses import dataclass

import numpy as np

from femfit.core.numerics import FloatArray


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
    rate = np.zeros_like(dt)
    np.divide(di, dt, out=rate, where=dt > 0.0)
    paths, lag = np.empty((len(time), len(times))), state.lags
    for row in range(len(time)):
        paths[row] = lag = keep[row] * lag + (1.0 - keep[row]) * times * rate[row]
    return paths
