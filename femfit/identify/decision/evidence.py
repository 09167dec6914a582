"""Evidence of explanations in closed form: linear models about a fit, with normal amplitudes of unknown size.

Whitened readings y in R^M are y ~ N(0, s^2 C), C = I + A diag(size^2) A', with a column of A for each amplitude and
each direction of a form's error. Where the noise's variance s^2 is known from nu repeats, log p(y) is
-(nu + M)/2 log(1 + y' C^-1 y / nu) - log det C / 2, which for a declared noise is the normal density.

References
----------
D. J. C. MacKay, Neural Computation 4 (1992) 415: evidence, Occam factors, and sizes that the data choose.
H. Jeffreys, Theory of Probability (Oxford, 1961), section 3.4: unknown variance; 3.1: sizes of unknown order.
M. C. Kennedy and A. O'Hagan, Journal of the Royal Statistical Society B 63 (2001) 425: model discrepancy.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy import linalg

from femfit.core.numerics import FloatArray, IntArray, root_beside_one
from femfit.identify.constants import FORM_SPREAD, ROUNDING, UNKNOWN_SIZES
from femfit.identify.decision.campaign import Block, Campaign

SIZES = 9
"""Numerical: how many sizes of an effect are tried, in equal steps of their logarithm, from where it would just be seen
(a length of one standard deviation) to half of its plausible range."""


@dataclass(frozen=True)
class LogDensity:
    """(y' C^-1 y, log det C) -> log p(y), up to what all explanations share."""

    readings: int
    degrees_of_freedom: float  # Of the noise; infinite where it is declared, and the density normal

    def __call__(self, square: FloatArray | float, log_det: FloatArray | float) -> FloatArray:
        """Take squares and determinants of one shape; a square that rounding made negative is none."""
        square = np.maximum(square, 0.0)
        if not np.isfinite(self.degrees_of_freedom):
            return np.asarray(-0.5 * (square + log_det))
        half = 0.5 * (self.degrees_of_freedom + self.readings)
        return np.asarray(-half * np.log1p(square / self.degrees_of_freedom) - 0.5 * log_det)


@dataclass(frozen=True, eq=False)
class Linear:
    """Readings about a fit: what they are beyond the model, as a linear combination of columns."""

    target: FloatArray  # y: whitened, counted from the model without effects; shape (M,)
    columns: FloatArray  # A: times their sizes; shape (M, k)
    density: LogDensity
    triangle: FloatArray  # L of L L' = I + A'A, shape (k, k)
    along: FloatArray  # L^-1 A'y, shape (k,)
    square: float  # y' C^-1 y
    log_det: float  # Of C
    log_evidence: float

    @classmethod
    def of(
        cls, target: FloatArray, columns: FloatArray, density: LogDensity, log_evidence: float | None = None
    ) -> Self:
        """The linear model solved; its log evidence may be given as averaged over other sizes of the columns."""
        triangle = root_beside_one(columns.T @ columns)
        along = np.asarray(linalg.solve_triangular(triangle, columns.T @ target, lower=True))
        square, log_det = float(target @ target - along @ along), 2.0 * float(np.log(np.diag(triangle)).sum())
        if log_evidence is None:
            log_evidence = float(density(square, log_det))
        return cls(target, columns, density, triangle, along, square, log_det, log_evidence)

    @property
    def amplitudes(self) -> FloatArray:
        """Their mean, in their sizes; shape (k,)."""
        return np.asarray(linalg.solve_triangular(self.triangle, self.along, trans=1, lower=True))

    def beside(self, columns: FloatArray) -> FloatArray:
        """L^-1 A'X for further columns X, shape (M, n): what of them the linear model may explain; shape (k, n)."""
        return np.asarray(linalg.solve_triangular(self.triangle, self.columns.T @ columns, lower=True))

    def products(self, block: Block) -> tuple[FloatArray, FloatArray]:
        """X' C^-1 X, shape (n, n), and X' C^-1 y, shape (n,), of further columns."""
        beside = self.beside(block.columns)
        return block.gram - beside.T @ beside, block.columns.T @ self.target - beside.T @ self.along

    def with_more(self, gram: FloatArray, along: FloatArray, sizes: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Log evidence with further columns X as well, and their mean amplitudes, at each of their common sizes.

        Takes X' C^-1 X, shape (n, n), and X' C^-1 y, shape (n,); returns shapes (sizes,) and (sizes, n).
        """
        values, vectors = np.linalg.eigh(gram)
        squares = sizes[:, None] ** 2
        grown = squares * np.maximum(values, 0.0)
        along = vectors.T @ along
        mean = squares * along / (1.0 + grown)
        more = self.density(self.square - mean @ along, self.log_det + np.sum(np.log1p(grown), axis=1))
        return more + self.log_evidence - self.density(self.square, self.log_det), mean @ vectors.T


def null(campaign: Campaign) -> Linear:
    """The readings without any effect."""
    target, degrees = campaign.whitening.residual, campaign.noise.pooled_degrees(campaign.observations.channel)
    return Linear.of(target, np.zeros((len(target), 0)), LogDensity(len(target), degrees))


def mean_of_logs(values: Sequence[float] | FloatArray) -> float:
    """The logarithm of the mean of what the values are logarithms of."""
    return float(np.logaddexp.reduce(np.asarray(values)) - np.log(len(values)))


def sizes_of(length: float) -> FloatArray:
    """Sizes from where columns of a length would just be seen to where they are as long."""
    return np.asarray(min(1.0 / max(length, 1e-300), 1.0) ** np.linspace(1.0, 0.0, SIZES))


def with_unknown_cause(campaign: Campaign, linear: Linear) -> float:
    """Log evidence with an unknown cause besides."""
    gram, along = linear.products(campaign.unknown)
    odds = odds_of_unknown(campaign, linear.density, gram, along[:, None], np.array([linear.square]))
    return linear.log_evidence + float(odds[0])


def odds_of_unknown(
    campaign: Campaign, density: LogDensity, gram: FloatArray, along: FloatArray, square: FloatArray
) -> FloatArray:
    """Log odds of an unknown cause, averaged over what smooth patterns X it may have and their sizes.

    Takes X' C^-1 X, shape (n, n), and of each of t vectors of readings X' C^-1 y, (n, t), and y' C^-1 y, (t,).
    """
    logs = []
    for group, weight in campaign.unknown_groups:
        values, vectors = np.linalg.eigh(weight[:, None] * gram[np.ix_(group, group)] * weight)
        parts = (vectors.T @ (weight[:, None] * along[group])) ** 2
        for size in UNKNOWN_SIZES:
            grown = size**2 * np.maximum(values, 0.0)
            fall = np.sum((size**2 / (1.0 + grown))[:, None] * parts, axis=0)
            logs.append(density(square - fall, float(np.sum(np.log1p(grown)))))
    return np.asarray(np.logaddexp.reduce(np.array(logs), axis=0) - np.log(len(logs)) - density(square, 0.0))


def of_sizes(
    target: FloatArray, columns: FloatArray, families: Sequence[IntArray], form: IntArray, density: LogDensity
) -> Linear:
    """A linear model of which each family of columns has one size of its own, averaged over their sizes.

    Each size is averaged with the others where they fit best (Laplace's method by coordinates).

    Parameters
    ----------
    columns : array, shape (M, k)
        Amplitudes at half of their plausible ranges, and errors of the form.
    families : sequence of int arrays
        Numbers of the columns that share a size; others have their own length.
    form : int array
        Numbers of the errors of the form, which share the factors of ``FORM_SPREAD``.
    """
    gram, product, square = columns.T @ columns, columns.T @ target, float(target @ target)
    sizes = [sizes_of(float(np.sqrt(np.linalg.eigvalsh(gram[np.ix_(f, f)])[-1]))) for f in families]

    def tried(scale: FloatArray, family: IntArray, values: FloatArray) -> list[float]:
        """Log evidence at each size of a family, the others as they are."""
        logs = []
        for value in values:
            scale[family] = value
            triangle = root_beside_one(scale[:, None] * gram * scale)
            along = linalg.solve_triangular(triangle, scale * product, lower=True, check_finite=False)
            logs.append(float(density(square - float(along @ along), 2.0 * float(np.log(np.diag(triangle)).sum()))))
        return logs

    averaged, scales = [], []
    for spread in FORM_SPREAD:
        scale = np.ones(columns.shape[1])
        scale[form], scale[np.concatenate(families)] = spread, sizes[0][-2]
        best, gain = -np.inf, np.inf
        while gain > ROUNDING:
            before = best
            for family, values in zip(families, sizes, strict=True):
                logs = tried(scale, family, values)
                scale[family], best = values[int(np.argmax(logs))], max(logs)
            gain = best - before
        around = [mean_of_logs(tried(scale.copy(), *pair)) - best for pair in zip(families, sizes, strict=True)]
        averaged.append(best + sum(around))
        scales.append(scale)
    scale = scales[int(np.argmax(averaged))]
    return Linear.of(target, columns * scale, density, mean_of_logs(averaged))
