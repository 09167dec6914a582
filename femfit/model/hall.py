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
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from dataclasses import field as limited
from functools import cached_property
from typing import Literal, TypeAlias

import casadi as ca
import numpy as np
from casadi import SX

from femfit.core.errors import DomainError
from femfit.core.graph import Memo, Part, derived
from femfit.core.numerics import FloatArray
from femfit.device.electrics import AccelerationSensor, CurrentSensor, ForceSensor, PositionSensor, Sensor
from femfit.model.bspline import CellTable, TensorSpline, cell_table, cells_of
from femfit.model.coordinate import DistanceCoordinate
from femfit.model.magnetics import current_of


class HallField(ABC):
    """B_z(d, i_1..i_n) at the Hall element; distances (...) in m and currents (..., n) in A broadcast."""

    @abstractmethod
    def expression(self, distance: SX, currents: SX) -> SX:
        """B_z in T of an expression's distance and currents (n,)."""

    def with_memory(self, memory: Mapping[str, SX]) -> Callable[[SX, SX], SX]:  # noqa: ARG002
        """The field itself, what effects do to its reading apart, where the states of effects are these."""
        return self.expression

    def field(self, distance: FloatArray, currents: FloatArray) -> FloatArray:
        """B_z in T, of shape (...)."""
        return derived(self._known, self.expression, _value, distance, currents)[0]

    def derivatives(self, distance: FloatArray, currents: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """B_z in T and dB_z/dd in T/m, both (...), and dB_z/di_k in T/A, of shape (..., n)."""
        value, in_distance, in_currents = derived(self._known, self.expression, _gradients, distance, currents)
        return value, in_distance, in_currents

    @property
    def several(self) -> bool:
        """Whether it is of several circuits."""
        return False

    @cached_property
    def _known(self) -> Memo:
        return Memo()


def _value(field: SX, _distance: SX, _currents: SX) -> list[Part]:
    return [(field, 0)]


def _gradients(field: SX, distance: SX, currents: SX) -> list[Part]:
    return [(field, 0), (ca.gradient(field, distance), 0), (ca.gradient(field, currents), 1)]


@dataclass(frozen=True, eq=False)
class HallSpline(HallField):
    """B_z(d, i) at the Hall element as a tensor B-spline, of one current or of none."""

    coordinate: DistanceCoordinate
    spline: TensorSpline  # In (u, i), in T; a polynomial in the current is a spline with one cell

    def expression(self, distance: SX, currents: SX) -> SX:
        """B_z of an expression's distance and current."""
        return self.spline.expression(self.coordinate.of(distance), current_of(currents))


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
        current = np.asarray(current)
        return self.output(np.asarray(distance), current if self.field.several else current[..., None])


@dataclass(frozen=True, eq=False)
class SensedField(HallField):
    """The spline of the module's head."""

    coordinate: DistanceCoordinate
    u_knots: FloatArray
    u_degree: int
    current_knots_A: tuple[FloatArray, ...]  # Of each circuit
    current_degrees: tuple[int, ...]
    coefficients: FloatArray  # Shape (functions of u, functions of i_1, ..)

    def expression(self, distance: SX, currents: SX) -> SX:
        """The value of an expression's distance and currents."""
        n = len(self.current_knots_A)
        if n and currents.numel() != n:
            raise DomainError(
                f"Currents at a sensor's field must have the shape (..., {n}), one for each circuit in the model's "
                f"order; instead received (..., {currents.numel()})."
            )
        return cell_table(self, self._cells).at(self.coordinate.of(distance), *ca.vertsplit(currents)[:n])[0]

    def _cells(self) -> CellTable:
        along = zip(self.current_knots_A, self.current_degrees, strict=True)
        axes = [cells_of(self.u_knots, self.u_degree), *(cells_of(*axis) for axis in along)]
        return CellTable(axes, self.coefficients[..., None])

    @property
    def several(self) -> bool:
        """Whether it is of several circuits."""
        return len(self.current_knots_A) > 1

    def scaled(self, magnets: float, currents: Sequence[float]) -> "SensedField":
        """The field with magnets and currents scaled: s_0 f(d, i_1 s_1 / s_0, ..), of the first degree in both."""
        scales = [one / magnets for one in currents]
        knots = tuple(one / s for one, s in zip(self.current_knots_A, scales, strict=False))  # or of no current
        return replace(self, current_knots_A=knots, coefficients=magnets * self.coefficients)


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
