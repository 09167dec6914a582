"""Why a loop was lost, found by taking one suspected cause away at a time.

The same runs are repeated on the same noise: with the plant that the model describes, without the faults that were
asked for, without noise, then without several of these at once, and with the exact state in place of the estimate. What
is missing where the lost runs first hold was the cause. Where they are lost without all of them, another controller is
tried, and the driver's voltage is looked at.
"""

from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass, replace

import numpy as np

from femfit.model.actuator_model import ActuatorModel
from femfit.simulation.design import LoopDesign
from femfit.simulation.experiment import Experiment, run_experiments
from femfit.simulation.loop import LoopResult

START_ERROR = 5e-3
"""Conventional: how far the body starts off where no noise disturbs it, over the reference distance."""

FEW = 32
"""Conventional: of more runs so many are repeated where some of them are lost, so that the trials take no longer."""

LAST_TIME_CONSTANTS = 3.0
"""Derived: within three time constants an unstable body multiplies its distance from rest by twenty, so that what went
wrong happened there."""

AT_LIMIT = 0.5
"""Conventional: part of that time at the driver's limit from which the voltage is called short."""


@dataclass(frozen=True)
class LostLoop:
    """A loop of which some runs were lost, with all that is needed to run it again."""

    design: LoopDesign
    experiment: Experiment
    random: np.random.Generator  # As it was before the first run; it is copied
    runs: int
    steps: int
    supported_steps: int
    plant: ActuatorModel | None  # What truly moves, where that is another model than the design's

    def again(self, recorded: int = 0) -> LoopResult:
        """The result on the same noise, with the series of the first runs."""
        (result,) = run_experiments(
            self.design,
            [self.experiment],
            deepcopy(self.random),
            runs=self.runs,
            steps=self.steps,
            supported_steps=self.supported_steps,
            recorded=recorded,
            plant=self.plant,
        )
        return result

    def other(self, **fields: object) -> "LostLoop":
        """With other fields of the experiment."""
        return replace(self, experiment=replace(self.experiment, **fields))  # type: ignore[arg-type]

    def undisturbed(self, **fields: object) -> "LostLoop":
        """The same where no noise reaches the controller: without a first error an unstable loop would stay at rest."""
        return self.other(start_error_m=START_ERROR * self.experiment.targets_m[0], **fields)


Change = Callable[[LostLoop], LostLoop]


def why_lost(loop: LostLoop, lost: LoopResult) -> str:
    """A sentence or two: the cause, and what was tried against it."""
    few = replace(loop, runs=FEW)
    if loop.runs > FEW and not (sample := few.again()).held.all():
        loop, lost = few, sample
    gone = ~lost.held

    def holds(changed: LostLoop) -> bool:
        return bool(changed.again().held[gone].all())

    causes = _causes(loop)
    for name, change in causes.items():
        if holds(change(loop)):
            return f"Without {name} the same runs hold. {_remedy(name, loop, holds)}".strip()
    removed = loop
    names: list[str] = []
    for name, change in causes.items():
        removed, names = change(removed), [*names, name]
        if len(names) > 1 and holds(removed):
            return f"Several things together: without {', '.join(names[:-1])} and {names[-1]} the same runs hold."
    if holds(loop.undisturbed(observer="exact")):
        return (
            "The estimate does it: with the exact state the same runs hold. Check the filter's noise and the sensor's "
            "characteristic over the reference's range."
        )
    removed = removed.undisturbed(observer="exact")
    if holds(removed):
        return f"Several things together: with the exact state and without {' and '.join(names)} the same runs hold."
    return _of_the_controller(loop, removed, holds)


PLANT, NOISE = "the difference between plant and model", "the sensors' noise"


def _causes(loop: LostLoop) -> dict[str, Change]:
    """What can be taken away, in the order in which it is suspected."""
    causes: dict[str, Change] = {}
    if loop.plant is not None:
        causes[PLANT] = lambda own: replace(own, plant=None)
    if faults := _faults(loop.experiment):
        causes[f"the fault ({faults})"] = _without_faults
    if loop.experiment.noise_scale != 0.0:
        causes[NOISE] = lambda own: own.undisturbed(noise_scale=0.0)
    return causes


def _remedy(cause: str, loop: LostLoop, holds: Callable[[LostLoop], bool]) -> str:
    """What helps against one cause; a change of the loop is named only where it was tried and held."""
    if cause == PLANT:
        return "Compare the model with measurements (femfit diagnose) and add what is missing."
    if cause == NOISE:
        if loop.experiment.observer == "direct" and holds(loop.other(observer="ukf4")):
            return "Use a filter: with ukf4 they hold with the noise as it is."
        for part in (0.5, 0.25, 0.1):
            if holds(loop.other(noise_scale=part)):
                return f"They hold with {part:g} of it: take sensors with less noise or a steeper characteristic."
        return "They are lost with a tenth of the noise too: the sensor does not suit."
    return ""


def _of_the_controller(loop: LostLoop, removed: LostLoop, holds: Callable[[LostLoop], bool]) -> str:
    """Lost with the exact state, and without noise and faults too: the gains do not fit, or the voltage is short."""
    circuit, own = loop.design.model.require_circuit(), loop.experiment.controller
    share = 100.0 * _share_at_limit(removed)
    limits = f"{circuit.voltage_min_V:.3g} or {circuit.voltage_max_V:.3g} V"
    start = f"{own} loses the body with the exact state and without noise too"
    for name in loop.design.controllers:
        if name != own and holds(loop.other(controller=name)):
            return f"{start}. Use {name}: with it the same runs hold."
    if share > 100.0 * AT_LIMIT:
        return (
            f"{start}, with the voltage at its limit of {limits} for {share:.0f} % of the time before the loss: the "
            "driver is too weak for these steps. Not tried: a higher supply voltage with a sweep that covers its "
            "currents, or smaller steps of the reference."
        )
    return (
        f"{start}, and the voltage stood at its limit for only {share:.0f} % of the time before: the gains do not "
        "suit this body and coil. Not tried: a shorter sample time, or a coil with less inductance."
    )


def _share_at_limit(loop: LostLoop) -> float:
    """Part of the samples before the first lost run's loss at which the voltage stood at the driver's limit."""
    circuit, last = loop.design.model.require_circuit(), loop.design.steps(LAST_TIME_CONSTANTS)
    slack = 1e-6 * (circuit.voltage_max_V - circuit.voltage_min_V)
    run = int(np.argmin(loop.again().held))
    voltage = loop.again(recorded=run + 1).series.commands[:, run, 0]
    voltage = voltage[np.isfinite(voltage)][-last:]
    return float(np.mean((voltage <= circuit.voltage_min_V + slack) | (voltage >= circuit.voltage_max_V - slack)))


def _without_faults(loop: LostLoop) -> LostLoop:
    e = loop.experiment
    clean = Experiment(e.controller, e.observer, e.targets_m, noise_scale=e.noise_scale, start_error_m=e.start_error_m)
    return replace(loop, experiment=clean)


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
