"""The magnetic half of the model: force and flux linkage from one co-energy W'(d, i_1..i_n).

F = -dW'/dd (on the moving part, positive towards the electromagnet), flux linkage = dW'/di, motional constant
k_m = dF/di = -d(flux linkage)/dd, inductance L = d(flux linkage)/di. Deriving all of them from one function
makes reciprocity hold to rounding, whatever was fitted.

Stored is a spline in i and a coordinate of the distance (``bspline``, ``coordinate``), or a law; ``Magnetics`` gives
any derivative in d and i.
Effects change W' as a function, so they take and give Taylor series about each point (``effects.taylor_series``), which
``coenergy_table`` keeps on a grid, because filters ask for the same changed W' millions of times.

References
----------
H. H. Woodson and J. R. Melcher, Electromechanical Dynamics, part I (Wiley, 1968), section 3.1.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from femfit.core.errors import DomainError
from femfit.core.numerics import FloatArray
from femfit.laws.catalogue import law_by_name
from femfit.laws.law import ForceLaw
from femfit.model.bspline import TensorSpline
from femfit.model.coordinate import DistanceCoordinate


@dataclass(frozen=True, eq=False)
class MagneticState:
    """What the circuits and the motion need at one or many points, of n currents."""

    force: FloatArray  # F in N, shape (...)
    motional_constant: FloatArray  # k_m in V s/m = N/A, shape (..., n)
    inductance: FloatArray  # L in H, shape (..., n, n)


@dataclass(frozen=True, eq=False)
class MagneticSlopes(MagneticState):
    """What the Jacobian of the equations needs beside it.

    By reciprocity dk_m,j/di_k = -dL_jk/dd, so that the slopes of the motional constants along the currents are here.
    """

    force_gradient: FloatArray  # dF/dd in N/m, shape (...)
    motional_gradient: FloatArray  # dk_m/dd in N/(A m), shape (..., n)
    inductance_gradient: FloatArray  # dL/dd in H/m, shape (..., n, n)
    inductance_slope: FloatArray  # dL_jk/di_l in H/A, shape (..., n, n, n)


ForceOfCurrents = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
"""Force (...) in N and motional constants (..., n) in N/A of currents (..., n) in A."""


class Magnetics(ABC):
    """A co-energy W'(d, i_1..i_n); distances (...) in m and currents (..., n) in A broadcast, and n may be none."""

    @abstractmethod
    def coenergy(self, distance: FloatArray, currents: FloatArray) -> FloatArray:
        """W' in J, up to a constant, of shape (...)."""

    @abstractmethod
    def flux_linkage(self, distance: FloatArray, currents: FloatArray) -> FloatArray:
        """dW'/di_k in Wb, of shape (..., n)."""

    @abstractmethod
    def state(self, distance: FloatArray, currents: FloatArray) -> MagneticState:
        """Force, motional constants and inductances together, at the price of little more than one."""

    @abstractmethod
    def slopes(self, distance: FloatArray, currents: FloatArray) -> MagneticSlopes:
        """The same with their slopes along the distance and the currents."""

    def force(self, distance: FloatArray, currents: FloatArray) -> FloatArray:
        """F = -dW'/dd in N, positive towards the electromagnet, of shape (...)."""
        return self.state(distance, currents).force

    def motional_constant(self, distance: FloatArray, currents: FloatArray) -> FloatArray:
        """k_m = dF/di_k = -d(flux linkage_k)/dd in N/A, of shape (..., n)."""
        return self.state(distance, currents).motional_constant

    def inductance(self, distance: FloatArray, currents: FloatArray) -> FloatArray:
        """L = d(flux linkage_j)/di_k in H, of shape (..., n, n)."""
        return self.state(distance, currents).inductance

    def force_gradient(self, distance: FloatArray, currents: FloatArray) -> FloatArray:
        """dF/dd in N/m, of shape (...)."""
        return self.slopes(distance, currents).force_gradient

    def at_distances(self, distance: FloatArray) -> ForceOfCurrents:
        """Force and motional constants as functions of the circuits' currents, for a search where the body stays."""

        def force(currents: FloatArray) -> tuple[FloatArray, FloatArray]:
            state = self.state(distance, currents)
            return state.force, state.motional_constant

        return force


Orders = tuple[tuple[int, int], ...]
"""Orders of derivatives (in d, in i)."""


def only_current(currents: FloatArray) -> FloatArray:
    """The current (...) of an axis (..., n) of at most one; zero where there is none.

    Raises
    ------
    DomainError
        If there are more.
    """
    if currents.shape[-1:] == (1,):
        return currents[..., 0]
    if currents.shape[-1:] != (0,):
        raise DomainError(f"Currents must have the shape (..., 1); instead received the shape {currents.shape}.")
    return np.zeros(currents.shape[:-1])


class OneCurrentMagnetics(Magnetics):
    """A co-energy W'(d, i) of one current, or of none: written without the axis that its users give and get."""

    @abstractmethod
    def _derivatives(self, distance: FloatArray, current: FloatArray, orders: Orders) -> list[FloatArray]:
        """Partial derivatives of W' at flat arrays."""

    def coenergy_derivatives(self, distance: FloatArray, current: FloatArray, orders: Orders) -> list[FloatArray]:
        """Partial derivatives of the co-energy at distances and currents (...), in J / m^a / A^b."""
        if np.ndim(distance) == 1 and np.shape(distance) == np.shape(current):  # what plant and filters ask for
            return self._derivatives(np.asarray(distance, np.float64), np.asarray(current, np.float64), orders)
        distance, current = np.broadcast_arrays(
            np.asarray(distance, dtype=np.float64), np.asarray(current, dtype=np.float64)
        )
        values = self._derivatives(distance.ravel(), current.ravel(), orders)
        return [value.reshape(distance.shape) for value in values]

    def _state(self, distance: FloatArray, current: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Force, motional constant and inductance, each of shape (...)."""
        d_w, di_w, ii_w = self.coenergy_derivatives(distance, current, ((1, 0), (1, 1), (0, 2)))
        return -d_w, -di_w, ii_w

    def coenergy(self, distance: FloatArray, currents: FloatArray) -> FloatArray:
        """W' in J, up to a constant, of shape (...)."""
        return self.coenergy_derivatives(distance, only_current(currents), ((0, 0),))[0]

    def force(self, distance: FloatArray, currents: FloatArray) -> FloatArray:
        """F = -dW'/dd in N, of shape (...), without what else belongs to the state."""
        return -self.coenergy_derivatives(distance, only_current(currents), ((1, 0),))[0]

    def flux_linkage(self, distance: FloatArray, currents: FloatArray) -> FloatArray:
        """dW'/di in Wb, of shape (..., n)."""
        (value,) = self.coenergy_derivatives(distance, only_current(currents), ((0, 1),))
        return value[..., None][..., : currents.shape[-1]]

    def state(self, distance: FloatArray, currents: FloatArray) -> MagneticState:
        """Force, motional constants and inductances."""
        force, motional, inductance = self._state(distance, only_current(currents))
        if n := currents.shape[-1]:
            return MagneticState(force, motional[..., None], inductance[..., None, None])
        return MagneticState(force, np.zeros((*force.shape, n)), np.zeros((*force.shape, n, n)))

    def slopes(self, distance: FloatArray, currents: FloatArray) -> MagneticSlopes:
        """The same with their slopes."""
        orders = ((1, 0), (1, 1), (0, 2), (2, 0), (2, 1), (1, 2), (0, 3))
        values = self.coenergy_derivatives(distance, only_current(currents), orders)
        d_w, di_w, ii_w, dd_w, ddi_w, dii_w, iii_w = values
        each = slice(None, currents.shape[-1])
        return MagneticSlopes(
            force=-d_w,
            motional_constant=-di_w[..., None][..., each],
            inductance=ii_w[..., None, None][..., each, each],
            force_gradient=-dd_w,
            motional_gradient=-ddi_w[..., None][..., each],
            inductance_gradient=dii_w[..., None, None][..., each, each],
            inductance_slope=iii_w[..., None, None, None][..., each, each, each],
        )


@dataclass(frozen=True, eq=False)
class CoenergySpline(OneCurrentMagnetics):
    """W'(d, i) as a tensor B-spline in a coordinate u(d) and i."""

    coordinate: DistanceCoordinate
    spline: TensorSpline  # In (u, i), in J

    def _derivatives(self, distance: FloatArray, current: FloatArray, orders: Orders) -> list[FloatArray]:
        return self.coordinate.partial_derivatives(self.spline, distance, current, orders)

    def _state(self, distance: FloatArray, current: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """As the base class's; du/dd is worked out once, where points come as one array."""
        if np.ndim(distance) != 1 or np.shape(distance) != np.shape(current):
            return super()._state(distance, current)
        u, per_metre, _ = self.coordinate.with_slopes(distance)
        slope, mixed, inductance = self.spline.derivatives(u, current, ((1, 0), (1, 1), (0, 2)))
        return -per_metre * slope, -per_metre * mixed, inductance


@dataclass(frozen=True)
class Coefficient:
    """One term c i^n phi_k(d) of a force law, as fitted."""

    basis: str  # Name of the column phi_k
    current_power: int
    value: float
    unit: str
    ci95: tuple[float, float] | None = None  # 95 % interval, where it was estimated
    bounds: tuple[float, float] = (-np.inf, np.inf)  # What the fit allowed; infinite where it did not bound
    active: str = ""  # ``lower``, ``upper`` or empty: the bound that the fit hit


@dataclass(frozen=True, eq=False)
class LawMagnetics(OneCurrentMagnetics):
    """A force law with polynomial coefficient functions, and the flux linkage that reciprocity leaves open.

    W'(d, i) = sum_k,n c_kn i^n (Phi_k(d) - Phi_k(d_ref)) + flux_linkage_ref i + L_ref i^2 / 2. Force data say nothing
    about the last two terms, which do not depend on the distance. Counted from d_ref, the farthest distance of the
    sweep, they are the flux linkage without current and the inductance there, and no integral to infinity, where no
    row holds a law, enters the circuit.
    """

    law_name: str
    coefficients: tuple[Coefficient, ...]
    shape: Mapping[str, float] = field(default_factory=dict)
    constant_inductance_H: float = 0.0
    constant_flux_linkage_Wb: float = 0.0
    reference_distance_m: float | None = None  # d_ref; None for infinity, as in models of earlier versions

    @cached_property
    def law(self) -> ForceLaw:
        """The law's data and functions."""
        return law_by_name(self.law_name)

    @cached_property
    def _powers(self) -> FloatArray:
        """C of shape (columns, highest power of current + 1)."""
        table = np.zeros((len(self.law.basis), 1 + max(c.current_power for c in self.coefficients)))
        for c in self.coefficients:
            table[self.law.basis.index(c.basis), c.current_power] += c.value
        return table

    @cached_property
    def _potential_at_reference(self) -> FloatArray:
        if self.reference_distance_m is None:
            return np.zeros(len(self.law.basis))
        return np.asarray(self.law.potential_columns(np.array([self.reference_distance_m]), self.shape)[0])

    def _derivatives(self, distance: FloatArray, current: FloatArray, orders: Orders) -> list[FloatArray]:
        columns = {}
        for a in {order[0] for order in orders}:
            if a == 0:
                columns[a] = self.law.potential_columns(distance, self.shape) - self._potential_at_reference
            elif a == 1:
                columns[a] = -self.law.columns(distance, self.shape)
            else:
                columns[a] = -self._higher_columns(distance, a)
        result = []
        for a, b in orders:
            coefficient = np.polynomial.polynomial.polyval(current, self._slopes(b))  # (columns, n)
            value = np.einsum("nk,kn->n", columns[a], coefficient)
            if a == 0:
                value = value + self._constant_part(current, b)
            result.append(value)
        return result

    def _slopes(self, order: int) -> FloatArray:
        """The coefficients' derivatives in the current, shape (powers, columns); worked out once."""
        while len(self._known_slopes) <= order:
            self._known_slopes.append(np.asarray(np.polynomial.polynomial.polyder(self._known_slopes[-1])))
        return self._known_slopes[order]

    @cached_property
    def _known_slopes(self) -> list[FloatArray]:
        return [self._powers.T]

    def _higher_columns(self, distance: FloatArray, order: int) -> FloatArray:
        """Derivative of order - 1 >= 1 of the columns in d; from 2 on by differences of the law's own gradient.

        Central differences over steps of 0.2 % of the distance: relative error about 1e-5 for powers of d. Of laws that
        pass the face, whose lengths are millimetres and more, over 10 um.
        """
        if order == 2:
            return self.law.gradient_columns(distance, self.shape)
        step = np.full_like(distance, 1e-5) if self.law.passes_face else 2e-3 * distance
        rise = self._higher_columns(distance + step, order - 1) - self._higher_columns(distance - step, order - 1)
        return rise / (2.0 * step[:, None])

    def _constant_part(self, current: FloatArray, order: int) -> FloatArray:
        flux, inductance = self.constant_flux_linkage_Wb, self.constant_inductance_H
        if order == 0:
            return flux * current + 0.5 * inductance * current**2
        if order == 1:
            return flux + inductance * current
        return np.full_like(current, inductance) if order == 2 else np.zeros_like(current)
