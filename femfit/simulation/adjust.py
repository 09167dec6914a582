"""A design with gains of one's own: single ones, a bandwidth, or the poles of the loop.

Which controller a loop has where none is asked for: the one whose linear loop is farthest from instability.

Every controller is designed, since that takes seconds. Of those that are stable
with their filter, delays and drivers the one with the largest margins at its worst point of rest is taken, cut where
noise takes too much of the commands' room.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import degrees
from typing import Any

import numpy as np

from femfit.core.errors import DomainError, FilterError
from femfit.simulation.constants import NOISE_ROOM
from femfit.simulation.controllers import Backstepping, Controller, Pid, design_backstepping, pid_of_parts
from femfit.simulation.design import CONTROLLERS, ControllerName, LoopDesign, ObserverName
from femfit.simulation.margins import Margins, worst_of
from femfit.simulation.state_feedback import StateFeedback, placed, regulator
from femfit.simulation.tune import design_pid


def adjusted(
    design: LoopDesign,
    name: ControllerName,
    *,
    gains: Mapping[str, float] | None = None,
    bandwidth_rad_s: float | None = None,
    poles_rad_s: Sequence[complex] | None = None,
) -> LoopDesign:
    """The design with another controller of this name; as it is where nothing is given.

    Parameters
    ----------
    gains : mapping of str to float or None
        In place of the designed ones: kp, ki, kd, filter_rad_s of a PID; position, velocity, current of backstepping;
        distance, velocity, integral, and current or current_NAME of state feedback.
    bandwidth_rad_s : float or None
        The poles' radius for which the controller is designed.
    poles_rad_s : sequence of complex or None
        Of state feedback with one command: for distance, velocity, current and integral.

    Raises
    ------
    DomainError
        If a gain is unknown, a bandwidth is not above zero, or poles are given to another controller.
    """
    controller = _of_poles(design, name, poles_rad_s) or _of_bandwidth(design, name, bandwidth_rad_s)
    if controller is None and not gains:
        return design
    controller = controller or design.controller(name)
    if gains:
        controller = _with(design, controller, gains)
    return replace(design, given={**design.given, name: controller})


def _of_poles(design: LoopDesign, name: ControllerName, poles: Sequence[complex] | None) -> Controller | None:
    if poles is None:
        return None
    if name != "state-feedback":
        raise DomainError(f"Poles are given for state feedback; instead received them for {name}. Give a bandwidth.")
    bench = design.bench("exact")
    point, plant = bench.points[bench.middle], bench.plants[bench.middle]
    return placed(design.model, point, plant, poles, design.latency)


def _of_bandwidth(design: LoopDesign, name: ControllerName, bandwidth: float | None) -> Controller | None:
    if bandwidth is None:
        return None
    if not 0.0 < bandwidth < np.pi / design.model.sample_time_s:
        raise DomainError(
            f"A bandwidth must be > 0 rad/s and below half of the sampling, {np.pi / design.model.sample_time_s:.4g} "
            f"rad/s; instead received {bandwidth:g}."
        )
    bench = design.bench("exact")
    point, plant = bench.points[bench.middle], bench.plants[bench.middle]
    if name == "state-feedback":
        return regulator(design.model, point, plant, bandwidth, design.latency)
    if name == "pid":
        return design_pid(design.model, point, bandwidth)
    return design_backstepping(design.model, design.points, bandwidth)


def _with(design: LoopDesign, controller: Controller, gains: Mapping[str, float]) -> Controller:
    gains_now = gains_of(design, controller)
    if wrong := [name for name in gains if name not in gains_now]:
        raise DomainError(
            f"The gains of this controller are {', '.join(gains_now)}; instead received {', '.join(wrong)}. Name one "
            "of them, as in kp=2000."
        )
    if bad := [name for name, value in gains.items() if not np.isfinite(value)]:
        raise DomainError(f"Gains must be finite; instead received {', '.join(bad)}.")
    values = {**gains_now, **gains}
    if isinstance(controller, Pid):
        return pid_of_parts(design.model, **values, direction=controller.direction)
    if isinstance(controller, Backstepping):
        outer: dict[str, Any] = {"position_gain": values["position"], "velocity_gain": values["velocity"]}
        return replace(controller, **outer, current_gain_ohm=values.get("current", controller.current_gain_ohm))
    assert isinstance(controller, StateFeedback)  # noqa: S101  the only other kind
    along = _along(design)
    feedback, integral = controller.gains.copy(), controller.integral.copy()
    for name, value in gains.items():
        if name == "distance":
            feedback[:, 0] = -value * along
        elif name == "velocity":
            feedback[:, 1] = -value * along
        elif name == "integral":
            integral = -value * along
        else:
            k = _current_names(design).index(name)
            feedback[k, 2 + k] = value
    return replace(controller, gains=feedback, integral=integral)


def gains_of(design: LoopDesign, controller: Controller) -> dict[str, float]:
    """Gains by the names that :func:`adjusted` takes, positive where they bring the body back."""
    if isinstance(controller, Pid):
        return controller.parts
    if isinstance(controller, Backstepping):
        outer = {"position": controller.position_gain, "velocity": controller.velocity_gain}
        amplified = all(circuit.drive.kind == "current" for circuit in design.model.circuits)
        return outer if amplified else {**outer, "current": controller.current_gain_ohm}
    assert isinstance(controller, StateFeedback)  # noqa: S101  the only other kind
    along = _along(design)
    first = int(np.argmax(np.abs(along)))
    matrix = controller.gains
    return {
        "distance": -float(matrix[first, 0] / along[first]),
        "velocity": -float(matrix[first, 1] / along[first]),
        **{name: float(matrix[k, 2 + k]) for k, name in enumerate(_current_names(design))},
        "integral": -float(controller.integral[first] / along[first]),
    }


def _along(design: LoopDesign) -> np.ndarray[Any, np.dtype[np.float64]]:
    return design.points[len(design.points) // 2].direction


def _current_names(design: LoopDesign) -> list[str]:
    names = design.model.circuit_names
    return ["current"] if len(names) == 1 else [f"current_{name}" for name in names]


@dataclass(frozen=True)
class Choice:
    """The controller taken and the margins of all that were designed, the best first."""

    observer: ObserverName
    margins: Mapping[ControllerName, Margins]

    @property
    def controller(self) -> ControllerName:
        """The one that is taken."""
        return next(iter(self.margins))

    def text(self, lost: Sequence[str] = ()) -> str:
        """A line for the first controller that is not among those with which runs were lost."""
        taken = next(name for name in self.margins if name not in lost)
        first, *rivals = [_standing(name, margins) for name, margins in self.margins.items()]
        why = (
            "its linear loop keeps the largest margins of phase and modulus"
            if self.margins[taken].stable
            else "it grows least"
        )
        if lost:
            why = f"runs are lost with {' and '.join(lost)}, whose linear loop keeps larger margins"
        return f"{taken} is chosen on {self.observer}, as {why}: {', '.join((first, *rivals))}"


def choose(design: LoopDesign, observer: ObserverName) -> Choice:
    """Design all controllers and order them.

    Raises
    ------
    DomainError
        If no controller can be designed at all.
    """
    margins: dict[ControllerName, Margins] = {}
    reasons = []
    for name in CONTROLLERS:
        try:
            margins[name] = worst_of(design.margins(name, observer))
        except (DomainError, FilterError) as error:
            reasons.append(str(error))
    if not margins:
        raise DomainError(" ".join(dict.fromkeys(reasons)))
    return Choice(observer, dict(sorted(margins.items(), key=lambda item: _rank(item[1]), reverse=True)))


def _rank(margins: Margins) -> tuple[bool, float, float, float]:
    """Stable before unstable; then the margins, or the slower growth."""
    return margins.stable, margins.kept, margins.modulus, margins.slowest_pole_rad_s


def _standing(name: str, margins: Margins) -> str:
    if not margins.stable:
        return f"{name} unstable, growing by {-margins.slowest_pole_rad_s:.3g} 1/s"
    noisy = f" with noise of {100.0 * margins.noise_share:.2g} %" if margins.noise_share > NOISE_ROOM else ""
    return f"{name} {degrees(margins.phase_rad):.2g} degrees and {margins.modulus:.2g}{noisy}"
