"""Motion and Hall voltage of a handful of states in Python's floats.

One filter moves 2n + 1 sigma points a sample. At so few points calls to numpy cost several times the arithmetic; the
same equations as in :mod:`femfit.model.dynamics`, number by number, take a fifth of the time. States come as columns:
one list a state, one entry a point. Only for models of splines without effects; the others go by arrays.
"""

from collections.abc import Callable
from operator import add

from femfit.model.actuator_model import ActuatorModel
from femfit.model.hall import HallSpline
from femfit.model.magnetics import CoenergySpline

Columns = list[list[float]]


def float_euler_step(model: ActuatorModel) -> Callable[[Columns, float], Columns] | None:
    """A function (columns, voltage) -> columns one explicit Euler step later, columns beyond the current passed on.

    None where this module does not cover the model.
    """
    magnetics, step = model.magnetics, model.sample_time_s
    circuit, motion = model.require_circuit(), model.require_motion()
    linear = motion.linear_terms
    if model.dynamics is not None or type(magnetics) is not CoenergySpline or linear is None:
        return None
    resistance, mass, gravity = circuit.resistance_ohm, motion.mass_kg, motion.gravity_m_s2
    constant, per_distance, per_velocity = linear
    reference, shift = magnetics.reference_distance_m, magnetics.distance_shift_m
    derivatives = magnetics.spline.in_floats(((1, 0), (1, 1), (0, 2)))

    def advance(columns: Columns, voltage: float) -> Columns:
        distance, velocity, current, *others = columns
        u = [reference / (d + shift) for d in distance]
        values = derivatives(u, current)
        moved_d, moved_v, moved_i = [], [], []
        for k, (slope, mixed, inductance) in enumerate(values):
            d, v, i = distance[k], velocity[k], current[k]
            per_metre = u[k] / (d + shift)
            moved_d.append(d + step * v)
            further = constant + per_distance * d + per_velocity * v
            moved_v.append(v + step * (gravity + (further - per_metre * slope) / mass))
            moved_i.append(i + step * ((voltage - resistance * i + per_metre * mixed * v) / inductance))
        return [moved_d, moved_v, moved_i, *others]

    return advance


def float_hall_voltage(model: ActuatorModel) -> Callable[[Columns], list[float]] | None:
    """A function columns -> output of the Hall element before clipping, the offset of a fourth column added.

    None where this module does not cover the model.
    """
    sensor = model.require_sensor()
    field = sensor.field
    if model.dynamics is not None or type(field) is not HallSpline:
        return None
    reference, shift = field.reference_distance_m, field.distance_shift_m
    quiescent, sensitivity = sensor.quiescent_V, sensor.sensitivity_V_per_T
    field_of = field.spline.in_floats(((0, 0),))

    def look(columns: Columns) -> list[float]:
        u = [reference / (d + shift) for d in columns[0]]
        volts = [quiescent + sensitivity * value for (value,) in field_of(u, columns[2])]
        return volts if len(columns) == 3 else list(map(add, volts, columns[3]))

    return look
