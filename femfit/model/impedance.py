"""Impedance of a body held at rest, for a small sinusoidal current about a bias: Z = R + j w L_s + induced(h(w) L).

L is d(flux linkage)/di of the model's co-energy. h(w) is what lagging states leave of it. Without eddy currents the
induced part is j w h L.

What a number of the drawing changes of an impedance beside W'(d, i): of its eddy currents, at frequencies.

Per unit of the number it is j w S(u(d), i, ln f), with a complex spline S in H over the unit. Outside of the grid that
S was computed on, the values at its border hold. Z / w of one conducting part is a function of ln(f sigma), so that it
goes with ln(1 + a) where a is a share of the number. Of one part beside others that is right to first order alone: a
spline of its own times ln(1 + a)^2 / 2 adds the second.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np
from casadi import SX

from femfit.core.errors import DomainError
from femfit.core.graph import Expression
from femfit.core.numerics import ComplexArray, FloatArray
from femfit.effects.conditions import Conditions
from femfit.effects.effect import AddedEffect, Parameters
from femfit.model.bspline import CellTable, basis_matrix, cells_of
from femfit.model.coordinate import DistanceCoordinate
from femfit.model.decay import Complex, ComplexExpressions, solved
from femfit.model.eddy_currents import Patterns
from femfit.model.hall import HallField

if TYPE_CHECKING:
    from femfit.model.actuator_model import ActuatorModel


SHORTED = "_shorted_H"
"""Ends the column of the inductance of a circuit beside another that is shorted."""


def following_share(effects: Iterable[AddedEffect], s: Any) -> Any:
    """Take h at s = j w in 1/s: how much of the flux linkage follows a small current, and how late.

    Of an array, or of an expression as a :class:`~femfit.model.decay.Complex`.
    """
    share = 0.0 * s + 1.0
    for added in effects:
        memory = added.effect.memory
        if memory is not None and memory.response is not None:
            share = share - memory.response(s, added.parameters)
    return share


def induced_impedance(inductance: Any, s: Any, share: Any, patterns: Patterns | None) -> Any:
    """Voltages in V that flux induces in n circuits, for each ampere: Z without resistances and what is in series.

    With eddy currents E for each ampere that is s L (1 + C E). Of arrays, or of expressions.

    Parameters
    ----------
    inductance : array, shape (..., n, n)
        In H, without what lags.
    s, share : array
        j w, and how much of the flux linkage follows, as of :func:`following_share`.
    """
    s, share = (np.asarray(x)[..., None, None] for x in (s, share))
    following = share * inductance
    if patterns is None:
        return s * following
    return s * (following + following @ patterns.coupling @ _carried(following, s, patterns))


def with_further_impedance(
    z: Any,
    effects: Iterable[AddedEffect],
    distance: Any,
    current: Any,
    frequency: Any,
    conditions: Conditions,
) -> Any:
    """Z of n circuits, (..., n, n), with what effects show at its points beside W' and the resistances.

    Parameters
    ----------
    current : array
        Of the first circuit.
    """
    for one in effects:
        if one.effect.impedance is not None:
            z = z + one.effect.impedance(distance, current, frequency, conditions, one.parameters).reshape(z.shape)
    return z


def impedances_by_column(z: Any, circuits: Sequence[str]) -> dict[str, Any]:
    """What is read of impedances (..., n, n) in ohm, by the column of the inductance.

    Each circuit with all others open, Z_jj; of two the voltage of the first over the current of the second, Z_jk; and
    the first with the second shorted, where 0 = Z_kj i_j + Z_kk i_k: Z_jj - Z_jk Z_kj / Z_kk.

    Examples
    --------
    >>> z = np.array([[5.0, 2.0], [2.0, 4.0]])
    >>> [(name, float(one)) for name, one in impedances_by_column(z, ["a", "b"]).items()][1:3]
    [('inductance_a_b_H', 2.0), ('inductance_a_b_shorted_H', 4.0)]
    """
    if z.shape[-1] == 1:
        return {"inductance_H": z[..., 0, 0]}
    found = {}
    for (j, one), (k, other) in product(enumerate(circuits), repeat=2):
        found[f"inductance_{one}{f'_{other}' * (j != k)}_H"] = z[..., j, k]
        if j != k:
            left = z[..., j, j] - z[..., j, k] * z[..., k, j] / z[..., k, k]
            found[f"inductance_{one}_{other}{SHORTED}"] = left
    return found


def _carried(following: Any, s: Any, patterns: Patterns) -> Any:
    """Currents E of the patterns for an ampere of each circuit, (..., r, n), beside h L, (..., n, n).

    (R_e + s (C^T h L C + Q)) E = -s C^T h L.
    """
    linked = s * (np.swapaxes(patterns.coupling, -1, -2) @ following)
    own = linked @ patterns.coupling + (s * patterns.inductance + np.diag(patterns.resistances_ohm))
    return -(solved(own, linked) if own.dtype == object else np.linalg.solve(own, linked))


@dataclass(frozen=True, eq=False)
class SmallSignal:
    """Small sinusoidal currents of a model's n circuits about a bias, the body held."""

    model: "ActuatorModel"
    distance: FloatArray
    currents: FloatArray  # The bias, (..., n)
    inductance: FloatArray  # L there, (..., n, n)
    frequency: FloatArray  # In Hz
    share: ComplexArray  # h(w)

    def impedance(self) -> ComplexArray:
        """Z in ohm, (..., n, n)."""
        model, s = self.model, 2j * np.pi * self.frequency
        induced = induced_impedance(self.inductance, s, self.share, self._patterns)
        z = np.diag(model.resistances_ohm) + s[..., None, None] * model.series_inductances_H + induced
        if model.conditions is not None:
            first = self.currents[..., 0]
            d, i, f = (np.broadcast_to(one, z.shape[:-2]).ravel() for one in (self.distance, first, self.frequency))
            z = with_further_impedance(z, model.effects, d, i, f, model.conditions)
        return np.asarray(z)

    def force(self) -> ComplexArray:
        """Force in N/A, (..., n)."""
        magnetics, eddy = self.model.magnetics, self.model.eddy
        along = magnetics.motional_constant(self.distance, self.currents)
        if eddy is None:
            return self._transfer(along)
        (rising,), flux = eddy.forms(self.distance, 1), magnetics.flux_linkage(self.distance, self.currents)
        pulled = flux[..., None, :] @ rising.coupling
        return self._transfer(along, -pulled[..., 0, :] - rising.flux_linkage)

    def field(self, static: HallField) -> ComplexArray:
        """Field in T/A at a Hall element whose static one is given, (..., n)."""
        _, _, along = static.derivatives(self.distance, self.currents)
        eddy = self.model.eddy
        return self._transfer(along) if eddy is None else self._transfer(along, eddy.forms(self.distance)[0].hall)

    @cached_property
    def _patterns(self) -> Patterns | None:
        eddy = self.model.eddy
        return None if eddy is None else eddy.patterns(np.broadcast_to(self.distance, self.inductance.shape[:-2]))

    def _transfer(self, along: FloatArray, by_pattern: FloatArray | None = None) -> ComplexArray:
        """What follows the static field, by circuit, and the patterns' own part beside that, (..., r)."""
        rows = self.share[..., None, None] * along[..., None, :]
        patterns, points = self._patterns, self.frequency.shape
        if patterns is not None and by_pattern is not None:
            s, following = (2j * np.pi * self.frequency)[..., None, None], self.share[..., None, None] * self.inductance
            carried = _carried(following, s, patterns)
            rows = rows + (rows @ patterns.coupling + by_pattern[..., None, :]) @ carried
        rows = np.broadcast_to(rows, (*np.broadcast_shapes(rows.shape[:-2], points), *rows.shape[-2:]))[..., 0, :]
        return np.asarray(rows)


def checked_frequency(frequency: FloatArray, points: tuple[int, ...]) -> FloatArray:
    """Refuse frequencies that are negative or no numbers, or that do not broadcast with points of a shape."""
    if not (np.isfinite(frequency) & (frequency >= 0.0)).all():
        raise DomainError("Frequencies must be numbers >= 0, in Hz. Leave out what is no frequency.")
    try:
        np.broadcast_shapes(frequency.shape, points)
    except ValueError as error:
        raise DomainError(
            f"Frequencies must broadcast with distance and current; instead received the shapes {frequency.shape} and "
            f"{points}. For a grid, give distance[:, None] and frequency."
        ) from error
    return frequency


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
        distance: Any,
        current: Any,
        frequency: Any,
        conditions: Conditions,  # noqa: ARG002  a stage's signature
        p: Parameters,
    ) -> Any:
        """Further ohm at points (n,), of several circuits (n, circuits, circuits); none at the frequency 0.

        Of expressions an array of complex ones.
        """
        low = np.exp(self.knots[2][0])
        at = self.coordinate.of(distance), current, np.log(np.maximum(frequency, low))
        inside = [np.clip(x, knots[0], knots[-1]) for x, knots in zip(at, self.knots, strict=True)]
        size = p[self.parameter]
        size = np.log1p(size) if self.share else size
        if isinstance(frequency, SX):
            return self._spline(inside, size) * Complex(SX(0.0), 2.0 * np.pi * frequency)
        bases = [
            basis_matrix(x, knots, degree) for x, knots, degree in zip(inside, self.knots, self.degrees, strict=True)
        ]
        along = size * self.coefficients + (0.0 if self.bend is None else 0.5 * size**2 * self.bend)
        spline = np.einsum("na,nb,nc,abc...->n...", *bases, along)
        return np.asarray(2j * np.pi * (frequency * spline.T).T)

    def _spline(self, at: Sequence[Any], size: Expression) -> ComplexExpressions:
        """S of expressions within the grid, for each entry of the impedance."""
        bend = np.zeros_like(self.coefficients) if self.bend is None else self.bend
        parts = [x.reshape(*self.coefficients.shape[:3], -1) for x in (self.coefficients, bend)]
        axes = [cells_of(knots, degree) for knots, degree in zip(self.knots, self.degrees, strict=True)]
        entries = CellTable(axes, np.concatenate([y for x in parts for y in (x.real, x.imag)], axis=-1)).at(*at)
        real, imag, real_bend, imag_bend = np.split(np.arange(len(entries)), 4)
        return np.array(
            [
                Complex(size * entries[a] + 0.5 * size**2 * entries[c], size * entries[b] + 0.5 * size**2 * entries[e])
                for a, b, c, e in zip(real, imag, real_bend, imag_bend, strict=True)
            ],
            dtype=object,
        )


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
