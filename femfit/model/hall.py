"""What sensors of a field see: the flux density at a Hall element, and the flux linkage of a pickup coil.

Distances have the shape (...), currents (..., n) in the circuits' order.
"""

from dataclasses import dataclass
from dataclasses import field as limited
from typing import Literal, TypeAlias

import casadi as ca
import numpy as np
from casadi import SX

from femfit.core.errors import DomainError
from femfit.core.numerics import FloatArray
from femfit.device.electrics import AccelerationSensor, CurrentSensor, ForceSensor, PickupCoil, PositionSensor, Sensor
from femfit.model.bspline import FLAT, LINE, DistanceCoordinate, TensorSpline, nested_shape, spline_at
from femfit.model.magnetics import OfCurrents, current_of, part_of


class HallField(OfCurrents):
    """B_z(d, i_1..i_n) in T at the Hall element; where the states of effects are given, apart from what these read."""

    field = part_of("value")  # B_z in T, of shape (...)

    def derivatives(self, distance: FloatArray, currents: FloatArray) -> tuple[FloatArray, ...]:
        """B_z in T and dB_z/dd in T/m, both (...), and dB_z/di_k in T/A, of shape (..., n)."""
        return tuple(self.derived(distance, currents, "value", "slope", "flux_linkage"))


@dataclass(frozen=True, eq=False)
class HallSpline(HallField):
    """B_z(d, i) at the Hall element as a tensor B-spline, of one current or of none.

    B(d, i) = sum_n i^n S_n(u(d)) in a coordinate of the distance: S_0 is the magnet's part, the higher powers the
    coil's part, whose slight dependence on distance is the magnet's own permeability. In a linear actuator n <= 1.
    """

    coordinate: DistanceCoordinate = limited(metadata=FLAT)
    # In (u, i), in T; a polynomial in the current is a spline with one cell
    spline: TensorSpline = limited(metadata=FLAT)

    def expression(self, distance: SX, currents: SX) -> SX:
        """B_z of an expression's distance and current."""
        return self.spline.expression(self.coordinate.of(distance), current_of(currents), LINE)


@dataclass(frozen=True, eq=False)
class CurrentAxis:
    """The splines of a current."""

    knots_A: FloatArray = limited(metadata={"degree": "degree"})
    degree: int = limited(metadata={"within": (1, 9)})


@dataclass(frozen=True, eq=False)
class SensedField(HallField):
    """What a fixed point or a winding without current has of the field, with any circuits: a tensor B-spline.

    f(d, i_1..i_n) = sum of c_(a b1..bn) N_a(u(d)) N_b1(i_1) .. N_bn(i_n): the flux density at a Hall element, or the
    flux linkage of a pickup coil. A device that does not saturate has lines in the currents. Outside of the knots the
    polynomials at their ends are continued.
    """

    coordinate: DistanceCoordinate = limited(metadata=FLAT)
    u_knots: FloatArray = limited(metadata={"degree": "u_degree"})
    u_degree: int = limited(metadata={"within": (1, 9)})
    currents: tuple[CurrentAxis, ...] = limited(metadata={"least": 0})  # Of each circuit
    # Shape (functions of u, functions of i_1, ..)
    coefficients: FloatArray = limited(metadata={"shape": lambda f: nested_shape(f, f.currents)})

    def expression(self, distance: SX, currents: SX) -> SX:
        """The value of an expression's distance and currents."""
        n = len(self.currents)
        if n and currents.numel() != n:
            raise DomainError(
                f"Currents at a sensor's field must have the shape (..., {n}), one for each circuit in the model's "
                f"order; instead received (..., {currents.numel()})."
            )
        axes = [(self.u_knots, self.u_degree), *((axis.knots_A, axis.degree) for axis in self.currents)]
        coordinates = self.coordinate.of(distance), *ca.vertsplit(currents)[:n]
        return spline_at(self, axes, self.coefficients[..., None], *coordinates)[0]


@dataclass(frozen=True)
class HallSensor:
    """The Hall element: field, linear output, converter."""

    field: HallField = limited(metadata={"kinds": (SensedField, HallSpline)})
    sensitivity_V_per_T: float
    quiescent_V: float
    output_min_V: float
    output_max_V: float
    adc_bits: int = limited(metadata={"within": (0, 64)})
    noise_V: float = limited(default=0.0, metadata={"lower": 0.0})
    delay_s: float = limited(default=0.0, metadata={"lower": 0.0, "omit": True})
    sample_time_s: float | None = limited(default=None, metadata={"omit": True})  # None: the controller's

    @property
    def quantisation_step(self) -> float:
        """One step of the converter in V; 0 where there is none."""
        return (self.output_max_V - self.output_min_V) / 2.0**self.adc_bits if self.adc_bits else 0.0

    def output(self, distance: FloatArray, currents: FloatArray) -> FloatArray:
        """Output in V without noise, clipping or quantisation, of currents (..., n)."""
        return self.quiescent_V + self.sensitivity_V_per_T * self.field.field(distance, currents)

    def voltage(self, distance: FloatArray, current: FloatArray) -> FloatArray:
        """As :meth:`output`; the current of the only circuit, or of none, has no axis."""
        return self.output(np.asarray(distance), np.asarray(current)[..., None])


class PickupSensor(Sensor, eq=False):
    """A winding without current, and the voltage that its flux linkage in Wb induces; its reading in V.

    u = d(lambda)/dt = (d lambda/dd) v + sum (d lambda/di_k) di_k/dt. A reading of a sampled loop or record is the mean
    of u over the sample before it, (lambda_k - lambda_(k-1)) / T: what an integrating converter or a low-pass before it
    gives, and free of the steps that a driver's voltage makes at the samples. A current of the winding would pull the
    body by -d lambda/dd for each ampere, and link each circuit by d lambda/di_k: the same function says both.
    """

    COLUMN = PickupCoil.COLUMN
    flux: HallField = limited(metadata={"kinds": (SensedField,)})
    kind: Literal["pickup_coil"] = "pickup_coil"


OtherSensor: TypeAlias = CurrentSensor | PositionSensor | PickupSensor | AccelerationSensor | ForceSensor
"""A sensor of a model beside the Hall element."""
