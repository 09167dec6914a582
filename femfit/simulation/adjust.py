"""A design with gains of one's own: single ones, or a bandwidth.

Which controller a loop has where none is asked for: the one whose linear loop is farthest from instability.

Every controller is designed, since that takes seconds. Of those that are stable
with their filter, delays and drivers the one with the largest margins at its worst point of rest is taken, cut where
noise takes too much of the commands' room.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from femfit.core.errors import DomainError, FilterError
from femfit.simulation.controllers import Controller, ControllerName, design_backstepping
from femfit.simulation.design import CONTROLLERS, LoopDesign, ObserverName
from femfit.simulation.margins import Margins, worst_of
from femfit.simulation.state_feedback import regulator
from femfit.simulation.tune import design_pid


def adjusted(
    design: LoopDesign,
    name: ControllerName,
    *,
    gains: Mapping[str, float] | None = None,
    bandwidth_rad_s: float | None = None,
) -> LoopDesign:
    """The design with another controller of this name; as it is where nothing is given.

    Parameters
    ----------
    gains : mapping of str to float or None
        In place of the designed ones: kp, ki, kd, filter_rad_s of a PID; position, velocity, current of backstepping;
        distance, velocity, integral, and current or current_NAME of state feedback.
    bandwidth_rad_s : float or None
        The poles' radius for which the controller is designed.

    Raises
    ------
    DomainError
        If a gain is unknown or a bandwidth is not above zero.
    """
    if bandwidth_rad_s is None and not gains:
        return design
    bench = design.bench("exact")
    point, plant = bench.points[bench.middle], bench.plants[bench.middle]
    if bandwidth_rad_s is None:
        controller: Controller = design.controller(name)
    elif not 0.0 < bandwidth_rad_s < np.pi / design.model.sample_time_s:
        raise DomainError(
            f"A bandwidth must be > 0 rad/s and below half of the sampling, {np.pi / design.model.sample_time_s:.4g} "
            f"rad/s; instead received {bandwidth_rad_s:g}."
        )
    elif name == "state-feedback":
        controller = regulator(design.model, point, plant, bandwidth_rad_s, design.latency)
    elif name == "pid":
        controller = design_pid(design.model, point, bandwidth_rad_s)
    else:
        controller = design_backstepping(design.model, design.points, bandwidth_rad_s)
    if wrong := [gain for gain in gains or () if gain not in controller.parts]:
        raise DomainError(
            f"The gains of this controller are {', '.join(controller.parts)}; instead received {', '.join(wrong)}. "
            "Name one of them, as in kp=2000."
        )
    if bad := [gain for gain, value in (gains or {}).items() if not np.isfinite(value)]:
        raise DomainError(f"Gains must be finite; instead received {', '.join(bad)}.")
    return replace(design, given={**design.given, name: controller.with_parts(gains) if gains else controller})


def choose(design: LoopDesign, observer: ObserverName) -> dict[ControllerName, Margins]:
    """Design all controllers: their margins, the best first, stable ones before those that grow.

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

    def rank(name: ControllerName) -> tuple[bool, float, float, float]:
        worst = margins[name]
        return worst.stable, worst.kept, worst.modulus, worst.slowest_pole_rad_s

    return {name: margins[name] for name in sorted(margins, key=rank, reverse=True)}
