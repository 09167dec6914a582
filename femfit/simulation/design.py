"""What a closed loop of a model needs: reference distances, controllers, filters, all derived from the model."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, NoReturn, cast, get_args

import numpy as np

from femfit.core.arrays import BoolArray, FloatArray
from femfit.core.errors import DomainError, FilterError
from femfit.filters.constants import FIRST_DEVIATION_M
from femfit.filters.direct import hall_inverse
from femfit.filters.kalman_filter import FilterKind, kalman_filter
from femfit.filters.noise import default_noise
from femfit.model.actuator_model import ActuatorModel
from femfit.model.circuit import Circuit
from femfit.model.hall_sensor import HallSensor
from femfit.simulation.constants import COVERED_PART, DESIGN_POINTS, UNKNOWN_NOISE_PART
from femfit.simulation.controllers import Backstepping, Controller, Pid, design_backstepping, design_pid
from femfit.simulation.observers import DirectObserver, Observer
from femfit.simulation.operating_point import OperatingPoint, current_for_force, current_range, operating_point
from femfit.simulation.reference import reference_rate

ControllerName = Literal["backstepping", "pid"]
ObserverName = Literal["direct", "ukf", "ekf", "ukf4", "ekf4"]

CONTROLLERS: tuple[ControllerName, ...] = get_args(ControllerName)
OBSERVERS: tuple[ObserverName, ...] = get_args(ObserverName)


@dataclass(frozen=True, eq=False)
class LoopDesign:
    """Reference, controllers and noise of one model's closed loop."""

    # With circuit, motion and sensor; the driver's voltages within what the swept currents cover
    model: ActuatorModel
    targets_m: tuple[float, ...]
    points: tuple[OperatingPoint, ...]  # From the smallest to the largest of them
    backstepping: Backstepping
    pid: Pid | None  # Designed for the middle one; None where there is none for it
    reference_rate_rad_s: float
    noise_V: float  # White noise of a Hall sample, in the sensor and as the filters know it
    why_no_pid: str = ""  # Why there is no PID controller; empty where there is one

    @property
    def slowest_pole_rad_s(self) -> float:
        """The smallest unstable pole of the points: it sets how long filter and loop need to settle."""
        return min(point.unstable_pole_rad_s for point in self.points)

    @cached_property
    def why_no_direct(self) -> str:
        """Why the Hall voltage cannot be inverted to a distance, which no filter needs; empty where it can."""
        try:
            hall_inverse(self.model)
        except FilterError as error:
            return str(error)
        return ""

    def steps(self, time_constants: float) -> int:
        """Samples in so many time constants of the slowest unstable pole."""
        return int(np.ceil(time_constants / self.slowest_pole_rad_s / self.model.sample_time_s))

    def controller(self, name: ControllerName) -> Controller:
        """The controller of this name."""
        if name == "backstepping":
            return self.backstepping
        if self.pid is None:
            raise DomainError(self.why_no_pid)
        return self.pid

    @property
    def controllers(self) -> tuple[ControllerName, ...]:
        """The names of the controllers that there are."""
        return CONTROLLERS if self.pid is not None else tuple(name for name in CONTROLLERS if name != "pid")

    def observer(self, name: ObserverName, distance_deviation_m: float = FIRST_DEVIATION_M) -> Observer:
        """The observer of this name: a filter for the Hall voltage, or the direct measurement."""
        if name == "direct":
            return DirectObserver(hall_inverse(self.model))
        return kalman_filter(
            self.model,
            cast("FilterKind", name.removesuffix("4")),
            hall_bias=name.endswith("4"),
            noise=default_noise(self.model, self.targets_m[0], self.noise_V),
            distance=self.targets_m[0],
            first_deviation_m=distance_deviation_m,
        )


def design_loop(model: ActuatorModel, noise_V: float | None = None) -> LoopDesign:
    """Derive everything that a closed loop needs.

    Parameters
    ----------
    noise_V : float or None
        White noise of a Hall sample; None: the model's own, or a part of the output's range where it has none.
    """
    if noise_V is not None and not 0.0 <= noise_V < np.inf:
        raise DomainError(
            f"The noise of a Hall sample must be >= 0 V; instead received {noise_V:g} V. Leave it out for the model's."
        )
    model.require_circuit()
    model.require_motion()
    sensor = model.require_sensor()
    model = replace(model, circuit=_covered(model))
    targets = model.reference_distances_m or _derived_targets(model)
    points = tuple(operating_point(model, float(d)) for d in np.linspace(min(targets), max(targets), DESIGN_POINTS))
    stable = [point.distance_m for point in points if point.unstable_pole_rad_s == 0.0]
    if stable:
        raise DomainError(
            f"Model {model.name!r} must have a force that falls with the distance where it holds its body; at "
            f"{1e3 * stable[0]:g} mm it grows, so that the body needs no controller there. Choose other reference "
            "distances."
        )
    _require_sensed(model, np.array([p.distance_m for p in points]), np.array([p.current_A for p in points]))
    pid, why_no_pid = _pid_or_why(model, points[len(points) // 2])
    return LoopDesign(
        model=model,
        targets_m=targets,
        points=points,
        backstepping=design_backstepping(model, points),
        pid=pid,
        reference_rate_rad_s=reference_rate(model, targets),
        noise_V=_hall_noise(sensor) if noise_V is None else noise_V,
        why_no_pid=why_no_pid,
    )


def _hall_noise(sensor: HallSensor) -> float:
    return sensor.noise_V or UNKNOWN_NOISE_PART * (sensor.output_max_V - sensor.output_min_V)


def _pid_or_why(model: ActuatorModel, point: OperatingPoint) -> tuple[Pid | None, str]:
    """The PID controller, or why a body and coil like these have none: other controllers may hold it all the same."""
    try:
        return design_pid(model, point), ""
    except DomainError as error:
        return None, str(error)


def _covered(model: ActuatorModel) -> Circuit:
    """The circuit with voltages whose currents the model covers: a stronger driver would leave it at once."""
    circuit, box = model.require_circuit(), model.validity
    lowest, highest = (COVERED_PART * circuit.resistance_ohm * i for i in (box.current_min_A, box.current_max_A))
    # A driver that cannot give negative currents is not limited by a sweep that begins at zero.
    lowest = lowest if lowest < 0.0 else -np.inf
    highest = highest if highest > 0.0 else np.inf
    return replace(
        circuit,
        voltage_min_V=max(circuit.voltage_min_V, lowest),
        voltage_max_V=min(circuit.voltage_max_V, highest),
    )


def _derived_targets(model: ActuatorModel) -> tuple[float, ...]:
    """Steps over the middle 40 % of the distances at which the driver holds the body and the Hall element sees it."""
    box, motion = model.validity, model.require_motion()
    low, high = current_range(model)
    d = np.linspace(box.distance_min_m, box.distance_max_m, 301)
    needed = motion.static_force(d)
    weakest, strongest = model.magnetics.force(d, np.asarray(low)), model.magnetics.force(d, np.asarray(high))
    holdable = d[(weakest <= needed) & (strongest >= needed)]
    if holdable.size < 3:
        _refuse_to_hold(model, d, weakest, strongest)
    current = current_for_force(model, holdable, motion.static_force(holdable))
    seen = holdable[_sensed(model, holdable, current)]
    if seen.size < 3:
        _require_sensed(model, holdable, current)
    near, far = float(seen[0]), float(seen[-1])
    return near + 0.3 * (far - near), near + 0.7 * (far - near), near + 0.3 * (far - near)


def _refuse_to_hold(model: ActuatorModel, d: FloatArray, weakest: FloatArray, strongest: FloatArray) -> NoReturn:
    motion, (low, high) = model.require_motion(), current_range(model)
    needed = motion.static_force(d)
    repelled = d[(weakest >= needed) & (strongest <= needed)]
    if repelled.size:
        raise DomainError(
            f"A positive current must attract the body of model {model.name!r}; at {1e3 * repelled[0]:.4g} mm its "
            f"force falls as the current grows from {low:.3g} to {high:.3g} A. Turn the magnet's magnetization around "
            "in the actuator file, which is the same as reversing the coil's leads."
        )
    forces = np.concatenate([weakest, strongest])
    raise DomainError(
        f"Model {model.name!r} cannot hold its body of {1e3 * motion.mass_kg:g} g anywhere in {1e3 * d[0]:g}.."
        f"{1e3 * d[-1]:g} mm: {_range_mN(needed)}, and with {low:.3g}..{high:.3g} A the force is "
        f"{1e3 * forces.min():.4g}..{1e3 * forces.max():.4g} mN. It is not an actuator that levitates this body; "
        "change mass or supply to simulate one that is."
    )


def _range_mN(needed: FloatArray) -> str:  # noqa: N802  the unit
    """What it takes to hold the body, in words."""
    low, high = 1e3 * needed.min(), 1e3 * needed.max()
    return (
        f"the weight is {low:.4g} mN" if low == high else f"weight, springs and load ask for {low:.4g}..{high:.4g} mN"
    )


def _sensed(model: ActuatorModel, distance: FloatArray, current: FloatArray) -> BoolArray:
    sensor = model.require_sensor()
    voltage = sensor.voltage(distance, current)
    return np.asarray((voltage > sensor.output_min_V) & (voltage < sensor.output_max_V))


def _require_sensed(model: ActuatorModel, distance: FloatArray, current: FloatArray) -> None:
    """Refuse points of rest at which the Hall element gives the end of its range, whatever the distance."""
    blind = ~_sensed(model, distance, current)
    if np.any(blind):
        sensor = model.require_sensor()
        field = sensor.field.field(distance[blind], current[blind])
        strongest = int(np.argmax(np.abs(field)))
        raise DomainError(
            f"The Hall element of model {model.name!r} must stay within its output range of {sensor.output_min_V:g}.."
            f"{sensor.output_max_V:g} V where the body is held; {1e3 * field[strongest]:.4g} mT at "
            f"{1e3 * distance[blind][strongest]:.4g} mm and {sensor.sensitivity_V_per_T:g} V/T ask for "
            f"{sensor.quiescent_V + sensor.sensitivity_V_per_T * field[strongest]:.4g} V. Give [hall] a smaller "
            "sensitivity_V_per_T, or move the element."
        )
