"""Impedance of a body held at rest, for a small sinusoidal current about a bias: Z = R + j w L_s + induced(h(w) L).

L is d(flux linkage)/di of the model's co-energy. h(w) is what lagging states leave of it. Without eddy currents the
induced part is j w h L.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np
from casadi import SX

from femfit.core.numerics import ComplexArray, FloatArray
from femfit.effects.effect import EffectPoint
from femfit.model.bspline import FLAT, DistanceCoordinate, basis_matrix, functions, spline_at
from femfit.model.decay import Complex, ComplexExpressions, complex_array, solved
from femfit.model.eddy_currents import EddyForms
from femfit.model.with_effects import patterns_with_sources

if TYPE_CHECKING:
    from femfit.model.readings import Point


SHORTED = "_shorted_H"
"""Ends the column of the inductance of a circuit beside another that is shorted."""


def induced_impedance(inductance: Any, s: Any, share: Any, patterns: EddyForms | None) -> Any:
    """Voltages in V that flux induces in n circuits, for each ampere: Z without resistances and what is in series.

    With eddy currents E for each ampere that is s L (1 + C E). Of arrays, or of expressions.

    Parameters
    ----------
    inductance : array, shape (..., n, n)
        In H, without what lags.
    s, share : array
        j w, and how much of the flux linkage follows a small current, and how late.
    """
    s, share = (np.asarray(x)[..., None, None] for x in (s, share))
    following = share * inductance
    if patterns is None:
        return s * following
    # Currents E of the patterns, beside h L: (R_e + s (C^T h L C + Q)) E = -s C^T h L
    linked = s * (np.swapaxes(patterns.coupling, -1, -2) @ following)
    windings = linked @ patterns.coupling + (s * patterns.inductance + np.diag(patterns.resistances_ohm))
    currents = -(solved(windings, linked) if windings.dtype == object else np.linalg.solve(windings, linked))
    return s * (following + following @ patterns.coupling @ currents)


def impedances_by_column(z: Any, circuits: Sequence[str]) -> dict[str, Any]:
    """What is read of impedances (..., n, n) in ohm, by the column of the inductance.

    Each circuit with all others open, Z_jj; of two the voltage of the first over the current of the second, Z_jk; and
    the first with the second shorted, where 0 = Z_kj i_j + Z_kk i_k: Z_jj - Z_jk Z_kj / Z_kk.

    Examples
    --------
    >>> z = np.array([[5.0, 2.0], [2.0, 4.0]])
    >>> [(name, float(value)) for name, value in impedances_by_column(z, ["a", "b"]).items()][1:3]
    [('inductance_a_b_H', 2.0), ('inductance_a_b_shorted_H', 4.0)]
    """
    if z.shape[-1] == 1:
        return {"inductance_H": z[..., 0, 0]}
    columns = {}
    for (j, first), (k, second) in product(enumerate(circuits), repeat=2):
        columns[f"inductance_{first}{f'_{second}' * (j != k)}_H"] = z[..., j, k]
        if j != k:
            shorted = z[..., j, j] - z[..., j, k] * z[..., k, j] / z[..., k, k]
            columns[f"inductance_{first}_{second}{SHORTED}"] = shorted
    return columns


def impedance_expression(
    point: "Point", inductance: SX, s: Complex, resistances_ohm: Sequence[Any]
) -> ComplexExpressions:
    """Z in ohm, (n, n), of L (n, n) about a bias, at an expression's point."""
    share = 0.0 * s + 1.0  # How much of the flux linkage follows, and how late
    for added in point.effects:
        if (memory := added.effect.memory) is not None and memory.response is not None:
            share = share - memory.response(s, added.parameters)
    patterns = patterns_with_sources(point.model, point.effects, point.distance)
    z = induced_impedance(complex_array(inductance), s, share, patterns)
    for added in point.effects:
        if added.effect.impedance is not None:
            first, frequency = point.currents[0] if point.currents.numel() else SX(0.0), s.imag / (2.0 * np.pi)
            effect_point = EffectPoint(point.distance, first, point.conditions, added.parameters)
            change = added.effect.impedance(frequency, effect_point)
            z = z + change.reshape(z.shape)
    series = [circuit.inductance_H for circuit in point.model.circuits] or [0.0] * len(z)
    beside = [s * henry + ohm for henry, ohm in zip(series, resistances_ohm, strict=True)]
    return np.asarray(z + np.diag(np.array(beside, dtype=object)))


CUBIC = 3

OF_CIRCUITS = 3, 5
"""Dimensions of what a model file has over distance, current and frequency: of one circuit in older files, or with the
circuits last."""


@dataclass(frozen=True, eq=False)
class Axis:
    """The splines of one variable."""

    knots: FloatArray = field(metadata={"degree": "degree"})  # Clamped
    degree: int = field(metadata={"within": (0, 9)})


@dataclass(frozen=True, eq=False)
class ImpedanceChange:
    """What a number of the drawing changes of an impedance beside W'(d, i): of its eddy currents, at frequencies.

    Per unit of the number it is j w S(u(d), i, ln f), with a complex spline S in H over the unit. Outside of the grid
    that S was computed on, the values at its border hold. Z / w of one conducting part is a function of ln(f sigma), so
    that it goes with ln(1 + a) where a is a share of the number. Of one part beside others that is right to first order
    alone: a spline of its own times ln(1 + a)^2 / 2 adds the second.
    """

    parameter: str
    share: bool  # Whether the parameter is a share of the number
    coordinate: DistanceCoordinate = field(metadata=FLAT)
    u: Axis
    current: Axis  # In A
    log_frequency: Axis  # ln(f / Hz)
    # Coefficients of S, in H over the parameter's unit; the circuits last, where there are several
    real_H: FloatArray = field(metadata={"dimensions": OF_CIRCUITS})
    imaginary_H: FloatArray = field(metadata={"dimensions": OF_CIRCUITS})
    # Real and imaginary part of the second order in ln(1 + a)
    bend_H: FloatArray | None = field(
        default=None, metadata={"dimensions": [1 + axes for axes in OF_CIRCUITS], "omit": True}
    )

    def faults(self) -> Iterator[tuple[str, str]]:
        """Arrays that are not of the axes' functions and of as many circuits."""
        shape = tuple(functions(axis.knots, axis.degree) for axis in self.axes)
        for key, values in (("real_H", self.real_H), ("imaginary_H", self.imaginary_H)):
            if values.shape[:3] != shape or values.shape != self.real_H.shape or len(set(values.shape[3:])) > 1:
                yield key, f"nested lists of {shape} numbers, as the knots ask for"
        if self.bend_H is not None and self.bend_H.shape != (2, *self.real_H.shape):
            yield "bend_H", "two nested lists, its real and its imaginary part, as those of real_H"

    @property
    def axes(self) -> tuple[Axis, Axis, Axis]:
        """Of u, of the current and of the frequency."""
        return self.u, self.current, self.log_frequency

    def __call__(self, frequency: SX, point: EffectPoint) -> ComplexExpressions:
        """Further ohm at an expression's point, an entry for each of the impedance's; none at the frequency 0."""
        low = np.exp(self.log_frequency.knots[0])
        place = self.coordinate.of(point.d), point.i, np.log(np.maximum(frequency, low))
        inside = [np.clip(x, axis.knots[0], axis.knots[-1]) for x, axis in zip(place, self.axes, strict=True)]
        size = np.log1p(point.p[self.parameter]) if self.share else point.p[self.parameter]
        bend = np.zeros((2, *self.real_H.shape)) if self.bend_H is None else self.bend_H
        parts = [x.reshape(*self.real_H.shape[:3], -1) for x in (self.real_H, self.imaginary_H, *bend)]
        axes = [(axis.knots, axis.degree) for axis in self.axes]
        entries = ca.vertcat(*spline_at(self, axes, np.concatenate(parts, axis=-1), *inside))
        real, imag, *bends = ca.vertsplit(entries, parts[0].shape[-1])
        real, imag = (
            size * straight + 0.5 * size**2 * bent for straight, bent in zip((real, imag), bends, strict=True)
        )
        return complex_array(real, imag)[:, 0] * Complex(SX(0.0), 2.0 * np.pi * frequency)


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
    axes: list[Axis] = []
    for place, levels in enumerate((u, current, np.log(frequency))):
        degree = min(CUBIC, len(levels) - 1)
        axis = Axis(interpolation_knots(levels, degree), degree)
        matrix = basis_matrix(levels, axis.knots, degree)
        values = np.moveaxis(np.tensordot(np.linalg.inv(matrix), values, axes=(1, place)), 0, place)
        axes.append(axis)
    first, *second = np.moveaxis(values, -1, 0)
    bend_H = np.stack([second[0].real, second[0].imag]) if second else None
    by_u, by_current, by_frequency = axes
    return ImpedanceChange(parameter, share, coordinate, by_u, by_current, by_frequency, first.real, first.imag, bend_H)


def interpolation_knots(levels: FloatArray, degree: int) -> FloatArray:
    """Clamped knots of as many functions as levels: inside, means of ``degree`` levels (de Boor's average)."""
    if degree == 0:
        return np.array([levels[0], levels[0] + 1.0])
    inner = [levels[k : k + degree].mean() for k in range(1, len(levels) - degree)]
    return np.concatenate([np.full(degree + 1, levels[0]), inner, np.full(degree + 1, levels[-1])])
