"""Why a loop was lost: what was asked for, the loop itself, or what sensors and driver can do, in numbers.

The lost runs are repeated on the same noise without what was asked for: another plant, faults, gains, latency. Where
they are lost all the same, the linear loop about its rest comes before all that a driver or a sensor could do: an
unstable loop swings until its commands reach the driver's limits, so that a lost run looks like a weak driver. Of a
stable one the numbers of the hardware tell the cause: the noise in the command against its room, and the distances from
which the force at the driver's limits brings the body back.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from femfit.core.errors import DomainError, FilterError
from femfit.core.files import json_ready
from femfit.simulation.allocation import force_range, limits_of
from femfit.simulation.constants import NOISE_FILLS
from femfit.simulation.design import keeping_margins
from femfit.simulation.experiment import Experiment, LoopRuns
from femfit.simulation.loop import LoopResult
from femfit.simulation.tune import SEARCH_FREQUENCIES

BEYOND, FOLLOWED = 1.5, 20.0
"""Conventional: a trial is followed for so many times the time of the last loss, and so many of the body's time
constants more: a loop that drifts away a fifth as fast as the body is lost by then."""


@dataclass(frozen=True)
class Cause:
    """Why runs were lost: a code, and the numbers that tell it."""

    code: str
    numbers: Mapping[str, Any] = field(default_factory=dict)
    in_vain: tuple[str, ...] = ()  # Codes of what was asked for and taken away without effect

    def to_dict(self) -> dict[str, Any]:
        """As JSON-ready data."""
        return {name: json_ready(value) for name, value in asdict(self).items()}


def why_lost(loop: LoopRuns, result: LoopResult) -> Cause:
    """The cause, and the numbers that tell it."""
    last = float(np.nanmax(result.outcome_time_s)) / loop.design.model.sample_time_s
    loop = replace(loop, steps=min(loop.steps, int(BEYOND * last) + loop.design.steps(FOLLOWED)))
    codes, changes = _asked_for(loop)
    if codes:
        held = replace(loop, **changes).held(f"without {', '.join(codes)}")
        if held is not None and held[~result.held].all():
            return Cause("asked-for", {"asked_for": codes})
    if loop.grows:  # the estimate where the exact state makes the linear loop stable, the controller otherwise
        exact = loop.design.bench("exact").growth(loop.design.controller(loop.experiment.controller))
        return Cause("estimate" if exact < 0.0 else "controller", {"growth_per_s": loop.growth_per_s}, codes)
    return replace(hardware_limit(loop), in_vain=codes)


def _asked_for(loop: LoopRuns) -> tuple[tuple[str, ...], dict[str, Any]]:
    """Codes of all that was asked for and can be taken away, and the loop's fields without it."""
    e, design, changes = loop.experiment, loop.design, dict[str, Any]()
    faults = {
        "sensor-offset": e.offset != 0.0,
        "sensor-drift": e.drift_per_s != 0.0,
        "sensor-stuck": np.isfinite(e.stuck_after_s),
        "dropouts": e.dropout_probability != 0.0,
        "force-scale": e.force_scale != 1.0,
    }
    asked_for = {"plant": loop.plant is not None, **faults}
    asked_for |= {"gains": bool(design.given), "latency": bool(design.latency)}
    if loop.plant is not None:
        changes["plant"] = None
    if any(faults.values()):
        changes["experiment"] = Experiment(e.controller, e.observer, e.targets_m)
    if design.given or design.latency:
        plain = replace(design, given={}, latency=0)
        changes["design"] = keeping_margins(plain) if design.latency else plain
    return tuple(code for code, present in asked_for.items() if present), changes


def hardware_limit(loop: LoopRuns) -> Cause:
    """What of sensors and driver the runs are lost by where the loop itself is stable.

    The noise where it fills the command's room at the point of rest that leaves least of it, the driver otherwise. The
    room is in V, or A for a current amplifier, of which noise takes a share rms; ``reach_m`` is how far nearer
    and farther a body at rest may be for the force at the limits to turn it back. The current is taken to be at its
    limit at once; a coil needs time, and so less is true.
    """
    design, limits = loop.design, limits_of(loop.design.model)
    numbers: dict[str, Any] = {"reach_m": _reach(loop), "room": None}
    try:
        bench = design.bench(loop.experiment.observer)
        margins = bench.judge(design.controller(loop.experiment.controller), SEARCH_FREQUENCIES)
    except (DomainError, FilterError):  # no margins tell what noise takes
        return Cause("authority", numbers)
    rooms = [float(np.minimum(p.commands - limits[0], limits[1] - p.commands).min()) for p in bench.points]
    worst = int(np.argmin(rooms))
    share = float(margins[worst].noise_share)
    numbers["room"] = {"distance_m": bench.points[worst].distance_m, "room": rooms[worst], "noise_share": share}
    return Cause("noise" if share >= NOISE_FILLS else "authority", numbers)


def _reach(loop: LoopRuns) -> tuple[float, float]:
    model, target, box = loop.design.model, loop.experiment.targets_m[0], loop.design.model.validity
    distance = np.linspace(box.distance_min_m, box.distance_max_m, 401)
    weakest, strongest = force_range(model, distance)
    needed = model.require_motion().static_force(distance)
    bad = np.where(distance > target, strongest < needed, weakest > needed)
    near = float(distance[bad & (distance < target)].max(initial=box.distance_min_m))
    return target - near, float(distance[bad & (distance > target)].min(initial=box.distance_max_m)) - target
