"""Why a loop was lost, found by taking one suspected cause away at a time.

The same loop is run again without the faults that were asked for, then without noise, then with the exact state in
place of the filter's estimate. What is missing where it first holds was the cause. Where it is lost with the exact
state, the driver's voltage is looked at: a voltage at its limit lacks authority, one that is free means that the gains
do not fit.
"""

from dataclasses import replace

import numpy as np

from femfit.model.actuator_model import ActuatorModel
from femfit.simulation.constants import SUPPORT_TIME_CONSTANTS
from femfit.simulation.design import LoopDesign
from femfit.simulation.experiment import Experiment, run_experiments
from femfit.simulation.loop import LoopResult

RUNS = 4
"""Conventional: repeats of each trial; a loop that is lost once in four is not held."""

START_ERROR = 5e-3
"""Conventional: how far the body starts off where nothing else disturbs it, over the reference distance."""

LAST_TIME_CONSTANTS = 3.0
"""Derived: within three time constants an unstable body multiplies its distance from rest by twenty, so that what went
wrong happened there."""

AT_LIMIT = 0.5
"""Conventional: part of that time at the driver's limit from which the voltage is called short."""


def why_lost(design: LoopDesign, experiment: Experiment, duration_s: float, plant: ActuatorModel | None = None) -> str:
    """A sentence with the cause and a remedy that has been tried, or why none is known."""
    steps = max(1, round(duration_s / design.model.sample_time_s))
    faultless = _without_faults(experiment)
    quiet = _quiet(faultless)
    trials: list[tuple[str, Experiment, ActuatorModel | None]] = []
    if plant is not None:
        trials.append(
            (
                (
                    "The model is not the plant's: with the plant equal to the model the same loop holds. Compare the "
                    "model with measurements (femfit diagnose) and add what is missing."
                ),
                experiment,
                None,
            )
        )
    if faultless != experiment:
        trials.append((f"The fault does it ({_faults(experiment)}): without it the same loop holds.", faultless, None))
    trials.append(
        (
            f"The noise of the Hall voltage does it: without noise the same loop holds. {_less_noise(experiment)}",
            quiet,
            None,
        )
    )
    trials.append(
        (
            (
                "The estimate does it: with the exact state the same controller holds the body. Check the filter's "
                "noise and the sensor's characteristic over the reference's range, or take another filter."
            ),
            replace(quiet, observer="exact"),
            None,
        )
    )
    result = None
    for sentence, trial, truth in trials:
        result = _run(design, trial, steps, truth)
        if result.held.all():
            return sentence
    return "" if result is None else _of_the_controller(design, experiment, steps, result)


def _of_the_controller(design: LoopDesign, experiment: Experiment, steps: int, result: LoopResult) -> str:
    """Lost with the exact state and without noise: the voltage is short, or the gains do not fit."""
    circuit = design.model.require_circuit()
    share = _share_at_limit(design, result)
    others = [name for name in design.controllers if name != experiment.controller]
    for name in others:
        trial = replace(_quiet(_without_faults(experiment)), controller=name)
        if _run(design, trial, steps, None).held.all():
            return (
                f"The gains of {experiment.controller} do it: it loses the body with the exact state and without noise "
                f"too, while {name} holds it. Use {name}, or smaller steps of the reference."
            )
    if share > AT_LIMIT:
        return (
            "The driver does it: with the exact state too the voltage stood at its limit of "
            f"{circuit.voltage_min_V:.3g} or {circuit.voltage_max_V:.3g} V for {100 * share:.0f} % of the time before "
            "the loss. Use a higher supply voltage with a sweep that covers its currents, or a reference with smaller "
            "steps."
        )
    return (
        f"The gains do it: the body is lost with the exact state and without noise too, and the voltage stood at its "
        f"limit for only {100 * share:.0f} % of the time before. A shorter sample time or a coil with less inductance "
        "leaves faster poles to choose."
    )


def _run(design: LoopDesign, experiment: Experiment, steps: int, plant: ActuatorModel | None) -> LoopResult:
    (result,) = run_experiments(
        design,
        [experiment],
        np.random.default_rng(0),
        runs=RUNS,
        steps=steps,
        supported_steps=design.steps(SUPPORT_TIME_CONSTANTS),
        plant=plant,
    )
    return result


def _share_at_limit(design: LoopDesign, result: LoopResult) -> float:
    """Part of the samples before the loss at which the voltage stood at the driver's limit."""
    circuit, last = design.model.require_circuit(), design.steps(LAST_TIME_CONSTANTS)
    width = circuit.voltage_max_V - circuit.voltage_min_V
    shares = []
    for run in np.flatnonzero(~result.held):
        voltage = result.series.voltage_V[:, run]
        voltage = voltage[np.isfinite(voltage)][-last:]
        at_limit = (voltage <= circuit.voltage_min_V + 1e-6 * width) | (voltage >= circuit.voltage_max_V - 1e-6 * width)
        if at_limit.size:
            shares.append(float(np.mean(at_limit)))
    return float(np.mean(shares)) if shares else 0.0


def _without_faults(experiment: Experiment) -> Experiment:
    return Experiment(
        controller=experiment.controller,
        observer=experiment.observer,
        targets_m=experiment.targets_m,
        noise_V=experiment.noise_V,
        velocity_cutoff_rad_s=experiment.velocity_cutoff_rad_s,
    )


def _quiet(experiment: Experiment) -> Experiment:
    """Without noise, the body starts a little off: an unstable loop would otherwise rest on its point of rest."""
    return replace(experiment, noise_V=0.0, start_error_m=START_ERROR * experiment.targets_m[0])


def _faults(experiment: Experiment) -> str:
    parts = {
        "Hall offset": experiment.offset_V != 0.0,
        "Hall drift": experiment.drift_V_per_s != 0.0 or experiment.drift_V_per_sqrt_s != 0.0,
        "sensor stuck": np.isfinite(experiment.stuck_after_s),
        "dropouts": experiment.dropout_probability != 0.0,
        "true force unlike the model's": experiment.force_scale != 1.0,
        "wrong first estimate": experiment.believed_m is not None,
    }
    return ", ".join(name for name, present in parts.items() if present)


def _less_noise(experiment: Experiment) -> str:
    if experiment.observer == "direct":
        return "Use a filter instead of the direct measurement, or a sensor with less noise."
    return "Use a sensor with less noise or a stronger field at the element."
