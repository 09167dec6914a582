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
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from femfit.core.errors import DomainError
from femfit.core.numerics import ComplexArray, FloatArray
from femfit.effects.conditions import Conditions
from femfit.effects.effect import AddedEffect, Parameters
from femfit.model.bspline import basis_matrix
from femfit.model.coordinate import DistanceCoordinate
from femfit.model.eddy_currents import EddyCurrents, EddyForms
from femfit.model.hall import HallField

if TYPE_CHECKING:
    from femfit.model.actuator_model import ActuatorModel


SHORTED = "_shorted_H"
"""Ends the column of the inductance of a circuit beside another that is shorted."""


def following_share(effects: Iterable[AddedEffect], frequency: FloatArray) -> ComplexArray:
    """h(w) at frequencies in Hz: how much of the flux linkage follows a small current, and how late."""
    share = np.ones(np.shape(frequency), dtype=np.complex128)
    for added in effects:
        if added.memory is not None and added.memory.response is not None:
            share = share - added.memory.response(frequency, added.parameters)
    return share


def induced_impedance(
    inductance: FloatArray,
    frequency: FloatArray,
    share: ComplexArray,
    eddy: EddyCurrents | None,
    distance: FloatArray,
) -> ComplexArray:
    """Voltages in V that flux induces in n circuits, for each ampere: Z without resistances and what is in series.

    With eddy currents E for each ampere that is s L (1 + C E) with s = j w.

    Parameters
    ----------
    inductance : array, shape (..., n, n)
        In H, without what lags.
    share : array
        How much of it follows, as of :func:`following_share`.
    """
    s = (2j * np.pi * frequency)[..., None, None]
    following = share[..., None, None] * inductance
    if eddy is None:
        return np.asarray(s * following)
    (at,) = eddy.forms(distance)
    return np.asarray(
        s * (following + following @ at.coupling @ _carried(following, frequency, eddy.resistances_ohm, at))
    )


def with_further_impedance(
    z: ComplexArray,
    effects: Iterable[AddedEffect],
    distance: FloatArray,
    current: FloatArray,
    frequency: FloatArray,
    conditions: Conditions,
) -> ComplexArray:
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


def impedances_by_column(z: ComplexArray, circuits: Sequence[str]) -> dict[str, ComplexArray]:
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


def _carried(following: ComplexArray, frequency: FloatArray, resistances: FloatArray, at: EddyForms) -> ComplexArray:
    """Currents E of the patterns for an ampere of each circuit, (..., r, n), beside h(w) L, (..., n, n).

    (R_e + s (C^T h L C + Q)) E = -s C^T h L.
    """
    s = (2j * np.pi * frequency)[..., None, None]
    linked = s * (np.swapaxes(at.coupling, -1, -2) @ following)
    own = np.diag(resistances) + linked @ at.coupling + s * at.inductance
    return np.asarray(-np.linalg.solve(own, linked), dtype=np.complex128)


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
        model, s = self.model, (2j * np.pi * self.frequency)[..., None, None]
        at = np.broadcast_to(self.distance, self.inductance.shape[:-2])
        induced = induced_impedance(self.inductance, self.frequency, self.share, model.eddy, at)
        z = np.diag(model.resistances_ohm) + s * model.series_inductances_H + induced
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

    def _transfer(self, along: FloatArray, by_pattern: FloatArray | None = None) -> ComplexArray:
        """What follows the static field, by circuit, and the patterns' own part beside that, (..., r)."""
        rows = self.share[..., None, None] * along[..., None, :]
        eddy, points = self.model.eddy, self.frequency.shape
        if eddy is not None and by_pattern is not None:
            (at,) = eddy.forms(np.broadcast_to(self.distance, self.inductance.shape[:-2]))
            following = self.share[..., None, None] * self.inductance
            carried = _carried(following, self.frequency, eddy.resistances_ohm, at)
            rows = rows + (rows @ at.coupling + by_pattern[..., None, :]) @ carried
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
