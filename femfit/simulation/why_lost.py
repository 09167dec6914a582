"""Why a loop was lost: authority, sensor, delay or gains, found by improving one of them and seeing it held.

The lost runs are repeated on the same noise. First what was asked for is taken away: another plant, faults. Where the
linear loop is unstable about its rest, the reason for that comes before all that a driver or a sensor could do. Then
other gains are tried with all else as it is: where they hold, the gains were the cause. Where none do, one thing of the
hardware is improved at a time (the driver's limits, the sensors' noise and range, the delays), with controllers
designed anew for it; what suffices alone is the cause, and by how much is sought by halving. Where nothing alone
suffices, two are.
"""

from collections.abc import Callable
from dataclasses import replace
from itertools import combinations

import numpy as np

from femfit.core.amount import amount
from femfit.core.arrays import FloatArray
from femfit.model.drive import circuit_terms
from femfit.simulation.allocation import current_ranges
from femfit.simulation.design import CONTROLLERS, ControllerName
from femfit.simulation.experiment import Experiment
from femfit.simulation.loop import LoopResult
from femfit.simulation.lost_loop import AMPLE, HARDLY, Improved, LostLoop
from femfit.simulation.why_unstable import growth_of, short_of_room, why_unstable

FEW = 8
"""Conventional: of more runs so many are repeated where some of them are lost, so that the trials take no longer."""

BEYOND, FOLLOWED = 1.5, 20.0
"""Conventional: a trial is followed for so many times the time of the last loss, and so many of the body's time
constants more: a loop that drifts away a fifth as fast as the body is lost by then."""

HALVINGS = 4
"""Conventional: steps of the search for the improvement that suffices; it is then known to a few per cent."""

HARDWARE: dict[str, Improved] = {
    "authority": Improved(authority=AMPLE),
    "sensor noise": Improved(noise=HARDLY),
    "sensor range": Improved(unlimited_range=True),
    "delay": Improved(delay=0.0),
}


def why_lost(loop: LostLoop, lost: LoopResult) -> str:
    """A sentence or two: the cause, and what was tried against it."""
    last = float(np.nanmax(lost.outcome_time_s)) / loop.design.model.sample_time_s
    loop = replace(loop, steps=min(loop.steps, int(BEYOND * last) + loop.design.steps(FOLLOWED)), known={})
    few = replace(loop, runs=min(FEW, loop.runs), known={})
    sample = few.held(Improved())
    loop = loop if sample is None or sample.all() else few
    outcome = loop.held(Improved())
    gone = ~outcome if outcome is not None else np.ones(loop.runs, dtype=np.bool_)
    if not gone.any():
        return "The loss comes late and by chance: the same runs hold up to soon after it."

    def holds(better: Improved) -> bool:
        held = loop.held(better)
        return held is not None and bool(held[gone].all())

    given = _asked_for(loop)
    for name, better in given.items():
        if holds(better):
            helped = " Compare the model with measurements (femfit diagnose) and add what is missing."
            return f"Without {name} the same runs hold.{helped if better.true_plant else ''}"
    if growth := growth_of(loop):
        return why_unstable(loop, lambda: _other_gains(loop, holds), growth)
    return f"{_other_gains(loop, holds) or _of_hardware(loop, given, holds)}{short_of_room(loop)}"


def _of_hardware(loop: LostLoop, given: dict[str, Improved], holds: Callable[[Improved], bool]) -> str:
    """What of the hardware is the cause where no gains hold the runs."""
    for name, better in _hardware(loop).items():
        if (controller := _suffices(loop, better, holds)) is not None:
            return _cause(loop, name, replace(better, controller=controller), holds)
    return _two(loop, given, holds)


def _asked_for(loop: LostLoop) -> dict[str, Improved]:
    """What was asked for and can be taken away."""
    found = {}
    if loop.plant is not None:
        found["the difference between plant and model"] = Improved(true_plant=True)
    if faults := _faults(loop.experiment):
        found[f"the fault ({faults})"] = Improved(no_faults=True)
    return found


def _other_gains(loop: LostLoop, holds: Callable[[Improved], bool]) -> str:
    """The gains are the cause where others hold the same runs with all else as it is."""
    own = loop.experiment.controller
    if own in loop.design.given and holds(Improved(designed=True)):
        return f"The gains: {own} loses the body with these, and holds the same runs with those that femfit designs."
    for name in _others(own):
        if holds(Improved(controller=name)):
            return f"The gains: {own} loses the body with these. Use {name}: with it the same runs hold."
    if loop.experiment.observer == "direct":
        for name in (own, *_others(own)):
            if holds(Improved(controller=name, observer="ukf4")):
                return (
                    "The sensors' noise reaches the driver: each difference of two readings is a velocity here. Use a "
                    f"filter: with {name} on ukf4 the same runs hold with the noise as it is."
                )
    return ""


def _others(own: ControllerName) -> list[ControllerName]:
    return [name for name in reversed(CONTROLLERS) if name != own]


def _hardware(loop: LostLoop) -> dict[str, Improved]:
    """What can be improved: only what there is."""
    sensors = loop.design.loop_sensors()
    there = {
        "authority": True,
        "sensor noise": loop.experiment.noise_scale != 0.0 and any(loop.design.noise.values()),
        "sensor range": any(np.isfinite(one.reading.high - one.reading.low) for one in sensors),
        "delay": loop.design.latency > 0 or any(one.delay for one in sensors),
    }
    return {name: better for name, better in HARDWARE.items() if there[name]}


def _suffices(loop: LostLoop, better: Improved, holds: Callable[[Improved], bool]) -> ControllerName | None:
    """The controller with which an improvement holds the runs; None where there is none."""
    own = loop.experiment.controller
    for name in (own, *_others(own)):
        if holds(replace(better, controller=name)):
            return name
    return None


def _cause(loop: LostLoop, name: str, better: Improved, holds: Callable[[Improved], bool]) -> str:
    """A cause with how much of it would do, and the others that suffice alone."""
    alone = {other: replace(one, controller=better.controller) for other, one in _hardware(loop).items()}
    also = [other for other, one in alone.items() if other != name and holds(one)]
    either = f" {' and '.join(also).capitalize()} would do as well: each alone holds them." if also else ""
    return f"{_SENTENCES[name](loop, better, holds)}{_with(loop, better)}{either}"


def _with(loop: LostLoop, better: Improved) -> str:
    own = loop.experiment.controller
    return f", with {better.controller}." if better.controller not in {own, None} else "."


def _least(good: float, bad: float, holds: Callable[[float], bool]) -> float:
    """The value nearest to ``bad`` at which the runs hold, by halving the ratio, or the difference from zero."""
    for _ in range(HALVINGS):
        middle = float(np.sqrt(good * bad)) if good > 0.0 else 0.5 * bad
        if good == 0.0 or bad / good < 4.0:
            middle = 0.5 * (good + bad)
        good, bad = (middle, bad) if holds(middle) else (good, middle)
    return good


def _of_authority(loop: LostLoop, better: Improved, holds: Callable[[Improved], bool]) -> str:
    factor = _least(AMPLE, 1.0, lambda value: holds(replace(better, authority=value)))
    near, far = reach(loop)
    return (
        f"The authority: at {amount(loop.experiment.targets_m[0], 'm', 3)} the force at the driver's limits brings a "
        f"body at rest back from {amount(near, 'm')} nearer and {amount(far, 'm')} farther at most; with limits "
        f"{factor:.2g} times as wide, in volts and amperes, the same runs hold"
    )


def _of_noise(loop: LostLoop, better: Improved, holds: Callable[[Improved], bool]) -> str:
    part = _least(HARDLY, 1.0, lambda value: holds(replace(better, noise=value)))
    sensors = loop.design.loop_sensors()
    now = ", ".join(f"{one.name} {amount(one.reading.noise, one.reading.unit, 3)}" for one in sensors)
    then = ", ".join(f"{one.name} {amount(part * one.reading.noise, one.reading.unit, 2)}" for one in sensors)
    return f"The sensors' noise: {now} rms; with {then} the same runs hold"


def _of_range(loop: LostLoop, better: Improved, holds: Callable[[Improved], bool]) -> str:  # noqa: ARG001
    return "The sensors' range: at its end a reading says nothing of the distance; without ends the same runs hold"


def _of_delay(loop: LostLoop, better: Improved, holds: Callable[[Improved], bool]) -> str:
    part = _least(0.0, 1.0, lambda value: holds(replace(better, delay=value)))
    late, unstable = delay_of(loop), max(point.runaway_rad_s for point in loop.design.points)
    product = f", {unstable * late:.2g} of the time in which the body runs away by a factor e" if unstable else ""
    return (
        f"The delay: {amount(late, 's')} from the body to the command{product}; with {amount(part * late, 's')} at "
        "most the same runs hold"
    )


_SENTENCES: dict[str, Callable[[LostLoop, Improved, Callable[[Improved], bool]], str]] = {
    "authority": _of_authority,
    "sensor noise": _of_noise,
    "sensor range": _of_range,
    "delay": _of_delay,
}


def _two(loop: LostLoop, given: dict[str, Improved], holds: Callable[[Improved], bool]) -> str:
    """Two causes of which neither suffices alone."""
    named = {
        f"the {name}" if name != "sensor noise" else "the sensors' noise": one for name, one in _hardware(loop).items()
    }
    for pair in combinations({**given, **named}.items(), 2):
        (first, one), (second, other) = pair
        both = _merged(one, other)
        if (controller := _suffices(loop, both, holds)) is not None:
            return (
                f"Two things together: without {first} and {second} as they are the same runs hold"
                f"{_with(loop, replace(both, controller=controller))} Neither suffices alone."
            )
    return (
        "Not found: the same runs are lost with a driver ten times as strong, without delay and with hardly any noise, "
        "one at a time and two together. Choose reference distances nearer to each other, or compare the model with a "
        "bench."
    )


def _merged(one: Improved, other: Improved) -> Improved:
    plain = Improved()
    changed = {name: value for name, value in vars(other).items() if value != getattr(plain, name)}
    return replace(one, **changed)


def delay_of(loop: LostLoop) -> float:
    """Longest time in s from the body to the command that answers it, without the samples themselves."""
    step = loop.design.model.sample_time_s
    return (max(one.delay for one in loop.design.loop_sensors()) + loop.design.latency) * step


def reach(loop: LostLoop) -> tuple[float, float]:
    """How far in m a body at rest may be off, nearer and farther, for the force at the limits to turn it back.

    The current is taken to be at its limit at once; a coil needs time, and so less is true.
    """
    model, target = loop.design.model, loop.experiment.targets_m[0]
    box, ranges = model.validity, current_ranges(model)
    distance: FloatArray = np.linspace(box.distance_min_m, box.distance_max_m, 401)
    corners = np.stack(np.meshgrid(*ranges), axis=-1).reshape(-1, len(ranges))
    forces = [circuit_terms(model, distance, np.tile(one, (len(distance), 1)))[0] for one in corners]
    needed = model.require_motion().static_force(distance)
    lost_far = distance[(np.max(forces, axis=0) < needed) & (distance > target)]
    lost_near = distance[(np.min(forces, axis=0) > needed) & (distance < target)]
    far = float(lost_far.min(initial=box.distance_max_m)) - target
    return target - float(lost_near.max(initial=box.distance_min_m)), far


def _faults(experiment: Experiment) -> str:
    parts = {
        "sensor offset": experiment.offset != 0.0,
        "sensor drift": experiment.drift_per_s != 0.0,
        "sensor stuck": np.isfinite(experiment.stuck_after_s),
        "dropouts": experiment.dropout_probability != 0.0,
        "true force unlike the model's": experiment.force_scale != 1.0,
        "wrong first estimate": experiment.believed_m is not None,
    }
    return ", ".join(name for name, present in parts.items() if present)
