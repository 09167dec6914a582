"""The closed-loop study of one model: Table 6, the noise bound, and what breaks the loop.

Experiments that share a filter run as one batch, so that the study takes seconds. Definitions:

- *Table 6* follows the paper: rms of (true - measured distance) over the whole run through the model's reference steps.
- *Holds* are at rest: the loop is closed once the filter has settled on the supported body, and statistics start four
  more time constants of the unstable pole later, at the smallest and at the largest reference distance. Direct and
  filtered rms come from the same Hall readings; the bound is 1/sqrt(2 lambda t_s) at that distance.
- *Position* errors are true distance minus reference, *estimate* errors are estimated minus true distance.

References
----------
A. Chowdhury and A. Sarjas, Sensors 16 (2016) 1504, section 5, Table 6 and Figures 15 to 19.
"""

from dataclasses import dataclass

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.model.actuator_model import ActuatorModel
from femfit.simulation.design import (
    SUPPORT_TIME_CONSTANTS,
    ControllerName,
    LoopDesign,
    ObserverName,
    design_loop,
)
from femfit.simulation.experiment import Experiment, direct_distance, run_experiments
from femfit.simulation.loop import LoopResult
from femfit.simulation.reference import reference_steps
from femfit.simulation.spectrum import Spectrum, amplitude_spectrum
from femfit.simulation.study_rows import LossRow, ShiftRow, loss_row, shift_row
from femfit.simulation.table6 import HoldRow, Table6Row, hold_row, table6_row

FILTERS: tuple[ObserverName, ...] = ("ukf", "ekf")

SETTLE, WINDOW = 4.0, 10.0
"""Time constants of the slowest unstable pole before the statistics of a hold, and of them."""

HOLD_RUNS, FAULT_RUNS, STEP_RUNS, LOSS_RUNS = 64, 12, 8, 8
HALL_BIAS_V, FORCE_ERROR, FILTERED_NOISE_V = 0.02, 0.01, 0.8e-3
LOSS_TIME_S = 1.0
SPECTRUM_RUNS = 16


@dataclass(frozen=True, eq=False)
class StepSeries:
    """One recorded run over reference steps.

    Parameters
    ----------
    time_s, reference_m, true_m, direct_m, estimated_m, voltage_V, current_A : array, shape (steps,)
        What the figures draw.
    """

    controller: str
    observer: str
    time_s: FloatArray
    reference_m: FloatArray
    true_m: FloatArray
    direct_m: FloatArray
    estimated_m: FloatArray
    voltage_V: FloatArray
    current_A: FloatArray


@dataclass(frozen=True, eq=False)
class SpectrumPair:
    """Spectra of direct and filtered distance at rest, Figures 17 and 18."""

    controller: str
    direct: Spectrum
    filtered: Spectrum


@dataclass(frozen=True, eq=False)
class ClosedLoopStudy:
    """Everything that command line, report and run show of the closed loop.

    Parameters
    ----------
    direct_feedback : tuple of LossRow
        Raw derivative at the design's noise, filtered derivative at 0.8 mV.
    hall_bias : tuple of ShiftRow
        Four states with -20 and +20 mV.
    hall_bias_three_states : tuple of LossRow
        What 20 mV do to a filter that does not estimate the bias.
    force_error : tuple of ShiftRow
        Three states, the plant's force 1 % larger than the model's.
    acquisition : tuple of LossRow
        UKF and EKF started at the wrong end of the range.
    steps : tuple of StepSeries
        Figures 15 and 16: reference steps with both controllers, UKF.
    small_steps : tuple of StepSeries
        Figure 19: UKF and EKF over the first three eighths of the range.
    spectra : tuple of SpectrumPair
        Figures 17 and 18; of the controllers that held.
    no_direct : str
        Why nothing is compared with the direct measurement; empty where it is. Without it, its rms is NaN.
    """

    design: LoopDesign
    seed: int
    table6: tuple[Table6Row, ...]
    holds: tuple[HoldRow, ...]
    direct_feedback: tuple[LossRow, ...]
    hall_bias: tuple[ShiftRow, ...]
    hall_bias_three_states: tuple[LossRow, ...]
    force_error: tuple[ShiftRow, ...]
    acquisition: tuple[LossRow, ...]
    steps: tuple[StepSeries, ...]
    small_steps: tuple[StepSeries, ...]
    spectra: tuple[SpectrumPair, ...]
    no_direct: str = ""


def closed_loop_study(model: ActuatorModel, seed: int = 1, noise_V: float | None = None) -> ClosedLoopStudy:
    """Run the study.

    Parameters
    ----------
    seed : int
        Of all noise; the same seed gives the same numbers.
    noise_V : float or None
        White noise of a Hall sample, as in :func:`design_loop`.

    Raises
    ------
    MissingPartError
        If the model has no circuit, motion or sensor.
    DomainError
        If the body cannot be held at the reference distances.
    """
    design = design_loop(model, noise_V)
    holds, spectra = _holds(design, seed)
    table6, steps, small_steps = _steps(design, seed)
    hall_bias, three_states, force_error = _faults(design, seed)
    return ClosedLoopStudy(
        design=design,
        seed=seed,
        table6=table6,
        holds=holds,
        direct_feedback=() if design.why_no_direct else _direct_feedback(design, seed),
        hall_bias=hall_bias,
        hall_bias_three_states=three_states,
        force_error=force_error,
        acquisition=_acquisition(design, seed),
        steps=steps,
        small_steps=small_steps,
        spectra=spectra,
        no_direct=design.why_no_direct,
    )


def _ends(design: LoopDesign) -> tuple[float, float]:
    return design.points[0].distance_m, design.points[-1].distance_m


def _hold_window(design: LoopDesign) -> slice:
    return slice(design.steps(SETTLE), design.steps(SETTLE) + design.steps(WINDOW))


def _hold(
    design: LoopDesign, experiments: list[Experiment], seed: int, *, runs: int, noise_blocks: int
) -> tuple[LoopResult, ...]:
    window = _hold_window(design)
    return run_experiments(
        design,
        experiments,
        np.random.default_rng(seed),
        runs=runs,
        steps=window.stop,
        windows=(window,),
        supported_steps=design.steps(SUPPORT_TIME_CONSTANTS),
        noise_blocks=noise_blocks,
    )


def _holds(design: LoopDesign, seed: int) -> tuple[tuple[HoldRow, ...], tuple[SpectrumPair, ...]]:
    """UKF and EKF on the same noise."""
    experiments = [Experiment(c, f, (d,)) for f in FILTERS for c in design.controllers for d in _ends(design)]
    results = _hold(design, experiments, seed, runs=HOLD_RUNS, noise_blocks=len(FILTERS))
    window = _hold_window(design)
    rows: list[HoldRow] = []
    spectra: list[SpectrumPair] = []
    for experiment, result in zip(experiments, results, strict=True):
        direct = _direct(design, result)
        rows.append(hold_row(design, experiment, result, direct, window))
        if design.why_no_direct:
            continue
        if experiment.observer == "ukf" and experiment.targets_m[0] == design.points[0].distance_m:
            kept = np.flatnonzero(result.held)[:SPECTRUM_RUNS]
            if not kept.size:
                continue  # lost runs have no record at rest
            pair = (direct, result.series.estimated_distance_m)
            direct_part, filtered = (amplitude_spectrum(x[window][:, kept], design.model.sample_time_s) for x in pair)
            spectra.append(SpectrumPair(experiment.controller, direct_part, filtered))
    return tuple(rows), tuple(spectra)


def _direct(design: LoopDesign, result: LoopResult) -> FloatArray:
    """The direct measurement, or NaN where there is none."""
    if design.why_no_direct:
        return np.full_like(result.series.distance_m, np.nan)
    return direct_distance(design, result.series)


def _steps(
    design: LoopDesign, seed: int
) -> tuple[tuple[Table6Row, ...], tuple[StepSeries, ...], tuple[StepSeries, ...]]:
    """Reference steps: both controllers over the model's, backstepping over the first three eighths of the range."""
    near, far = _ends(design)
    small = (near, near + 0.375 * (far - near), near)
    paths: list[tuple[ControllerName, tuple[float, ...]]] = [*((c, design.targets_m) for c in design.controllers)]
    experiments = [Experiment(c, f, targets) for f in FILTERS for c, targets in [*paths, ("backstepping", small)]]
    stay = 7.0 / design.reference_rate_rad_s + 4.0 / design.slowest_pole_rad_s
    results = run_experiments(
        design,
        experiments,
        np.random.default_rng(seed),
        runs=STEP_RUNS,
        steps=len(design.targets_m) * int(np.ceil(stay / design.model.sample_time_s)),
        supported_steps=design.steps(SUPPORT_TIME_CONSTANTS),
        noise_blocks=len(experiments),
    )
    rows: list[Table6Row] = []
    steps: list[StepSeries] = []
    small_steps: list[StepSeries] = []
    for experiment, result in zip(experiments, results, strict=True):
        direct = _direct(design, result)
        drawn = _step_series(design, experiment, result, direct)
        if experiment.targets_m == small:
            small_steps.append(drawn)
            continue
        if experiment.observer == "ukf":
            steps.append(drawn)
            if not design.why_no_direct:
                rows.append(table6_row(experiment.controller, "direct", result, direct))
        rows.append(table6_row(experiment.controller, experiment.observer, result, result.series.estimated_distance_m))
    return tuple(rows), tuple(steps), tuple(small_steps)


def _step_series(design: LoopDesign, experiment: Experiment, result: LoopResult, direct: FloatArray) -> StepSeries:
    """The first run that was held, or the first of all where none was."""
    run = int(np.argmax(result.held))
    series, time = result.series, result.time_s
    reference = reference_steps(
        experiment.targets_m, len(time), design.model.sample_time_s, design.reference_rate_rad_s
    )
    return StepSeries(
        controller=experiment.controller,
        observer=experiment.observer,
        time_s=time,
        reference_m=reference.distance,
        true_m=series.distance_m[:, run],
        direct_m=direct[:, run],
        estimated_m=series.estimated_distance_m[:, run],
        voltage_V=series.voltage_V[:, run],
        current_A=series.current_A[:, run],
    )


def _direct_feedback(design: LoopDesign, seed: int) -> tuple[LossRow, ...]:
    """Raw derivative with both controllers; a derivative filtered at twice the coil's pole, at less noise."""
    cutoff = 2.0 * design.points[0].coil_pole_rad_s
    steps = round(LOSS_TIME_S / design.model.sample_time_s)
    raw = [Experiment(c, "direct", (d,)) for c in design.controllers for d in _ends(design)]
    smooth = [
        Experiment("backstepping", "direct", (d,), noise_V=FILTERED_NOISE_V, velocity_cutoff_rad_s=cutoff)
        for d in _ends(design)
    ]
    # Two batches: the first ends as soon as all of its runs are lost
    return _losses(design, raw, steps, seed) + _losses(design, smooth, steps, seed)


def _acquisition(design: LoopDesign, seed: int) -> tuple[LossRow, ...]:
    near, far = _ends(design)
    ends = ((near, far), (far, near))
    experiments = [
        Experiment("backstepping", f, (true,), believed_m=believed) for f in FILTERS for true, believed in ends
    ]
    return _losses(design, experiments, design.steps(WINDOW), seed)


def _losses(design: LoopDesign, experiments: list[Experiment], steps: int, seed: int) -> tuple[LossRow, ...]:
    results = run_experiments(
        design,
        experiments,
        np.random.default_rng(seed),
        runs=LOSS_RUNS,
        steps=steps,
        windows=(slice(0, steps),),
        noise_blocks=len(experiments),
        recorded=0,
    )
    return tuple(loss_row(e, r) for e, r in zip(experiments, results, strict=True))


def _faults(design: LoopDesign, seed: int) -> tuple[tuple[ShiftRow, ...], tuple[LossRow, ...], tuple[ShiftRow, ...]]:
    """Hall bias with four states and with three, and a force error with three; each against no fault."""
    clean4, minus, plus = (_everywhere(design, "ukf4", offset_V=sign * HALL_BIAS_V) for sign in (0.0, -1.0, 1.0))
    clean, wrong = (_everywhere(design, "ukf", force_scale=1.0 + error) for error in (0.0, FORCE_ERROR))
    blind = [Experiment("backstepping", "ukf", (d,), offset_V=HALL_BIAS_V) for d in _ends(design)]
    experiments = [*clean4, *minus, *plus, *clean, *wrong, *blind]
    results = _hold(design, experiments, seed, runs=FAULT_RUNS, noise_blocks=len(experiments))
    of = dict(zip(experiments, results, strict=True))
    bias = [shift_row(e, of[e], of[c]) for part in (minus, plus) for e, c in zip(part, clean4, strict=True)]
    force = [shift_row(e, of[e], of[c]) for e, c in zip(wrong, clean, strict=True)]
    return tuple(bias), tuple(loss_row(e, of[e]) for e in blind), tuple(force)


def _everywhere(
    design: LoopDesign, name: ObserverName, offset_V: float = 0.0, force_scale: float = 1.0
) -> list[Experiment]:
    return [
        Experiment(c, name, (d,), offset_V=offset_V, force_scale=force_scale)
        for c in design.controllers
        for d in _ends(design)
    ]
