"""Hysteresis of a core by the classical Preisach model: an ensemble of relays, each with its own two thresholds.

References
----------
I. D. Mayergoyz, Mathematical Models of Hysteresis (Springer, 1991), chapter 1.
"""

from dataclasses import dataclass

import numpy as np
from scipy.stats import norm

from femfit.core.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class Relays:
    """An ensemble of relays.

    Parameters
    ----------
    up, down : array, shape (N,)
        Inputs at which each switches to +1 and to -1.
    weight : array, shape (N,)
        Of sum 1.
    """

    up: FloatArray
    down: FloatArray
    weight: FloatArray

    def output(self, history: FloatArray) -> FloatArray:
        """Magnetisation along a history that starts demagnetised, -1..1.

        Parameters
        ----------
        history : array, shape (n,)
            Input, in the order of time; between two values it moves monotonically.
        """
        state = np.where(self.up + self.down < 0.0, 1.0, -1.0)
        result = np.empty(len(history))
        for k, value in enumerate(history):
            state = np.where(value >= self.up, 1.0, np.where(value <= self.down, -1.0, state))
            result[k] = self.weight @ state
        return result

    def anhysteretic(self, value: FloatArray) -> FloatArray:
        """Magnetisation after a slowly decaying alternation about a value: each relay's centre decides.

        Parameters
        ----------
        value : array, shape (n,)
            Input.

        Returns
        -------
        array, shape (n,)
            Between -1 and 1.
        """
        centre = 0.5 * (self.up + self.down)
        return np.sign(value[:, None] - centre) @ self.weight

    def irreversible(self, history: FloatArray) -> FloatArray:
        """What hysteresis adds to the anhysteretic magnetisation along a history.

        Parameters
        ----------
        history : array, shape (n,)
            As in :meth:`output`.

        Returns
        -------
        array, shape (n,)
            Positive where the core remembers larger inputs.
        """
        return self.output(history) - self.anhysteretic(np.asarray(history, dtype=np.float64))


def relay_ensemble(coercive: float, interaction: float, spread: float, parts: int = 24) -> Relays:
    """Relays with log-normal half widths about a coercive input and normal centres.

    Parameters
    ----------
    coercive : float
        Median half width, in the input's unit.
    """
    quantile = norm.ppf((np.arange(parts) + 0.5) / parts)
    centre, log_width = np.meshgrid(interaction * quantile, spread * quantile)
    half = coercive * np.exp(log_width)
    count = parts * parts
    return Relays((centre + half).ravel(), (centre - half).ravel(), np.full(count, 1.0 / count))


def lorentzian_ensemble(coercive: float, interaction: float, spread: float, parts: int = 24) -> Relays:
    """Relays whose half widths and centres have the heavy tails of Lorentz's law.

    Parameters
    ----------
    coercive : float
        Half width that is met most, in the input's unit.
    """
    quantile = np.tan(np.pi * ((np.arange(parts) + 0.5) / parts - 0.5))
    centre, width = np.meshgrid(0.5 * interaction * quantile, 0.3 * spread * quantile)
    half = coercive * np.maximum(1.0 + width, 0.05)
    count = parts * parts
    return Relays((centre + half).ravel(), (centre - half).ravel(), np.full(count, 1.0 / count))
