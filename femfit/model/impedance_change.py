"""What a number of the drawing changes of an impedance beside W'(d, i): of its eddy currents, at frequencies.

Per unit of the number it is j w S(u(d), i, ln f), with a complex spline S in H over the unit. Outside of the grid that
S was computed on, the values at its border hold. Z / w of one conducting part is a function of ln(f sigma), so that it
goes with ln(1 + a) where a is a share of the number. Of one part beside others that is right to first order alone: a
spline of its own times ln(1 + a)^2 / 2 adds the second.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from femfit.core.arrays import ComplexArray, FloatArray
from femfit.effects.conditions import Conditions
from femfit.effects.effect import Parameters
from femfit.model.bspline import basis_matrix
from femfit.model.coordinate import DistanceCoordinate

CUBIC = 3


@dataclass(frozen=True, eq=False)
class ImpedanceChange:
    """The ``impedance`` stage of a drawn number, in proportion to a parameter."""

    parameter: str
    coordinate: DistanceCoordinate
    knots: tuple[FloatArray, FloatArray, FloatArray]  # Clamped, of u, i in A and ln(f / Hz)
    degrees: tuple[int, int, int]
    coefficients: ComplexArray  # Of S, in H over the parameter's unit; the circuits last, where there are several
    share: bool = False  # Whether the parameter is a share of the number
    bend: ComplexArray | None = None  # Of the second order in ln(1 + a), as the coefficients

    def __call__(
        self,
        distance: FloatArray,
        current: FloatArray,
        frequency: FloatArray,
        conditions: Conditions,  # noqa: ARG002  a stage's signature
        p: Parameters,
    ) -> ComplexArray:
        """Further ohm at points (n,), of several circuits (n, circuits, circuits); none at the frequency 0."""
        low = np.exp(self.knots[2][0])
        at = self.coordinate.of(distance), current, np.log(np.maximum(frequency, low))
        bases = [
            basis_matrix(np.clip(x, knots[0], knots[-1]), knots, degree)
            for x, knots, degree in zip(at, self.knots, self.degrees, strict=True)
        ]
        size = p[self.parameter]
        size = float(np.log1p(size)) if self.share else size
        along = size * self.coefficients + (0.0 if self.bend is None else 0.5 * size**2 * self.bend)
        spline = np.einsum("na,nb,nc,abc...->n...", *bases, along)
        return np.asarray(2j * np.pi * (frequency * spline.T).T)


def impedance_change(
    parameter: str,
    coordinate: DistanceCoordinate,
    distance: FloatArray,
    current: FloatArray,
    frequency: FloatArray,
    slope: ComplexArray,
    *,
    share: bool = False,
    bend: ComplexArray | None = None,
) -> ImpedanceChange:
    """The change through slopes d(Z)/d(number) on a grid.

    Parameters
    ----------
    distance, current, frequency : array
        Ascending levels in m, A and Hz; one level stands for all.
    slope : array, shape (distances, currents, frequencies) or (distances, currents, frequencies, n, n)
        Of one circuit or of n, in ohm over the parameter's unit, without what the number's W' makes of it.
    share : bool
        Whether the parameter is a share of the number.
    bend : array, or None
        Its second derivatives by ln(1 + a), of the slopes' shape.
    """
    u = coordinate.of(distance)
    values = np.stack([slope] if bend is None else [slope, bend], axis=-1)
    values = values / (2j * np.pi * frequency.reshape(-1, *[1] * (values.ndim - 3)))
    if len(u) > 1 and u[0] > u[-1]:
        u, values = u[::-1], values[::-1]
    axes: Sequence[FloatArray] = (u, current, np.log(frequency))
    knots, degrees = [], []
    for axis, levels in enumerate(axes):
        degree = min(CUBIC, len(levels) - 1)
        found = interpolation_knots(levels, degree)
        matrix = basis_matrix(levels, found, degree)
        values = np.moveaxis(np.tensordot(np.linalg.inv(matrix), values, axes=(1, axis)), 0, axis)
        knots.append(found)
        degrees.append(degree)
    first, *second = np.moveaxis(values, -1, 0)
    return ImpedanceChange(parameter, coordinate, tuple(knots), tuple(degrees), first, share, *second)  # type: ignore[arg-type]


def interpolation_knots(levels: FloatArray, degree: int) -> FloatArray:
    """Clamped knots of as many functions as levels: inside, means of ``degree`` levels (de Boor's average)."""
    if degree == 0:
        return np.array([levels[0], levels[0] + 1.0])
    inner = [levels[k : k + degree].mean() for k in range(1, len(levels) - degree)]
    return np.concatenate([np.full(degree + 1, levels[0]), inner, np.full(degree + 1, levels[-1])])
