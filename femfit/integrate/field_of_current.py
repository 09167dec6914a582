"""A magnet's field from its current: polynomial, hysteresis by play operators, eddy lag. Linear in its coefficients.

B = sum_n p_n T_n(2 x - 1) + sum_j (u_j (1 - x^2)^2 + 2 m_j x^2 (1 - x^2) + s_j x^4) (P_j - I) - sum_l c_l e_l,

with x = I / I_max, Chebyshev polynomials T_n, and the play operators P_j = max(I - r_j, min(I + r_j, P_j)), which lag
behind the current by at most r_j and carry the hysteresis with its wiping-out; their strengths at zero, medium and full
current are apart because saturation narrows the loop; and the eddy lags e_l' = -e_l / tau_l + dI/dt. This is the
nonlinear part f of (14) that the paper leaves open.

References
----------
P. Arpaia et al., Sensors 22 (2022) 182, (14) and section 5.
I. Mayergoyz, Mathematical Models of Hysteresis and their Applications (Elsevier, 2003), 1.3 (wiping-out).
A. Visintin, Differential Models of Hysteresis (Springer, 1994), III.1 (play) and III.2 (Prandtl-Ishlinskii).
G. Moritz, Eddy currents in accelerator magnets, arXiv:1103.1800.
"""

import json
import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.core.atomic import write_json
from femfit.core.errors import ModelFileError

_KIND = "field of current"
_PLACES = ("zero", "medium", "full")

MOST_TERMS = 50
"""Highest degree, and most radii or lag times, that a file may have."""


@dataclass(frozen=True)
class FieldTerms:
    """Which terms a field model has.

    Parameters
    ----------
    current_max_A : float
        I_max, which the magnet was cycled to before the record.
    """

    current_max_A: float
    degree: int = 7
    play_radii_A: tuple[float, ...] = ()
    lag_times_s: tuple[float, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Of the coefficients, in the order of the columns."""
        return (
            *(f"polynomial {n}" for n in range(self.degree + 1)),
            *(f"play {radius:g} A at {place} current" for place in _PLACES for radius in self.play_radii_A),
            *(f"eddy lag {time:g} s" for time in self.lag_times_s),
        )


@dataclass(frozen=True, eq=False)
class MagnetState:
    """What a magnet remembers.

    Parameters
    ----------
    plays : array, shape (j,)
        P_j in A.
    lags : array, shape (l,)
        e_l in A.
    time, current : float
        Of the last sample; NaN before the first.
    """

    plays: FloatArray
    lags: FloatArray
    time: float = float("nan")
    current: float = float("nan")


@dataclass(frozen=True, eq=False)
class FieldModel:
    """A field model with its coefficients.

    Parameters
    ----------
    coefficients : array, shape (k,)
        In the order of ``terms.names``.
    rms_T : float
        Of its error, on stretches that it was not fitted to.
    """

    terms: FieldTerms
    coefficients: FloatArray
    rms_T: float

    def start(self) -> MagnetState:
        """After cycling to the largest current and back to zero."""
        return precycled(self.terms)

    @property
    def current_to_field(self) -> float:
        """Largest current over the field that it adds, A/T; infinite where it adds none."""
        top = self.terms.current_max_A
        _, field = self.advance(self.start(), np.array([0.0, 1e9]), np.array([0.0, top]))
        rise = float(field[1] - field[0])
        return top / rise if rise != 0.0 else math.inf

    def advance(self, state: MagnetState, time: FloatArray, current: FloatArray) -> tuple[MagnetState, FloatArray]:
        """Field in T of a stretch of currents, shape (n,)."""
        state, columns = field_columns(self.terms, state, time, current)
        return state, columns @ self.coefficients


def precycled(terms: FieldTerms) -> MagnetState:
    """The state of a magnet that was cycled to its largest current and rests at zero.

    Returns
    -------
    MagnetState
        P_j = min(r_j, I_max - r_j), no eddy currents.
    """
    radii = np.array(terms.play_radii_A, dtype=np.float64)
    return MagnetState(np.clip(terms.current_max_A - radii, 0.0, radii), np.zeros(len(terms.lag_times_s)))


def field_columns(
    terms: FieldTerms, state: MagnetState, time: FloatArray, current: FloatArray
) -> tuple[MagnetState, FloatArray]:
    """The columns that a model's coefficients multiply.

    Parameters
    ----------
    time, current : array, shape (n,)
        In s and A.

    Returns
    -------
    state, columns : MagnetState, array of shape (n, k)
        After the last sample, and a column for each of ``terms.names``.
    """
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
    """Play operators along a path of currents.

    Parameters
    ----------
    radii : array, shape (j,)
        r_j in A.
    start : array, shape (j,)
        P_j before the first sample, A.
    current : array, shape (n,)
        In A.

    Returns
    -------
    array, shape (n, j)
        P_j after each sample, A.
    """
    paths = np.empty((len(current), len(radii)))
    state = start
    for row, value in enumerate(current):
        state = np.minimum(np.maximum(state, value - radii), value + radii)
        paths[row] = state
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
    paths = np.empty((len(time), len(times)))
    lag = state.lags
    for row in range(len(time)):
        lag = keep[row] * lag + (1.0 - keep[row]) * times * rate[row]
        paths[row] = lag
    return paths


def field_model_of_sweep(
    curve: Callable[[FloatArray], FloatArray], current_min: float, current_max: float, rms: float, degree: int = 7
) -> FieldModel:
    """A field model from a swept one, which has no hysteresis and no eddy currents.

    Parameters
    ----------
    curve : callable
        Field in T at the sensor (or flux linkage in Wb of the winding) of currents in A, the moving part held.
    rms : float
        What the model is believed to be off by, in the curve's unit: remanence and eddy currents of the real magnet
        included.
    """
    terms = FieldTerms(current_max, degree)
    nodes = np.polynomial.chebyshev.chebpts1(4 * (degree + 1))
    current = current_min + 0.5 * (current_max - current_min) * (nodes + 1.0)
    # On its own interval the fit is orthogonal; the terms' interval begins at 0.
    own = np.polynomial.Chebyshev.fit(current, curve(current), degree, domain=[current_min, current_max])
    moved = own.convert(domain=[0.0, current_max], kind=np.polynomial.Chebyshev)
    coefficients = np.zeros(degree + 1)
    coefficients[: len(moved.coef)] = moved.coef
    return FieldModel(terms, coefficients, rms)


def write_field_model(model: FieldModel, path: Path) -> None:
    """Write a field model as JSON."""
    data = {
        "kind": _KIND,
        "terms": asdict(model.terms),
        "coefficients_T": dict(zip(model.terms.names, model.coefficients.tolist(), strict=True)),
        "rms_T": model.rms_T,
    }
    write_json(path, data)


def read_field_model(path: Path) -> FieldModel:
    """Read a field model."""
    try:
        return _parsed(json.loads(path.read_text(encoding="utf-8"), parse_constant=_refused))
    except (OSError, KeyError, TypeError, ValueError, RecursionError) as error:
        reason = f"{error} is missing" if isinstance(error, KeyError) else str(error)
        raise ModelFileError(
            f"{path} cannot be read as a {_KIND}: {reason[:200]}. Identify it again from a lab record."
        ) from error


def _parsed(data: Any) -> FieldModel:
    if data["kind"] != _KIND:
        raise ValueError(f"its kind must be {_KIND!r}; instead received {str(data['kind'])[:80]!r}")
    given = data["terms"]
    degree = given["degree"]
    if type(degree) is not int or not 0 <= degree <= MOST_TERMS:
        raise ValueError(f"degree must be a whole number from 0 to {MOST_TERMS}")
    terms = FieldTerms(
        _number(given["current_max_A"], "current_max_A", above=0.0),
        degree,
        _positive(given["play_radii_A"], "play_radii_A"),
        _positive(given["lag_times_s"], "lag_times_s"),
    )
    coefficients = np.array([_number(data["coefficients_T"][name], name) for name in terms.names])
    rms = _number(data["rms_T"], "rms_T")
    if rms < 0.0:
        raise ValueError(f"rms_T must be >= 0; instead received {rms:g}")
    return FieldModel(terms, coefficients, rms)


def _refused(text: str) -> float:
    raise ValueError(f"numbers must be finite; instead received {text}")


def _number(value: Any, name: str, above: float = -math.inf) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not above < value < math.inf:
        least = "" if above == -math.inf else f" > {above:g}"
        raise ValueError(f"{name} must be a finite number{least}; instead received {str(value)[:40]}")
    return float(value)


def _positive(values: Any, name: str) -> tuple[float, ...]:
    if not isinstance(values, list) or len(values) > MOST_TERMS:
        raise ValueError(f"{name} must be a list of at most {MOST_TERMS} numbers")
    return tuple(_number(value, name, above=0.0) for value in values)
