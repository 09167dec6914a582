"""What data leave open of several numbers: combinations that stay as their tolerances, and pairs that go together."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from femfit.core.amount import amount, rounded
from femfit.core.arrays import FloatArray
from femfit.identify.calibration.constants import ALIKE, IN_COMBINATION, OPEN
from femfit.identify.calibration.suspects import Suspect


@dataclass(frozen=True)
class Combination:
    """Changes of several numbers at once that the data hardly see."""

    change: dict[str, float]  # By key path, in the number's unit, the largest by one tolerance
    left: float  # Its standard deviation over that of the tolerances alone

    def in_words(self, units: dict[str, str]) -> str:
        """As a sentence."""
        left = amount(min(self.left, 1.0), "")
        parts = [f"{key} by {signed(size, units[key])}" for key, size in self.change.items()]
        if len(parts) == 1:
            return f"Not determined by these data: {next(iter(self.change))}. {left} of its tolerance is left."
        return (
            f"Not determined by these data: {', '.join(parts[:-1])} together with {parts[-1]}. {left} of what the "
            "tolerances leave open of this combination is left."
        )


def open_combinations(numbers: Sequence[Suspect], covariance: FloatArray) -> tuple[Combination, ...]:
    """The directions along which the posterior is nearly as wide as the prior, the widest first.

    The eigenvectors of the covariance in units of the tolerances.
    """
    tolerance = np.array([one.tolerance for one in numbers])
    squares, vectors = np.linalg.eigh(covariance / np.outer(tolerance, tolerance))
    found = []
    for square, vector in zip(squares[::-1], vectors.T[::-1], strict=True):
        if square <= OPEN**2:
            break
        share = vector / vector[np.argmax(np.abs(vector))]
        parts = {
            one.key: float(part * one.tolerance)
            for one, part in zip(numbers, share, strict=True)
            if abs(part) >= IN_COMBINATION
        }
        found.append(Combination(parts, float(np.sqrt(square))))
    return tuple(found)


def alike(keys: Sequence[str], correlation: FloatArray) -> tuple[str, ...]:
    """A sentence for each pair of numbers whose errors go together."""
    return tuple(
        f"The errors of {one} and {other} go together (correlation {correlation[j, k]:.2f}): within them, more of one "
        f"with {'more' if correlation[j, k] > 0.0 else 'less'} of the other explains these data as well."
        for (j, one), (k, other) in combinations(enumerate(keys), 2)
        if abs(correlation[j, k]) > ALIKE
    )


def signed(value: float, unit: str) -> str:
    """A change in the drawing's unit."""
    return f"{'+' if value >= 0.0 else '-'}{rounded(abs(value), 2)} {unit}".rstrip()
