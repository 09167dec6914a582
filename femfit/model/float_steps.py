"""Motion and readings of a handful of states in Python's floats.

One filter moves 2n + 1 sigma points a sample. At so few points calls to numpy cost several times the arithmetic; the
same equations as in :mod:`femfit.model.dynamics`, number by number, take a fifth of the time. States come as columns:
one list a state, one entry a point. Only for models of splines without effects; the others go by arrays.

Force, motional constants and inductances at one point, as cheaply as one point allows.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from math import expm1, inf
from operator import add

import numpy as np

from femfit.core.numerics import FloatArray
from femfit.device.electrics import CurrentSensor, PositionSensor, Sensor
from femfit.model.actuator_model import ActuatorModel
from femfit.model.bspline import FloatFunction
from femfit.model.coordinate import FloatPlaces
from femfit.model.hall import HallSensor, HallSpline
from femfit.model.magnetics import CoenergySpline, Magnetics
from femfit.model.sensed_effects import records_as_it_is
from femfit.model.sensors import current_index
from femfit.model.windings import LEAST_DECAY

Columns = list[list[float]]


@dataclass(frozen=True, eq=False)
class FloatStep:
    """(columns, voltage) -> columns one step later, by :func:`femfit.model.exponential_step.exponential_step`.

    Columns beyond the current are passed on, and the body is kept between the stops.
    """

    model: ActuatorModel

    def __reduce__(self) -> tuple[type["FloatStep"], tuple[ActuatorModel]]:
        return FloatStep, (self.model,)

    @cached_property
    def _numbers(
        self,
    ) -> tuple[float, float, float, float, FloatPlaces, FloatFunction, tuple[float, float, float]]:
        model, magnetics = self.model, self.model.magnetics
        assert isinstance(magnetics, CoenergySpline)  # noqa: S101  float_step asks
        circuit, motion = model.require_circuit(), model.require_motion()
        derivatives = magnetics.spline.in_floats(((1, 0), (1, 1), (0, 2)))
        electrical = circuit.resistance_ohm, circuit.inductance_H, motion.mass_kg, motion.gravity_m_s2
        linear = motion.linear_terms
        assert linear is not None  # noqa: S101  float_step asks
        return (*electrical, magnetics.coordinate.in_floats(), derivatives, linear)

    @cached_property
    def _ends(self) -> tuple[float, float]:
        return self.model.require_motion().ends

    def __call__(self, columns: Columns, voltage: float) -> Columns:
        """Columns one step later."""
        distance, velocity, current, *others = columns
        resistance, series, mass, gravity, place, derivatives, linear = self._numbers
        constant, per_distance, per_velocity = linear
        step = self.model.sample_time_s
        half, lever, decay = 0.5 * step, step * step / mass, step * resistance
        middle = [d + half * v for d, v in zip(distance, velocity)]  # noqa: B905  of one length
        u, approach = place(middle)
        moved_d, moved_v, moved_i = [], [], []
        for k, (slope, mixed, own) in enumerate(derivatives(u, current)):
            v, i, per_metre = velocity[k], current[k], approach[k]
            further = constant + per_distance * middle[k] + per_velocity * v
            acceleration = gravity + (further - per_metre * slope) / mass
            motional, inductance = per_metre * mixed, own + series
            rate = (voltage - resistance * i + motional * (v + half * acceleration)) / inductance
            z = max(decay / inductance, LEAST_DECAY)
            first = -expm1(-z) / z
            after = v + step * acceleration - lever * motional * rate * (1.0 - first) / z
            moved_d.append(distance[k] + half * (v + after))
            moved_v.append(after)
            moved_i.append(i + step * first * rate)
        if self._ends != (-inf, inf):
            near, far = self._ends
            for k, d in enumerate(moved_d):
                if not near < d < far:
                    moved_d[k] = min(max(d, near), far)
                    moved_v[k] = max(moved_v[k], 0.0) if d <= near else min(moved_v[k], 0.0)
        return [moved_d, moved_v, moved_i, *others]


def float_step(model: ActuatorModel) -> FloatStep | None:
    """The step of a model; None where this module does not cover it."""
    covered = model.dynamics is None and model.eddy is None and type(model.magnetics) is CoenergySpline
    covered = covered and len(model.circuits) == 1 and model.require_motion().linear_terms is not None
    return FloatStep(model) if covered else None


@dataclass(frozen=True, eq=False)
class FloatHallVoltage:
    """Columns -> output of the Hall element before clipping, the column of its offset added where there is one."""

    sensor: HallSensor
    bias: int | None

    def __reduce__(self) -> tuple[type["FloatHallVoltage"], tuple[HallSensor, int | None]]:
        return FloatHallVoltage, (self.sensor, self.bias)

    @cached_property
    def _numbers(self) -> tuple[float, float, FloatPlaces, FloatFunction]:
        sensor, field = self.sensor, self.sensor.field
        assert isinstance(field, HallSpline)  # noqa: S101  float_reading asks
        scale = (sensor.quiescent_V, sensor.sensitivity_V_per_T)
        return (*scale, field.coordinate.in_floats(), field.spline.in_floats(((0, 0),)))

    def __call__(self, columns: Columns) -> list[float]:
        """Output in V of each point."""
        quiescent, sensitivity, place, field_of = self._numbers
        volts = [quiescent + sensitivity * value for (value,) in field_of(place(columns[0])[0], columns[2])]
        return volts if self.bias is None else list(map(add, volts, columns[self.bias]))


@dataclass(frozen=True)
class FloatLinear:
    """Columns -> offset + gain (distance - delay velocity), or offset + gain current, and a bias."""

    gain: float
    offset: float
    delay_s: float | None  # None: of the current
    bias: int | None
    current: int = 2  # Which state is the current

    def __call__(self, columns: Columns) -> list[float]:
        """Reading of each point."""
        gain, offset, delay = self.gain, self.offset, self.delay_s
        if delay is None:
            read = [offset + gain * i for i in columns[self.current]]
        else:
            read = [offset + gain * (d - delay * v) for d, v in zip(columns[0], columns[1], strict=True)]
        return read if self.bias is None else list(map(add, read, columns[self.bias]))


def float_reading(
    model: ActuatorModel, sensor: HallSensor | Sensor, bias: int | None
) -> FloatHallVoltage | FloatLinear | None:
    """The readings of a sensor whose bias is a state of a number; None where this module does not cover it."""
    if isinstance(sensor, HallSensor):
        covered = model.dynamics is None and model.eddy is None and type(sensor.field) is HallSpline
        return FloatHallVoltage(sensor, bias) if covered else None
    if not records_as_it_is(model):
        return None
    if isinstance(sensor, CurrentSensor):
        return FloatLinear(sensor.gain, sensor.offset, None, bias, current_index(model, sensor))
    if isinstance(sensor, PositionSensor) and len(sensor.distances_m) == 2:
        (near, far), (first, last) = sensor.distances_m, sensor.readings
        gain = (last - first) / (far - near)
        return FloatLinear(gain, first - gain * near, sensor.delay_s, bias)
    return None


PointMagnetics = Callable[[float, FloatArray], tuple[float, FloatArray, FloatArray]]
"""(distance in m, currents in A, shape (n,)) -> F in N, dF/di in N/A, shape (n,), and L in H, shape (n, n)."""


def point_magnetics(magnetics: Magnetics) -> PointMagnetics:
    """Force, motional constants and inductances of a co-energy; in floats where there is one current, or none."""
    if type(magnetics) is not CoenergySpline:

        def by_arrays(distance: float, currents: FloatArray) -> tuple[float, FloatArray, FloatArray]:
            state = magnetics.state(np.array([distance]), currents[None])
            return float(state.force[0]), state.motional_constant[0], state.inductance[0]

        return by_arrays

    place = magnetics.coordinate.in_floats()
    derivatives = magnetics.spline.in_floats(((1, 0), (1, 1), (0, 2)))

    def in_floats(distance: float, currents: FloatArray) -> tuple[float, FloatArray, FloatArray]:
        u, (per_metre,) = place([distance])
        if not currents.size:
            ((slope, _, _),) = derivatives(u, [0.0])
            return per_metre * slope, currents, np.zeros((0, 0))
        ((slope, mixed, inductance),) = derivatives(u, [float(currents[0])])
        return per_metre * slope, np.array([per_metre * mixed]), np.array([[inductance]])

    return in_floats
