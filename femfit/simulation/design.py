"""What a closed loop of a model needs: reference distances, sensors, observers, controllers, derived from the model."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal, TypeAlias, cast, get_args

import numpy as np

from femfit.core.errors import DomainError, FilterError
from femfit.core.numerics import FloatArray
from femfit.core.public import require_known
from femfit.core.results import remembered
from femfit.estimate.filter import Filter
from femfit.estimate.kalman_filter import MOST_DELAYED_SAMPLES, FilterKind, chosen_sensors, kalman_filter
from femfit.estimate.noise import FIRST_DEVIATION_M, FilterNoise, default_noise
from femfit.model.actuator_model import ActuatorModel
from femfit.model.sensors import HALL
from femfit.simulation.constants import COMMAND_ERRORS, DESIGN_POINTS, LEAST_SAMPLES, LONGEST_STAY_S, NEARLY
from femfit.simulation.controllers import Controller, ControllerName
from femfit.simulation.linear_loop import Rest
from femfit.simulation.margins import Margins, worst_of
from femfit.simulation.observers import DirectObserver, distance_inverse
from femfit.simulation.operating_point import OperatingPoint, operating_point
from femfit.simulation.plant import LoopSensor, loop_sensors, sensor_noise
from femfit.simulation.targets import covered, derived_targets, reference_rate, require_sensed
from femfit.simulation.tune import SEARCH_FREQUENCIES, Bench, near_the_best
from femfit.simulation.words import sentence

ObserverName = Literal["direct", "ukf", "ekf", "ukf4", "ekf4"]

LoopObserver: TypeAlias = ObserverName | Literal["exact"]
"""A linear loop may know the state itself, too."""

CONTROLLERS: tuple[ControllerName, ...] = get_args(ControllerName)
OBSERVERS: tuple[ObserverName, ...] = get_args(ObserverName)


@dataclass(frozen=True)
class JudgedLoop:
    """A linear loop at its worst point of rest."""

    controller: ControllerName
    observer: str
    margins: Margins | None  # None where there are none
    refusal: str = ""  # Why there are none


@dataclass(frozen=True, eq=False)
class LoopDesign:
    """Reference, sensors, controllers and noise of one model's closed loop."""

    # With circuits, motion and sensors; the drivers' limits within what the swept currents cover
    model: ActuatorModel
    sensors: tuple[str, ...]  # Those that the loop reads, in the order of the measurement's entries
    noise: Mapping[str, float]  # White, of one sample, in the sensors and as the filters know it
    targets_m: tuple[float, ...]
    points: tuple[OperatingPoint, ...]  # From the smallest to the largest of them
    reference_rate_rad_s: float
    latency: int = 0  # Samples from a reading to the command that it leads to
    given: Mapping[str, Controller] = field(default_factory=dict)  # In place of the designed ones
    command_error: float = 1.0  # Factor on the error of the drivers' voltages that the filters allow for

    @property
    def command_unit(self) -> str:
        """Of the first circuit's command."""
        return "A" if self.model.circuits[0].drive.kind == "current" else "V"

    @property
    def rate_rad_s(self) -> float:
        """How fast the body moves on by itself, at the slowest point: it sets how long filter and loop need to settle.

        The unstable pole, or where the body is stable its natural frequency and the reference's rate at least.
        """
        rates = [p.unstable_pole_rad_s or max(p.natural_rad_s, self.reference_rate_rad_s) for p in self.points]
        return min(rates)

    @property
    def step_s(self) -> float:
        """Time in s for a step of the reference, and for loop and filter to settle after it."""
        return 7.0 / self.reference_rate_rad_s + 4.0 / self.rate_rad_s

    @property
    def stay_s(self) -> float:
        """Time in s at each reference distance where none is asked for."""
        return min(LONGEST_STAY_S, max(self.step_s, LEAST_SAMPLES * self.model.sample_time_s))

    @cached_property
    def why_no_direct(self) -> str:
        """Why the first sensor's reading cannot be inverted to a distance, which no filter needs; empty if it can."""
        try:
            distance_inverse(self.model, self.sensors[0])
        except FilterError as error:
            return str(error)
        return ""

    def steps(self, time_constants: float) -> int:
        """Samples in so many of the body's time constants."""
        return int(np.ceil(time_constants / self.rate_rad_s / self.model.sample_time_s))

    def loop_sensors(self, model: ActuatorModel | None = None) -> tuple[LoopSensor, ...]:
        """The sensors of the design's model, or those of the same names of another one."""
        return loop_sensors(self.model if model is None else model, self.noise, self.model.sample_time_s)

    @property
    def delay_s(self) -> float:
        """Longest time in s from the body to the command that answers it, without the samples themselves."""
        latest_s = max(sensor.reading.delay_s for sensor in self.loop_sensors())
        return latest_s + self.latency * self.model.sample_time_s

    @property
    def reads_slowly(self) -> bool:
        """Whether a sensor is not read at each sample."""
        return any(sensor.period > 1 for sensor in self.loop_sensors())

    @remembered
    def controller(self, name: ControllerName) -> Controller:
        """The controller that is given or designed, which is what comes nearest to a stable one."""
        return self.given.get(name) or self._filtered.tuned(name)

    @remembered
    def why_no(self, name: ControllerName) -> str:
        """Why no stable controller of this name was found; empty where there is one, or where gains are given."""
        try:
            fit = name in self.given or worst_of(self._filtered.judge(self.controller(name), SEARCH_FREQUENCIES)).stable
        except DomainError as error:
            return str(error)
        return "" if fit else sentence("loop", "none_stable", self, name)

    @property
    def controllers(self) -> tuple[ControllerName, ...]:
        """The names of the controllers that keep the body at rest, as far as the linear loop tells."""
        return tuple(name for name in CONTROLLERS if not self.why_no(name))

    @cached_property
    def _filtered(self) -> Bench:
        """With a filter in the loop; with the exact state where the samples are too slow for the filter's coil.

        A filter that estimates a bias as well passes on more noise, which must find room too; where the readings do not
        tell the bias there is no such filter.
        """
        try:
            bench = self.bench("ekf")
        except FilterError:
            return self.bench("exact")
        try:
            return replace(bench, noisier=self.bench("ekf4"))
        except (DomainError, FilterError):
            return bench

    @remembered
    def bench(self, observer: LoopObserver) -> Bench:
        """What linear controllers are judged in: at the nearest, the middle and the farthest point."""
        seen_by, sensors = None if observer == "exact" else self.observer(observer), self.loop_sensors()
        places = [self.points[k] for k in sorted({0, len(self.points) // 2, len(self.points) - 1})]
        rests = tuple(Rest.at(self.model, point, sensors, seen_by) for point in places)
        return Bench(self.model, self.points, rests, self.latency)

    def margins(self, name: ControllerName, observer: LoopObserver) -> tuple[Margins, ...]:
        """Stability margins of a loop at the nearest, the middle and the farthest point."""
        return self.bench(observer).judge(self.controller(name))

    @remembered
    def judged(self, name: ControllerName, observer: LoopObserver) -> JudgedLoop:
        """The least margins of a loop, or why there are none."""
        try:
            return JudgedLoop(name, observer, worst_of(self.margins(name, observer)))
        except (DomainError, FilterError) as error:
            return JudgedLoop(name, observer, None, str(error))

    @property
    def filter_noise(self) -> FilterNoise:
        """What the filters know of the noise."""
        base = default_noise(self.model, self.targets_m[0])
        volts = np.atleast_1d(base.voltage_V) * self.command_error
        white = {sensor.name: sensor.reading.white for sensor in self.loop_sensors()}
        hall = white.pop(HALL, base.hall_V)
        return replace(
            base, voltage_V=tuple(volts.tolist()) if len(volts) > 1 else float(volts[0]), hall_V=hall, sensors=white
        )

    def observer(self, name: ObserverName) -> Filter | DirectObserver:
        """The observer of this name: a filter for the sensors, or the direct measurement by the first of them.

        The filters whose names end in 4 estimate the first sensor's bias as a state more.
        """
        if name == "direct":
            return DirectObserver(self.model, self.sensors[0])
        return kalman_filter(
            self.model,
            cast("FilterKind", name.removesuffix("4")),
            sensors=self.sensors,
            biases=self.sensors[:1] if name.endswith("4") else (),
            noise=self.filter_noise,
            distance=self.targets_m[0],
            first_deviation_m=FIRST_DEVIATION_M,
            commanded=True,
        )


def design_loop(
    model: ActuatorModel,
    noise: Mapping[str, float] | float | None = None,
    *,
    sensors: Sequence[str] | None = None,
    latency: int = 0,
) -> LoopDesign:
    """Derive everything that a closed loop needs.

    Parameters
    ----------
    noise : mapping of str to float, float or None
        White noise of one sample by the name of a sensor, in its unit, or that of the first; the model's own, or a part
        of the range where it has none.
    sensors : sequence of str or None
        Which sensors the loop reads; the Hall element, or all where there is none.
    latency : int
        Samples from a reading to the command that it leads to.
    """
    if not isinstance(latency, int | np.integer) or not 0 <= latency <= MOST_DELAYED_SAMPLES:
        raise DomainError(
            f"latency must be a whole number of samples, at most {MOST_DELAYED_SAMPLES} as in a filter; instead "
            f"received latency={latency!r}. Where commands take longer, make the model's sample time longer."
        )
    if not model.circuits:
        model.require_circuit()
    model.require_motion()
    names = chosen_sensors(model, sensors)
    white = sensor_noise(model, names, noise)
    model = covered(model)
    targets = model.reference_distances_m or derived_targets(model, names)
    distances: FloatArray = np.linspace(min(targets), max(targets), DESIGN_POINTS)
    points = tuple(operating_point(model, float(d)) for d in distances)
    require_sensed(model, names, distances, np.array([point.currents_A for point in points]))
    design = LoopDesign(
        model=model,
        sensors=names,
        noise=white,
        targets_m=targets,
        points=points,
        reference_rate_rad_s=reference_rate(model, targets),
        latency=latency,
    )
    return keeping_margins(design)


def keeping_margins(design: LoopDesign) -> LoopDesign:
    """The design whose filters allow for the least error of the commands that keeps the loop's margins.

    Backstepping tells it, whose gains a bandwidth decides. No filter gives more than the state itself would, so that
    one that comes near to it is enough.
    """
    design = replace(design, command_error=1.0)

    def score(tried: LoopDesign, observer: LoopObserver = "ekf") -> float:
        bench = tried.bench(observer)
        return bench.score(bench.tuned("backstepping"))

    try:
        tried = [(score(design), design)]
        most = min(1.0, NEARLY * score(design, "exact")) if tried[0][0] > 0.0 else 0.0
        for factor in COMMAND_ERRORS if most > 0.0 else ():
            if tried[-1][0] >= most:
                break
            cautious = replace(design, command_error=factor)
            tried.append((score(cautious), cautious))
    except (DomainError, FilterError):  # whose controllers say why there is none
        return design
    return near_the_best(tried)


def adjusted(
    design: LoopDesign,
    name: ControllerName,
    *,
    gains: Mapping[str, float] | None = None,
    bandwidth_rad_s: float | None = None,
) -> LoopDesign:
    """The design with a controller of one's own of this name; as it is where nothing is given.

    Parameters
    ----------
    gains : mapping of str to float or None
        In place of the designed ones: kp, ki, kd, filter_rad_s of a PID; position, velocity, current of backstepping;
        distance, velocity, integral, and current or current_NAME of state feedback.
    bandwidth_rad_s : float or None
        The poles' radius for which the controller is designed.

    Raises
    ------
    UsageError
        If the controller has no such gain.
    DomainError
        If a gain is not finite or a bandwidth is not above zero.
    """
    if bandwidth_rad_s is None and not gains:
        return design
    highest = np.pi / design.model.sample_time_s
    if bandwidth_rad_s is not None and not 0.0 < bandwidth_rad_s < highest:
        raise DomainError(
            f"A bandwidth must be > 0 rad/s and below half of the sampling, {highest:.4g} rad/s; instead received "
            f"{bandwidth_rad_s:g}."
        )
    if bandwidth_rad_s is None:
        controller = design.controller(name)
    else:
        controller = design.bench("exact").designed(name, bandwidth_rad_s)
    require_known("A gain of this controller", gains or (), controller.parts)
    if bad := [gain for gain, value in (gains or {}).items() if not np.isfinite(value)]:
        raise DomainError(f"Gains must be finite; instead received {', '.join(bad)}.")
    return replace(design, given={**design.given, name: controller.with_parts(gains) if gains else controller})
