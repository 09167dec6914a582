"""Why the linear loop is unstable about its rest: the gains given, the delays, the estimate, or the controller.

An unstable loop swings until its commands reach the driver's limits, so that a lost run looks like a weak driver. What
the linear loop tells goes first: no driver holds a body in a loop that is unstable about its rest.
"""

from collections.abc import Callable
from dataclasses import replace

from femfit.core.errors import DomainError, FilterError
from femfit.core.text import amount
from femfit.simulation.controllers import Controller
from femfit.simulation.loop_text import gains_text
from femfit.simulation.lost_loop import LostLoop
from femfit.simulation.state_feedback import StateFeedback
from femfit.simulation.tune import Bench, make_bench

HALVINGS = 8
"""Conventional: steps of the search for the longest delay; it is then known to half a per cent of the delay."""


def growth_of(loop: LostLoop) -> float:
    """Rate in 1/s at which a deviation grows; zero where it does not within the runs, or where nothing tells."""
    design, e = loop.design, loop.experiment
    try:
        growth = design.bench(e.observer).growth(design.controller(e.controller))
    except (DomainError, FilterError):
        return 0.0
    seconds = loop.path_steps * design.model.sample_time_s
    return growth if growth * seconds > 1.0 else 0.0


def why_unstable(loop: LostLoop, other_gains: Callable[[], str], growth: float) -> str:
    """A sentence or two.

    Parameters
    ----------
    other_gains : callable
        Says which other gains hold the lost runs; empty where none do.
    """
    return _gains_or_delay(loop, growth) or other_gains() or _estimate_or_controller(loop, growth)


def _gains_or_delay(loop: LostLoop, growth: float) -> str:
    """The gains given, or the delays, where the linear loop is stable without them; empty where neither is it."""
    design, name = loop.design, loop.experiment.controller
    bench, grows = design.bench(loop.experiment.observer), f"a deviation grows by {growth:.3g} 1/s"
    if name in design.given:
        designed = replace(design, given={}).controller(name)
        if bench.growth(designed) < 0.0:
            return (
                f"The gains given: with them the loop is unstable about its rest, {grows}; with those that femfit "
                f"designs it is stable ({gains_text(design, designed)})."
            )
    if design.delay_s == 0.0 or (prompt := _without_delay(loop, bench)) is None:
        return ""
    return (
        f"The delay: {amount(design.delay_s, 's')} from the body to the command make the loop unstable about its rest, "
        f"{grows}{_borne(bench, prompt)}."
    )


def _estimate_or_controller(loop: LostLoop, growth: float) -> str:
    """The estimate where the exact state makes the linear loop stable, the controller otherwise."""
    design, e = loop.design, loop.experiment
    start = f"{e.controller} on {e.observer} is unstable about its rest, a deviation grows by {growth:.3g} 1/s"
    if design.bench("exact").growth(design.controller(e.controller)) < 0.0:
        return (
            f"The estimate: {start}; with the exact state the loop is stable. Take sensors with less noise or delay, "
            "or a lower bandwidth."
        )
    return f"The gains: {start}, and so it is with the exact state. Take a shorter sample time or a faster coil."


def _without_delay(loop: LostLoop, bench: Bench) -> Controller | None:
    """A controller with which the loop is stable without delays: the loop's own, or one designed for none."""
    controller = loop.design.controller(loop.experiment.controller)
    prompt = _delayed(bench, 0.0)
    if not isinstance(controller, StateFeedback) and prompt.growth(controller) < 0.0:
        return controller
    made = replace(loop.design, latency=0, given={}).controller(loop.experiment.controller)
    return made if prompt.growth(made) < 0.0 else None


def _borne(bench: Bench, controller: Controller) -> str:
    """The longest delay with which a controller's loop is stable."""
    if isinstance(controller, StateFeedback) and bench.latency:
        return "; without it a regulator is stable"  # each latency has a regulator of its own
    good, bad = 0.0, 1.0
    for _ in range(HALVINGS):
        middle = 0.5 * (good + bad)
        good, bad = (middle, bad) if _delayed(bench, middle).growth(controller) < 0.0 else (good, middle)
    borne = int(good * bench.latency) * bench.model.sample_time_s
    borne += max(good * sensor.delay for sensor in bench.sensors) * bench.model.sample_time_s
    return f"; with {amount(borne, 's', 3)} at most it is stable"


def _delayed(bench: Bench, share: float) -> Bench:
    """The bench with a part of its delays."""
    sensors = [replace(sensor, delay=share * sensor.delay) for sensor in bench.sensors]
    return make_bench(bench.model, bench.points, sensors, bench.observer, int(share * bench.latency))
