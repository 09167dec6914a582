"""The field at the Hall element: coil part and magnet part, from the sweep.

B(d, i) = sum_n i^n S_n(u(d)) in a coordinate of the distance: S_0 is the magnet's part, the higher powers the coil's
part, whose slight dependence on distance is the magnet's own permeability. In a linear actuator n <= 1.

The Hall element of a model: its field, its output and its converter.

What a fixed point or a winding without current has of the field, with any circuits: a tensor B-spline.

f(d, i_1..i_n) = sum of c_(a b1..bn) N_a(u(d)) N_b1(i_1) .. N_bn(i_n): the flux density at a Hall element, or the flux
linkage of a pickup coil. A device that does not saturate has lines in the currents. Outside of the knots the
polynomials at their ends are continued.

Distances have the shape (...), currents (..., n) in the circuits' order, or (...) where there is one circuit or none.

A pickup coil of a model: a winding without current, and the voltage that its flux linkage induces.

u = d(lambda)/dt = (d lambda/dd) v + sum (d lambda/di_k) di_k/dt. A reading of a sampled loop or record is the mean of u
over the sample before it, (lambda_k - lambda_(k-1)) / T: what an integrating converter or a low-pass before it gives,
and free of the steps that a driver's voltage makes at the samples. A current of the winding would pull the body by
-d lambda/dd for each ampere, and link each circuit by d lambda/di_k: the same function says both.

The sensors of a model beside the Hall element.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from dataclasses import field as limited
from typing import Literal, TypeAlias

import numpy as np

from femfit.core.errors import DomainError
from femfit.core.numerics import FloatArray
from femfit.device.electrics import AccelerationSensor, CurrentSensor, ForceSensor, PositionSensor, Sensor
from femfit.model.bspline import TensorSpline, basis_matrix
from femfit.model.coordinate import DistanceCoordinate
from femfit.model.several_magnetics import of_one_circuit


class HallField(ABC):
    """B_z(d, i) at the Hall element; all arguments broadcast, distances in m, currents in A."""

    @abstractmethod
    def _partials(
        self, distance: FloatArray, current: FloatArray, orders: tuple[tuple[int, int], ...]
    ) -> list[FloatArray]:
        """Partial derivatives of B_z at flat arrays, for orders (in d, in i)."""

    def partials(
        self, distance: FloatArray, current: FloatArray, orders: tuple[tuple[int, int], ...]
    ) -> list[FloatArray]:
        """Partial derivatives of the field, of orders (in d, in i), in T / m^a / A^b."""
        if np.ndim(distance) == 1 and np.shape(distance) == np.shape(current):  # what plant and filters ask for
            return self._partials(np.asarray(distance, np.float64), np.asarray(current, np.float64), orders)
        distance, current = np.broadcast_arrays(
            np.asarray(distance, dtype=np.float64), np.asarray(current, dtype=np.float64)
        )
        return [value.reshape(distance.shape) for value in self._partials(distance.ravel(), current.ravel(), orders)]

    def field(self, distance: FloatArray, current: FloatArray) -> FloatArray:
        """B_z in T at distances (m) and currents (A) that broadcast."""
        return self.partials(distance, current, ((0, 0),))[0]

    def derivatives(self, distance: FloatArray, current: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """B_z in T, dB_z/dd in T/m and dB_z/di in T/A."""
        value, in_d, in_i = self.partials(distance, current, ((0, 0), (1, 0), (0, 1)))
        return value, in_d, in_i


@dataclass(frozen=True, eq=False)
class HallSpline(HallField):
    """B_z(d, i) at the Hall element as a tensor B-spline."""

    coordinate: DistanceCoordinate
    spline: TensorSpline  # In (u, i), in T; a polynomial in the current is a spline with one cell

    def _partials(
        self, distance: FloatArray, current: FloatArray, orders: tuple[tuple[int, int], ...]
    ) -> list[FloatArray]:
        return self.coordinate.partial_derivatives(self.spline, distance, current, orders)


# Limits in a field's metadata are what a model file is held to: see femfit.model.json_section.


@dataclass(frozen=True)
class HallSensor:
    """The Hall element: field, linear output, converter."""

    field: HallField
    sensitivity_V_per_T: float
    quiescent_V: float
    output_min_V: float
    output_max_V: float = limited(metadata={"not_below": "output_min_V"})
    adc_bits: int = limited(metadata={"within": (0, 64)})
    noise_V: float = limited(default=0.0, metadata={"lower": 0.0})
    delay_s: float = limited(default=0.0, metadata={"lower": 0.0, "absent": 0.0})
    sample_time_s: float | None = None  # None: the controller's

    @property
    def quantisation_step(self) -> float:
        """One step of the converter in V; 0 where there is none."""
        return (self.output_max_V - self.output_min_V) / 2.0**self.adc_bits if self.adc_bits else 0.0

    def voltage(self, distance: FloatArray, current: FloatArray) -> FloatArray:
        """Output in V without noise, clipping or quantisation."""
        return self.quiescent_V + self.sensitivity_V_per_T * self.field.field(distance, current)


@dataclass(frozen=True, eq=False)
class SensedField(HallField):
    """The spline of the module's head."""

    coordinate: DistanceCoordinate
    u_knots: FloatArray
    u_degree: int
    current_knots_A: tuple[FloatArray, ...]  # Of each circuit
    current_degrees: tuple[int, ...]
    coefficients: FloatArray  # Shape (functions of u, functions of i_1, ..)

    def field(self, distance: FloatArray, current: FloatArray) -> FloatArray:
        """The value at distances and currents, shape (...)."""
        return self._values(distance, current, slopes=False)[0]

    def derivatives(self, distance: FloatArray, current: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Value, slope along the distance, both (...), and slopes along the currents, in the currents' shape."""
        value, in_distance, *in_currents = self._values(distance, current, slopes=True)
        if len(in_currents) == 1:
            return value, in_distance, in_currents[0]
        empty = np.zeros((*value.shape, 0))
        return value, in_distance, np.stack(in_currents, axis=-1) if in_currents else empty

    def scaled(self, magnets: float, currents: Sequence[float]) -> "SensedField":
        """The field with magnets and currents scaled: s_0 f(d, i_1 s_1 / s_0, ..), of the first degree in both."""
        scales = [one / magnets for one in currents]
        knots = tuple(one / s for one, s in zip(self.current_knots_A, scales, strict=False))  # or of no current
        return replace(self, current_knots_A=knots, coefficients=magnets * self.coefficients)

    def _partials(
        self,
        distance: FloatArray,  # noqa: ARG002  the base class's
        current: FloatArray,  # noqa: ARG002
        orders: tuple[tuple[int, int], ...],  # noqa: ARG002
    ) -> list[FloatArray]:
        raise of_one_circuit(f"its sensor's field is of {len(self.current_knots_A)}")

    def _values(self, distance: FloatArray, current: FloatArray, *, slopes: bool) -> list[FloatArray]:
        """The value and, where asked for, its slopes along the distance and each current."""
        n, current = len(self.current_knots_A), np.asarray(current, dtype=np.float64)
        if n > 1 and current.shape[-1:] != (n,):
            raise DomainError(
                f"Currents at a sensor's field must have the shape (..., {n}), one for each circuit in the model's "
                f"order; instead received the shape {current.shape}."
            )
        shape = np.broadcast_shapes(np.shape(distance), current.shape if n < 2 else current.shape[:-1])
        along = [current] if n == 1 else [current[..., k] for k in range(n)]
        flat = [np.broadcast_to(one, shape).ravel() for one in (np.asarray(distance, dtype=np.float64), *along)]
        u, rate, _ = self.coordinate.with_slopes(flat[0])
        axes = list(zip(flat[1:], self.current_knots_A, self.current_degrees, strict=True))
        places = [basis_matrix(*axis) for axis in axes]
        at = np.tensordot(basis_matrix(u, self.u_knots, self.u_degree), self.coefficients, axes=1)
        found = [_contracted(at, places)]
        if slopes:
            risen = np.tensordot(basis_matrix(u, self.u_knots, self.u_degree, 1), self.coefficients, axes=1)
            found.append(rate * _contracted(risen, places))
            for k, axis in enumerate(axes):
                rising = [*places[:k], basis_matrix(*axis, 1), *places[k + 1 :]]
                found.append(_contracted(at, rising))
        return [value.reshape(shape) for value in found]


def _contracted(values: FloatArray, bases: list[FloatArray]) -> FloatArray:
    """Sum over the axes after the first, one circuit's functions after the other."""
    for basis in bases:
        values = np.einsum("pi,pi...->p...", basis, values)
    return values


@dataclass(frozen=True, kw_only=True, eq=False)
class PickupSensor(Sensor):
    """The winding, whose flux linkage stands in Wb; its reading in V."""

    flux: SensedField
    kind: Literal["pickup_coil"] = "pickup_coil"

    def voltage(
        self, distance: FloatArray, currents: FloatArray, velocity: FloatArray, current_rates: FloatArray
    ) -> FloatArray:
        """The voltage at an instant, of shape (...); rates in A/s in the shape of the currents."""
        _, in_distance, in_currents = self.flux.derivatives(distance, currents)
        induced = in_currents * current_rates
        several = np.ndim(in_currents) > np.ndim(in_distance)
        return np.asarray(in_distance * velocity + (induced.sum(axis=-1) if several else induced))


OtherSensor: TypeAlias = CurrentSensor | PositionSensor | PickupSensor | AccelerationSensor | ForceSensor
