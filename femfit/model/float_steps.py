"""Motion and Hall voltage of a handful of states in Python's floats.

One filter moves 2n + 1 sigma points a sample. At so few points calls to numpy cost several times the arithmetic; the
same equations as in :mod:`femfit.model.dynamics`, number by number, take a fifth of the time. States come as columns:
one list a state, one entry a point. Only for models of splines without effects; the others go by arrays.
"""

from dataclasses import dataclass
from functools import cached_property
from operator import add

from femfit.model.actuator_model import ActuatorModel, HallSensor
from femfit.model.bspline import FloatFunction
from femfit.model.coordinate import FloatPlaces
from femfit.model.hall import HallSpline
from femfit.model.magnetics import CoenergySpline

Columns = list[list[float]]


@dataclass(frozen=True, eq=False)
class FloatEulerStep:
    """(columns, voltage) -> columns one explicit Euler step later, columns beyond the current passed on."""

    model: ActuatorModel

    def __reduce__(self) -> tuple[type["FloatEulerStep"], tuple[ActuatorModel]]:
        return FloatEulerStep, (self.model,)

    @cached_property
    def _numbers(self) -> tuple[float, float, float, float, FloatPlaces, FloatFunction, tuple[float, float, float]]:
        model, magnetics = self.model, self.model.magnetics
        assert isinstance(magnetics, CoenergySpline)  # noqa: S101  float_euler_step asks
        circuit, motion = model.require_circuit(), model.require_motion()
        derivatives = magnetics.spline.in_floats(((1, 0), (1, 1), (0, 2)))
        electrical = circuit.resistance_ohm, motion.mass_kg, motion.gravity_m_s2
        linear = motion.linear_terms
        assert linear is not None  # noqa: S101  float_euler_step asks
        return (*electrical, model.sample_time_s, magnetics.coordinate.in_floats(), derivatives, linear)

    def __call__(self, columns: Columns, voltage: float) -> Columns:
        """Columns one step later."""
        resistance, mass, gravity, step, place, derivatives, linear = self._numbers
        constant, per_distance, per_velocity = linear
        distance, velocity, current, *others = columns
        u, approach = place(distance)
        values = derivatives(u, current)
        moved_d, moved_v, moved_i = [], [], []
        for k, (slope, mixed, inductance) in enumerate(values):
            d, v, i = distance[k], velocity[k], current[k]
            per_metre = approach[k]
            moved_d.append(d + step * v)
            further = constant + per_distance * d + per_velocity * v
            moved_v.append(v + step * (gravity + (further - per_metre * slope) / mass))
            moved_i.append(i + step * ((voltage - resistance * i + per_metre * mixed * v) / inductance))
        return [moved_d, moved_v, moved_i, *others]


def float_euler_step(model: ActuatorModel) -> FloatEulerStep | None:
    """The step of a model; None where this module does not cover it."""
    covered = model.dynamics is None and type(model.magnetics) is CoenergySpline
    covered = covered and model.require_motion().linear_terms is not None
    return FloatEulerStep(model) if covered else None


@dataclass(frozen=True, eq=False)
class FloatHallVoltage:
    """Columns -> output of the Hall element before clipping, the offset of a fourth column added."""

    sensor: HallSensor

    def __reduce__(self) -> tuple[type["FloatHallVoltage"], tuple[HallSensor]]:
        return FloatHallVoltage, (self.sensor,)

    @cached_property
    def _numbers(self) -> tuple[float, float, FloatPlaces, FloatFunction]:
        sensor, field = self.sensor, self.sensor.field
        assert isinstance(field, HallSpline)  # noqa: S101  float_hall_voltage asks
        scale = (sensor.quiescent_V, sensor.sensitivity_V_per_T)
        return (*scale, field.coordinate.in_floats(), field.spline.in_floats(((0, 0),)))

    def __call__(self, columns: Columns) -> list[float]:
        """Output in V of each point."""
        quiescent, sensitivity, place, field_of = self._numbers
        volts = [quiescent + sensitivity * value for (value,) in field_of(place(columns[0])[0], columns[2])]
        return volts if len(columns) == 3 else list(map(add, volts, columns[3]))


def float_hall_voltage(model: ActuatorModel) -> FloatHallVoltage | None:
    """The Hall voltage of a model; None where this module does not cover it."""
    sensor = model.require_sensor()
    covered = model.dynamics is None and type(sensor.field) is HallSpline
    return FloatHallVoltage(sensor) if covered else None
