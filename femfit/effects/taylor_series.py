"""Truncated Taylor series of the co-energy W'(d, i, h) at many points, on which an effect acts.

The third variable h is a vanishing test current in a coil at the Hall element, kept to first order:
W'(d, i, h) = W'(d, i) + h B(d, i), because the flux linkage of a test coil of unit area-turns is the field there. An
effect that is written once for W' therefore changes force (-dW'/dd), flux linkage (dW'/di), motional constant,
inductance and Hall field (dW'/dh) together, and none of them can contradict reciprocity.

References
----------
A. Griewank and A. Walther, Evaluating Derivatives (SIAM, 2008), chapter 13.
H. H. Woodson and J. R. Melcher, Electromechanical Dynamics, part I (Wiley, 1968), section 3.1.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import factorial

import numpy as np

from femfit.core.numerics import FloatArray


@dataclass(frozen=True, eq=False)
class TaylorSeries:
    """Taylor coefficients about n points."""

    coefficients: FloatArray  # Factor of h^c (delta d)^a (delta i)^b at ``[c, a, b]``; shape (2, A + 1, B + 1, n)

    __array_ufunc__ = None  # an array times a coenergy is the coenergy's business

    @property
    def orders(self) -> tuple[int, int]:
        """The highest powers (A in distance, B in current)."""
        return self.coefficients.shape[1] - 1, self.coefficients.shape[2] - 1

    @property
    def value(self) -> FloatArray:
        """The function itself at the points, shape (n,)."""
        return np.asarray(self.coefficients[0, 0, 0])

    def derivative(self, in_distance: int, in_current: int, in_hall: int = 0) -> FloatArray:
        """A partial derivative at the points, shape (n,)."""
        factor = factorial(in_distance) * factorial(in_current)
        return np.asarray(factor * self.coefficients[in_hall, in_distance, in_current])

    def along_distance(self) -> "TaylorSeries":
        """The series of the derivative in d: one order less."""
        powers = np.arange(1, self.coefficients.shape[1])[:, None, None]
        return TaylorSeries(self.coefficients[:, 1:] * powers)

    def along_current(self) -> "TaylorSeries":
        """The series of the derivative in i: one order less."""
        powers = np.arange(1, self.coefficients.shape[2])[:, None]
        return TaylorSeries(self.coefficients[:, :, 1:] * powers)

    def truncated(self, in_distance: int, in_current: int) -> "TaylorSeries":
        """The same series up to smaller orders."""
        return TaylorSeries(self.coefficients[:, : in_distance + 1, : in_current + 1])

    def scaled(
        self, distance: FloatArray | float = 1.0, current: FloatArray | float = 1.0, hall: FloatArray | float = 1.0
    ) -> "TaylorSeries":
        """The series of f(d_0 + distance delta d, i_0 + current delta i, hall h): the chain rule of a linear change."""
        n_d, n_i = self.orders
        a = np.arange(n_d + 1)[:, None, None]
        b = np.arange(n_i + 1)[:, None]
        result = self.coefficients * np.asarray(distance) ** a * np.asarray(current) ** b
        result[1] *= hall
        return TaylorSeries(result)

    def compose(self, derivatives: Sequence[FloatArray]) -> "TaylorSeries":
        """The series of g(f) from the derivatives of g at the points' values of f.

        They are g, g', g'', ... at ``value``, each of shape (n,); those of an order above A + B + 1 are not needed,
        missing ones count as zero.
        """
        n_d, n_i = self.orders
        rest = self.coefficients.copy()
        rest[0, 0, 0] = 0.0
        small, power = TaylorSeries(rest), None
        total = np.zeros_like(rest)
        total[0, 0, 0] = derivatives[0]
        for k, derivative in enumerate(derivatives[1 : n_d + n_i + 2], start=1):
            power = small if power is None else power * small
            total += power.coefficients * (np.asarray(derivative) / factorial(k))
        return TaylorSeries(total)

    def __add__(self, other: "TaylorSeries") -> "TaylorSeries":
        n_d, n_i = (min(pair) for pair in zip(self.orders, other.orders, strict=True))
        return TaylorSeries(self.truncated(n_d, n_i).coefficients + other.truncated(n_d, n_i).coefficients)

    def __sub__(self, other: "TaylorSeries") -> "TaylorSeries":
        return self + -1.0 * other

    def __rmul__(self, factor: FloatArray | float) -> "TaylorSeries":
        return TaylorSeries(np.asarray(factor) * self.coefficients)

    def __mul__(self, other: "TaylorSeries") -> "TaylorSeries":
        n_d, n_i = (min(pair) for pair in zip(self.orders, other.orders, strict=True))
        x, y = self.coefficients, other.coefficients
        result = np.zeros((2, n_d + 1, n_i + 1, *np.broadcast_shapes(x.shape[3:], y.shape[3:])))
        hall = x[1].any() or y[1].any()  # two thirds of the work, and a model without effects on the element has none
        for a in range(n_d + 1):
            for b in range(n_i + 1):
                rest = (slice(None, n_d + 1 - a), slice(None, n_i + 1 - b))
                result[0, a:, b:] += x[0, a, b] * y[0][rest]
                if hall:
                    result[1, a:, b:] += x[0, a, b] * y[1][rest] + x[1, a, b] * y[0][rest]
        return TaylorSeries(result)


CoenergySeries = Callable[[FloatArray, FloatArray, int, int], TaylorSeries]
"""W' as a series: (distances, currents, A, B) -> :class:`TaylorSeries`; points of shape (n,)."""


def distance_series(distance: FloatArray, in_distance: int, in_current: int) -> TaylorSeries:
    """The series of the function d itself."""
    return _variable(distance, in_distance, in_current, (1, 0))


def current_series(current: FloatArray, in_distance: int, in_current: int) -> TaylorSeries:
    """The series of the function i itself."""
    return _variable(current, in_distance, in_current, (0, 1))


def _variable(points: FloatArray, in_distance: int, in_current: int, along: tuple[int, int]) -> TaylorSeries:
    result = np.zeros((2, in_distance + 1, in_current + 1, len(points)))
    result[0, 0, 0] = points
    if in_distance >= along[0] and in_current >= along[1]:
        result[0, *along] = 1.0
    return TaylorSeries(result)
