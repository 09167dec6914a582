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
from femfit.model.magnetics import Orders, only_current


class HallField(ABC):
    """B_z(d, i_1..i_n) at the Hall element; distances (...) in m and currents (..., n) in A broadcast."""

    @abstractmethod
    def field(self, distance: FloatArray, currents: FloatArray) -> FloatArray:
        """B_z in T, of shape (...)."""

    @abstractmethod
    def derivatives(self, distance: FloatArray, currents: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """B_z in T and dB_z/dd in T/m, both (...), and dB_z/di_k in T/A, of shape (..., n)."""


class OneCurrentField(HallField):
    """B_z(d, i) of one current, or of none: written without the axis that its users give and get."""

    @abstractmethod
    def _partials(self, distance: FloatArray, current: FloatArray, orders: Orders) -> list[FloatArray]:
        """Partial derivatives of B_z at flat arrays."""

    def partials(self, distance: FloatArray, current: FloatArray, orders: Orders) -> list[FloatArray]:
        """Partial derivatives of the field at distances and currents (...), in T / m^a / A^b."""
        if np.ndim(distance) == 1 and np.shape(distance) == np.shape(current):  # what plant and filters ask for
            return self._partials(np.asarray(distance, np.float64), np.asarray(current, np.float64), orders)
        distance, current = np.broadcast_arrays(
            np.asarray(distance, dtype=np.float64), np.asarray(current, dtype=np.float64)
        )
        return [value.reshape(distance.shape) for value in self._partials(distance.ravel(), current.ravel(), orders)]

    def field(self, distance: FloatArray, currents: FloatArray) -> FloatArray:
        """B_z in T, of shape (...)."""
        return self.partials(distance, only_current(currents), ((0, 0),))[0]

    def derivatives(self, distance: FloatArray, currents: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """B_z and its slopes along the distance and the current, the last of shape (..., n)."""
        value, in_d, in_i = self.partials(distance, only_current(currents), ((0, 0), (1, 0), (0, 1)))
        return value, in_d, in_i[..., None][..., : currents.shape[-1]]


@dataclass(frozen=True, eq=False)
class HallSpline(OneCurrentField):
    """B_z(d, i) at the Hall element as a tensor B-spline."""

    coordinate: DistanceCoordinate
    spline: TensorSpline  # In (u, i), in T; a polynomial in the current is a spline with one cell

    def _partials(self, distance: FloatArray, current: FloatArray, orders: Orders) -> list[FloatArray]:
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

    def output(self, distance: FloatArray, currents: FloatArray) -> FloatArray:
        """Output in V without noise, clipping or quantisation, of currents (..., n)."""
        return self.quiescent_V + self.sensitivity_V_per_T * self.field.field(distance, currents)

    def voltage(self, distance: FloatArray, current: FloatArray) -> FloatArray:
        """As :meth:`output`; the current of the only circuit, or of none, has no axis."""
        several = isinstance(self.field, SensedField) and len(self.field.current_knots_A) > 1
        return self.output(np.asarray(distance), np.asarray(current) if several else np.asarray(current)[..., None])


@dataclass(frozen=True, eq=False)
class SensedField(HallField):
    """The spline of the module's head."""

    coordinate: DistanceCoordinate
    u_knots: FloatArray
    u_degree: int
    current_knots_A: tuple[FloatArray, ...]  # Of each circuit
    current_degrees: tuple[int, ...]
    coefficients: FloatArray  # Shape (functions of u, functions of i_1, ..)

    def field(self, distance: FloatArray, currents: FloatArray) -> FloatArray:
        """The value at distances and currents, shape (...)."""
        return self._values(distance, currents, slopes=False)[0]

    def derivatives(self, distance: FloatArray, currents: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Value, slope along the distance, both (...), and slopes along the currents, (..., n)."""
        value, in_distance, *in_currents = self._values(distance, currents, slopes=True)
        empty = np.zeros((*value.shape, 0))
        return value, in_distance, np.stack(in_currents, axis=-1) if in_currents else empty

    def scaled(self, magnets: float, currents: Sequence[float]) -> "SensedField":
        """The field with magnets and currents scaled: s_0 f(d, i_1 s_1 / s_0, ..), of the first degree in both."""
        scales = [one / magnets for one in currents]
        knots = tuple(one / s for one, s in zip(self.current_knots_A, scales, strict=False))  # or of no current
        return replace(self, current_knots_A=knots, coefficients=magnets * self.coefficients)

    def _values(self, distance: FloatArray, currents: FloatArray, *, slopes: bool) -> list[FloatArray]:
        """The value and, where asked for, its slopes along the distance and each current."""
        n, currents = len(self.current_knots_A), np.asarray(currents, dtype=np.float64)
        if n and currents.shape[-1:] != (n,):
            raise DomainError(
                f"Currents at a sensor's field must have the shape (..., {n}), one for each circuit in the model's "
                f"order; instead received the shape {currents.shape}."
            )
        shape = np.broadcast_shapes(np.shape(distance), currents.shape[:-1])
        along = [np.asarray(distance, dtype=np.float64), *(currents[..., k] for k in range(n))]
        flat = [np.broadcast_to(values, shape).ravel() for values in along]
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
        """The voltage at an instant, of shape (...); currents and their rates in A/s are (..., n)."""
        _, in_distance, in_currents = self.flux.derivatives(distance, currents)
        return np.asarray(in_distance * velocity + (in_currents * current_rates).sum(axis=-1))


OtherSensor: TypeAlias = CurrentSensor | PositionSensor | PickupSensor | AccelerationSensor | ForceSensor
