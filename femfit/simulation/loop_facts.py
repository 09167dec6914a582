"""The numbers that are said of a closed loop, by one loop and by a study of many: its design and its margins."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from math import isfinite
from typing import Any

import numpy as np

from femfit.core.errors import DomainError, FilterError
from femfit.core.files import json_ready
from femfit.simulation.blind import BlindBound, blind_bound
from femfit.simulation.constants import LESS_NOISE, NEARLY, WANTED_MODULUS
from femfit.simulation.controllers import ControllerName
from femfit.simulation.design import LoopDesign, keeping_margins
from femfit.simulation.margins import Margins, worst_of
from femfit.simulation.study_rows import HoldRow


@dataclass(frozen=True)
class JudgedLoop:
    """A linear loop at its worst point of rest."""

    controller: ControllerName
    observer: str
    margins: Margins | None  # None where there are none
    refusal: str = ""  # Why there are none
    # Where the margins are thin: what no controller with this sensor passes, where that is less than what is aimed at
    bound: BlindBound | None = None
    # And what the same controller, designed anew, keeps without one of what may take margins, the best first
    raised: tuple[tuple[str, Margins], ...] = ()


def judged_loop(design: LoopDesign, name: ControllerName, observer: str) -> JudgedLoop:
    """The margins of a loop; where they are thin, what takes them."""
    try:
        worst = worst_of(design.margins(name, observer))  # type: ignore[arg-type]
    except (DomainError, FilterError) as error:
        return JudgedLoop(name, observer, None, str(error))
    if not worst.thin:
        return JudgedLoop(name, observer, worst)
    bound = blind_bound(design.bench("ekf"))
    quieter = replace(design, noise={sensor: LESS_NOISE * white for sensor, white in design.noise.items()})
    ways = {"less-noise": (keeping_margins(quieter), observer), "exact-state": (design, "exact")}
    if observer.endswith("4"):
        ways["known-offset"] = design, observer[:-1]
    if design.latency:
        ways["no-latency"] = keeping_margins(replace(design, latency=0)), observer
    raised = []
    for way, (better, by) in ways.items():
        try:
            margins = worst_of(better.margins(name, by))  # type: ignore[arg-type]
        except (DomainError, FilterError):
            continue
        if margins.stable and NEARLY * margins.kept > worst.kept:
            raised.append((way, margins))
    raised.sort(key=lambda pair: pair[1].kept, reverse=True)
    within = bound if bound is not None and bound.modulus < WANTED_MODULUS else None
    return JudgedLoop(name, observer, worst, bound=within, raised=tuple(raised))


def consistency(holds: Sequence[HoldRow]) -> dict[str, int]:
    """How many filters' predictions are as wrong as they expect: inside of their 95 % band, below and above it."""
    judged = [row for row in holds if isfinite(row.normalised_innovation_squared)]
    below = sum(row.normalised_innovation_squared < row.innovation_band.lower for row in judged)
    above = sum(row.normalised_innovation_squared > row.innovation_band.upper for row in judged)
    return {"inside": len(judged) - below - above, "below": below, "above": above}


_OF_BACKSTEPPING = {
    "position_gain_1_s2": "position_gain",
    "velocity_gain_1_s": "velocity_gain",
    "current_gain_ohm": "current_gain_ohm",
}
_OF_POINT = ("distance_m", "currents_A", "commands", "unstable_pole_rad_s", "coil_pole_rad_s")


def design_data(design: LoopDesign, loops: Sequence[tuple[ControllerName, str]] = ()) -> dict[str, Any]:
    """Reference, gains, margins and operating points, ready for JSON."""
    backstepping = design.controller("backstepping")
    pid, feedback = (None if design.why_no(name) else design.controller(name) for name in ("pid", "state-feedback"))
    margins = {loop: worst_of(design.margins(*loop)) for loop in loops}  # type: ignore[arg-type]
    return {
        "sensors": list(design.sensors),
        "noise": dict(design.noise),
        "latency_samples": design.latency,
        "targets_m": list(design.targets_m),
        "reference_rate_rad_s": design.reference_rate_rad_s,
        "backstepping": {key: getattr(backstepping, name) for key, name in _OF_BACKSTEPPING.items()},
        "pid": pid and {**pid.parts, **{name: json_ready(getattr(pid, name)) for name in ("filter_pole", "gains")}},
        "no_pid": design.why_no("pid"),
        "state_feedback": feedback and {name: getattr(feedback, name).tolist() for name in ("gains", "integral")},
        "no_state_feedback": design.why_no("state-feedback"),
        "margins": [
            {"controller": name, "observer": observer, **json_ready(asdict(worst))}
            for (name, observer), worst in margins.items()
        ],
        "points": [{name: np.array(getattr(point, name)).tolist() for name in _OF_POINT} for point in design.points],
    }
