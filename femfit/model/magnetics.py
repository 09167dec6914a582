"""The magnetic half of the model: force and flux linkage from one co-energy W'(d, i_1..i_n).

F = -dW'/dd (on the moving part, positive towards the electromagnet), flux linkage = dW'/di, motional constant
k_m = dF/di = -d(flux linkage)/dd, inductance L = d(flux linkage)/di. Deriving all of them from one expression
makes reciprocity hold to rounding, whatever was fitted.

References
----------
H. H. Woodson and J. R. Melcher, Electromechanical Dynamics, part I (Wiley, 1968), section 3.1.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import casadi as ca
import numpy as np
from casadi import SX

from femfit.core.errors import DomainError
from femfit.core.graph import GraphFunction, once
from femfit.core.numerics import FloatArray
from femfit.laws.catalogue import law_by_name
from femfit.laws.law import ForceLaw
from femfit.model.bspline import FLAT, DistanceCoordinate, TensorSpline

NOTHING: FloatArray = np.empty(0)


@dataclass(frozen=True, eq=False)
class MagneticState:
    """What the circuits and the motion need at one or many points, of n currents; the last three where asked for."""

    force: FloatArray  # F in N, shape (...)
    motional_constant: FloatArray  # k_m in V s/m = N/A, shape (..., n)
    inductance: FloatArray  # L in H, shape (..., n, n)
    force_gradient: FloatArray = field(default_factory=lambda: NOTHING)  # dF/dd in N/m, shape (...)
    flux_linkage: FloatArray = field(default_factory=lambda: NOTHING)  # In Wb, shape (..., n)
    hall_T: FloatArray = field(default_factory=lambda: NOTHING)  # Field at the Hall element, (...); 0 without one


AXES = {"value": 0, "slope": 0, "force": 0, "force_gradient": 0, "flux_linkage": 1, "motional_constant": 1}
AXES |= {"inductance": 2}
"""Parts derived of a function of distance and n currents, as :class:`MagneticState` names those of a co-energy: how
many axes of currents each has. The slope is along the distance."""


def derivatives_of(names: Iterable[str], value: SX, distance: SX, currents: SX) -> dict[str, SX]:
    """Parts of :data:`AXES` by name; one of several axes is symmetric in them."""
    rise, linkage = ca.gradient(value, distance), ca.gradient(value, currents)
    parts: dict[str, Callable[[], SX]] = {
        "value": lambda: value,
        "slope": lambda: rise,
        "force": lambda: -rise,
        "force_gradient": lambda: -ca.gradient(rise, distance),
        "flux_linkage": lambda: linkage,
        "motional_constant": lambda: -ca.jacobian(linkage, distance),
        "inductance": lambda: ca.jacobian(linkage, currents),
    }
    return {name: ca.vec(ca.densify(parts[name]())) for name in names}


ForceOfCurrents = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
"""Force (...) in N and motional constants (..., n) in N/A of currents (..., n) in A."""


class OfCurrents(ABC):
    """A function of (d, i_1..i_n); distances (...) in m and currents (..., n) in A broadcast, and n may be none."""

    @abstractmethod
    def expression(self, distance: SX, currents: SX) -> SX:
        """The value at an expression's distance and currents (n,): of a co-energy in J, up to a constant."""

    def with_memory(self, memory: Mapping[str, SX]) -> Callable[[SX, SX], SX]:  # noqa: ARG002
        """The same where the states of effects are these."""
        return self.expression

    def derived(self, distance: FloatArray, currents: FloatArray, *names: str) -> list[FloatArray]:
        """Parts of :data:`AXES` at points, each (..., n, .., n)."""
        d, i = np.asarray(distance, dtype=np.float64), np.atleast_1d(np.asarray(currents, dtype=np.float64))
        n = i.shape[-1]

        def made() -> GraphFunction:
            point = SX.sym("d"), SX.sym("i", n)
            parts = derivatives_of(names, SX(self.expression(*point)), *point)
            return GraphFunction([ca.vertcat(*point)], ca.vertcat(*parts.values()))

        points = np.broadcast_shapes(d.shape, i.shape[:-1])
        x = np.empty((1 + n, *points))
        x[0] = d
        for k in range(n):
            x[1 + k] = i[..., k]
        values, pieces, end = once(self, (names, n), made)(x.reshape(1 + n, -1)), [], 0
        for name in names:
            first, end = end, end + n ** AXES[name]
            pieces.append(values[first:end].T.reshape((*points, *[n] * AXES[name])))
        return pieces


def part_of(name: str) -> Callable[[OfCurrents, FloatArray, FloatArray], FloatArray]:
    """A method that gives one of :data:`AXES`."""

    def part(function: OfCurrents, distance: FloatArray, currents: FloatArray) -> FloatArray:
        return function.derived(distance, currents, name)[0]

    return part


class Magnetics(OfCurrents):
    """A co-energy W'(d, i_1..i_n)."""

    coenergy = part_of("value")  # W' in J, up to a constant, of shape (...)
    force = part_of("force")  # F = -dW'/dd in N, positive towards the electromagnet, of shape (...)
    flux_linkage = part_of("flux_linkage")  # dW'/di_k in Wb, of shape (..., n)
    motional_constant = part_of("motional_constant")  # k_m = dF/di_k = -d(flux linkage_k)/dd in N/A, of shape (..., n)
    inductance = part_of("inductance")  # L = d(flux linkage_j)/di_k in H, of shape (..., n, n)
    force_gradient = part_of("force_gradient")  # dF/dd in N/m, of shape (...)

    def state(self, distance: FloatArray, currents: FloatArray) -> MagneticState:
        """Force, motional constants and inductances together, at the price of little more than one."""
        return MagneticState(*self.derived(distance, currents, "force", "motional_constant", "inductance"))

    def slopes(self, distance: FloatArray, currents: FloatArray) -> MagneticState:
        """The same with the slope of the force along the distance."""
        names = "force", "motional_constant", "inductance", "force_gradient"
        return MagneticState(*self.derived(distance, currents, *names))

    def at_distances(self, distance: FloatArray) -> ForceOfCurrents:
        """Force and motional constants as functions of the circuits' currents, for a search where the body stays."""

        def force(currents: FloatArray) -> tuple[FloatArray, FloatArray]:
            force, motional_constant = self.derived(distance, currents, "force", "motional_constant")
            return force, motional_constant

        return force


@dataclass(frozen=True, eq=False)
class Windings:
    """All windings of a model: the n circuits, and after them the r patterns of eddy currents, short-circuited."""

    magnetics: Magnetics  # Of all their currents
    resistances_ohm: FloatArray  # Shape (n + r,)
    series_H: FloatArray  # In series outside of the field, on the diagonal of shape (n + r, n + r)

    @property
    def count(self) -> int:
        """How many there are, n + r."""
        return len(self.resistances_ohm)

    @property
    def end(self) -> int:
        """Place behind the currents in a state (distance, velocity, currents, ..)."""
        return 2 + len(self.resistances_ohm)


def current_of(currents: SX) -> SX:
    """The only current of an expression's; zero where there is none.

    Raises
    ------
    DomainError
        If there are more.
    """
    if currents.numel() > 1:
        raise DomainError(f"Currents must have the shape (..., 1); instead received (..., {currents.numel()}).")
    return currents if currents.numel() else SX(0.0)


@dataclass(frozen=True, eq=False)
class CoenergySpline(Magnetics):
    """W'(d, i) as a tensor B-spline in a coordinate u(d) and i, of one current or of none."""

    kind: Literal["coenergy_spline"] = field(default="coenergy_spline", kw_only=True)
    coordinate: DistanceCoordinate = field(metadata=FLAT)
    spline: TensorSpline = field(metadata={"flat": True})  # In (u, i), in J

    def expression(self, distance: SX, currents: SX) -> SX:
        """W' of an expression's distance and current."""
        return self.spline.expression(self.coordinate.of(distance), current_of(currents))


@dataclass(frozen=True)
class Coefficient:
    """One term c i^n phi_k(d) of a force law, as fitted."""

    basis: str  # Name of the column phi_k
    current_power: int = field(metadata={"within": (0, 16)})
    value: float
    unit: str
    ci95: tuple[float, float] | None = None  # 95 % interval, where it was estimated
    # What the fit allowed; infinite where it did not bound
    bounds: tuple[float, float] = field(default=(-np.inf, np.inf), metadata={"required": True})
    active: str = ""  # ``lower``, ``upper`` or empty: the bound that the fit hit


@dataclass(frozen=True, eq=False)
class LawMagnetics(Magnetics):
    """A force law with polynomial coefficient functions, and the flux linkage that reciprocity leaves open.

    W'(d, i) = sum_k,n c_kn i^n (Phi_k(d) - Phi_k(d_ref)) + flux_linkage_ref i + L_ref i^2 / 2. Force data say nothing
    about the last two terms, which do not depend on the distance. Counted from d_ref, the farthest distance of the
    sweep, they are the flux linkage without current and the inductance there, and no integral to infinity, where no
    row holds a law, enters the circuit.
    """

    kind: Literal["law"] = field(default="law", kw_only=True)
    law_name: str = field(metadata={"key": "law"})
    coefficients: tuple[Coefficient, ...]
    shape: Mapping[str, float] = field(default_factory=dict, metadata={"required": True})
    constant_inductance_H: float = field(default=0.0, metadata={"required": True})
    constant_flux_linkage_Wb: float = field(default=0.0, metadata={"required": True})
    reference_distance_m: float | None = None  # d_ref; None for infinity, as in models of earlier versions

    def faults(self) -> Iterator[tuple[str, str]]:
        """Coefficients of columns that the law lacks."""
        for k, coefficient in enumerate(self.coefficients):
            if coefficient.basis not in self.law.basis:
                yield f"coefficients[{k}].basis", f"a column of the law ({', '.join(self.law.basis)})"

    @cached_property
    def law(self) -> ForceLaw:
        """The law's data and functions."""
        return law_by_name(self.law_name)

    def expression(self, distance: SX, currents: SX) -> SX:
        """W' of an expression's distance and current."""
        i = current_of(currents)
        there = self.law.potentials(distance, self.shape)
        held = (0.0,) * len(there)
        if self.reference_distance_m is not None:
            held = self.law.potentials(self.reference_distance_m, self.shape)
        potential = {name: a - b for name, a, b in zip(self.law.basis, there, held, strict=True)}
        value = sum(c.value * i**c.current_power * potential[c.basis] for c in self.coefficients)
        return value + self.constant_flux_linkage_Wb * i + 0.5 * self.constant_inductance_H * i**2
