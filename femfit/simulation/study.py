"""Which loops of a model hold, how well its filters measure, and what a fault costs.

All experiments of one length run as one batch on the same noise, so that the study takes seconds and what differs
between two rows is not hidden by the noise.

- *Steps* follow the reference distances: root mean square of measured minus true distance over the whole run.
- *Holds* are at rest, at the smallest and the largest reference distance: the loop is closed once the filter has
  settled on the supported body, and the statistics start four time constants of the unstable pole later. Direct and
  filtered distance come from the same Hall readings; no filter passes 1/sqrt(2 lambda t_s).
- *Faults* are holds with something wrong: a Hall offset, a wrong force law, a wrong first estimate, no filter.
"""

from dataclasses import dataclass
from html import escape
from itertools import product

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.filters.consistency import ConsistencyBand, consistency_band
from femfit.filters.theory import noise_ratio_bound
from femfit.model.actuator_model import ActuatorModel
from femfit.simulation.constants import SUPPORT_TIME_CONSTANTS
from femfit.simulation.design import LoopDesign, ObserverName, design_loop
from femfit.simulation.experiment import Experiment, direct_distance, run_experiments
from femfit.simulation.fault import FaultRow, fault_row
from femfit.simulation.loop import LoopResult
from femfit.simulation.reference import reference_steps
from femfit.simulation.spectrum import Spectrum, amplitude_spectrum
from femfit.simulation.study_text import study_lines

FILTERS: tuple[ObserverName, ...] = ("ukf", "ekf")

SETTLE, WINDOW = 4.0, 10.0
"""Time constants of the slowest unstable pole before the statistics of a hold, and of them."""

RUNS = 16
"""Repeats of a hold: an rms over ten time constants of each is known to 6 %."""

STEP_RUNS, ACQUISITION_RUNS = 8, 8
HALL_OFFSET_V, FORCE_ERROR = 0.02, 0.01


@dataclass(frozen=True, eq=False)
class StepSeries:
    """One recorded run over reference steps; arrays of shape (steps,)."""

    controller: str
    observer: str
    time_s: FloatArray
    reference_m: FloatArray
    true_m: FloatArray
    direct_m: FloatArray
    estimated_m: FloatArray
    voltage_V: FloatArray
    current_A: FloatArray


@dataclass(frozen=True)
class StepRow:
    """How well one measurement follows the true distance over the reference steps.

    Parameters
    ----------
    measurement : str
        ``direct`` or the filter that feeds the loop.
    rms_m : float
        Over the runs that were held; NaN if none was.
    """

    controller: str
    measurement: str
    rms_m: float
    held: int
    runs: int


@dataclass(frozen=True)
class HoldRow:
    """Direct against filtered noise at rest.

    Parameters
    ----------
    ratio, bound : float
        Direct over filtered rms, and 1/sqrt(2 lambda t_s), which no filter of white noise passes.
    innovation_band : ConsistencyBand
        95 % for the mean of the normalised innovations squared.
    """

    controller: str
    filter: str
    distance_m: float
    direct_rms_m: float
    filtered_rms_m: float
    ratio: float
    bound: float
    normalised_innovation_squared: float
    innovation_band: ConsistencyBand
    held: int
    runs: int


@dataclass(frozen=True, eq=False)
class SpectrumPair:
    """Spectra of direct and filtered distance at rest."""

    controller: str
    direct: Spectrum
    filtered: Spectrum


@dataclass(frozen=True, eq=False)
class ClosedLoopStudy:
    """Everything that command line, report and run show of the closed loop.

    Parameters
    ----------
    steps : tuple of StepRow
        Over the reference distances, one a controller and measurement.
    faults : tuple of FaultRow
        What breaks the loop, and what it costs.
    acquisition : tuple of FaultRow
        Filters started at the wrong end of the range.
    series : tuple of StepSeries
        One run of the reference steps a controller.
    spectra : tuple of SpectrumPair
        At the smallest reference distance, of the controllers that held.
    no_direct : str
        Why nothing is compared with the direct measurement, whose rms is then NaN; empty where it is.
    """

    design: LoopDesign
    seed: int
    steps: tuple[StepRow, ...]
    holds: tuple[HoldRow, ...]
    faults: tuple[FaultRow, ...]
    acquisition: tuple[FaultRow, ...]
    series: tuple[StepSeries, ...]
    spectra: tuple[SpectrumPair, ...]
    no_direct: str = ""

    def __str__(self) -> str:
        return "\n".join(study_lines(self))

    def _repr_html_(self) -> str:
        return f"<pre>{escape(str(self))}</pre>"


def closed_loop_study(model: ActuatorModel, seed: int = 1, noise_V: float | None = None) -> ClosedLoopStudy:
    """Run the study."""
    design = design_loop(model, noise_V)
    steps, series = _steps(design, seed)
    holds, faults, spectra = _holds(design, seed)
    return ClosedLoopStudy(
        design=design,
        seed=seed,
        steps=steps,
        holds=holds,
        faults=faults,
        acquisition=_acquisition(design, seed),
        series=series,
        spectra=spectra,
        no_direct=design.why_no_direct,
    )


def _ends(design: LoopDesign) -> tuple[float, float]:
    return design.points[0].distance_m, design.points[-1].distance_m


def _holds(design: LoopDesign, seed: int) -> tuple[tuple[HoldRow, ...], tuple[FaultRow, ...], tuple[SpectrumPair, ...]]:
    """All loops at rest, with and without a fault, in one batch on the same noise."""
    places = list(product(design.controllers, _ends(design)))

    def everywhere(observer: ObserverName, **fault: float) -> list[Experiment]:
        return [Experiment(controller, observer, (distance,), **fault) for controller, distance in places]

    clean = [experiment for name in FILTERS for experiment in everywhere(name)]
    clean4 = everywhere("ukf4")
    biased = [*everywhere("ukf4", offset_V=-HALL_OFFSET_V), *everywhere("ukf4", offset_V=HALL_OFFSET_V)]
    offsets = list(zip(biased, [*clean4, *clean4], strict=True))
    forces = list(zip(everywhere("ukf", force_scale=1.0 + FORCE_ERROR), clean, strict=False))
    blind = [(e, None) for e in everywhere("ukf", offset_V=HALL_OFFSET_V) if e.controller == "backstepping"]
    faulty = [*offsets, *blind, *forces]
    window = slice(design.steps(SETTLE), design.steps(SETTLE) + design.steps(WINDOW))
    experiments = [*clean, *clean4, *(e for e, _ in faulty)]
    results = dict(
        zip(
            experiments,
            run_experiments(
                design,
                experiments,
                np.random.default_rng(seed),
                runs=RUNS,
                steps=window.stop,
                windows=(window,),
                supported_steps=design.steps(SUPPORT_TIME_CONSTANTS),
                noise_blocks=len(experiments),
                recorded=RUNS * len(clean),
            ),
            strict=True,
        )
    )
    measured = {experiment: _direct(design, results[experiment]) for experiment in clean}
    spectra = tuple(
        _spectra(design, e, results[e], measured[e], window)
        for e in clean
        if e.observer == "ukf"
        and e.targets_m[0] == design.points[0].distance_m
        and results[e].held.any()
        and not design.why_no_direct
    )
    holds = tuple(_hold_row(design, e, results[e], measured[e], window) for e in clean)
    # Apart from the others: this batch ends as soon as all of its runs are lost
    direct = () if design.why_no_direct else _without_filter(design, everywhere("direct"), seed, window)
    return holds, (*direct, *(fault_row(e, results[e], results[c] if c else None) for e, c in faulty)), spectra


def _without_filter(
    design: LoopDesign, experiments: list[Experiment], seed: int, window: slice
) -> tuple[FaultRow, ...]:
    results = run_experiments(
        design,
        experiments,
        np.random.default_rng(seed),
        runs=ACQUISITION_RUNS,
        steps=window.stop,
        windows=(window,),
        noise_blocks=len(experiments),
        recorded=0,
    )
    return tuple(fault_row(e, r) for e, r in zip(experiments, results, strict=True))


def _direct(design: LoopDesign, result: LoopResult) -> FloatArray:
    """The direct measurement, or NaN where there is none."""
    if design.why_no_direct:
        return np.full_like(result.series.distance_m, np.nan)
    return direct_distance(design, result.series)


def _spectra(
    design: LoopDesign, experiment: Experiment, result: LoopResult, direct: FloatArray, window: slice
) -> SpectrumPair:
    held, step = result.held, design.model.sample_time_s
    pair = (direct, result.series.estimated_distance_m)
    return SpectrumPair(experiment.controller, *(amplitude_spectrum(x[window][:, held], step) for x in pair))


def _hold_row(
    design: LoopDesign, experiment: Experiment, result: LoopResult, direct: FloatArray, window: slice
) -> HoldRow:
    held, distance = result.held, experiment.targets_m[0]
    direct_rms = _rms((direct - result.series.distance_m)[window][:, held])
    filtered_rms = _rms(result.windows[0].estimate_rms_m[held])
    quality = result.windows[0].normalised_innovation_squared[held]
    return HoldRow(
        controller=experiment.controller,
        filter=experiment.observer,
        distance_m=distance,
        direct_rms_m=direct_rms,
        filtered_rms_m=filtered_rms,
        ratio=direct_rms / filtered_rms,
        bound=noise_ratio_bound(design.model, distance),
        normalised_innovation_squared=float(np.mean(quality)) if quality.size else np.nan,
        innovation_band=consistency_band(max(1, int(held.sum())) * (window.stop - window.start)),
        held=int(held.sum()),
        runs=len(held),
    )


def _steps(design: LoopDesign, seed: int) -> tuple[tuple[StepRow, ...], tuple[StepSeries, ...]]:
    experiments = [Experiment(controller, "ukf", design.targets_m) for controller in design.controllers]
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
    rows: list[StepRow] = []
    series: list[StepSeries] = []
    for experiment, result in zip(experiments, results, strict=True):
        direct = _direct(design, result)
        series.append(_step_series(design, experiment, result, direct))
        measured = {experiment.observer: result.series.estimated_distance_m}
        if not design.why_no_direct:
            measured = {"direct": direct, **measured}
        held = result.held
        for name, distance in measured.items():
            rms = _rms((distance - result.series.distance_m)[:, held])
            rows.append(StepRow(experiment.controller, name, rms, int(held.sum()), len(held)))
    return tuple(rows), tuple(series)


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


def _acquisition(design: LoopDesign, seed: int) -> tuple[FaultRow, ...]:
    near, far = _ends(design)
    controller, steps = design.controllers[0], design.steps(WINDOW)
    experiments = [
        Experiment(controller, name, (true,), believed_m=believed)
        for name in FILTERS
        for true, believed in ((near, far), (far, near))
    ]
    results = run_experiments(
        design,
        experiments,
        np.random.default_rng(seed),
        runs=ACQUISITION_RUNS,
        steps=steps,
        windows=(slice(0, steps),),
        noise_blocks=len(experiments),
        recorded=0,
    )
    return tuple(fault_row(e, r) for e, r in zip(experiments, results, strict=True))


def _rms(errors: FloatArray) -> float:
    return float(np.sqrt(np.mean(errors**2))) if errors.size else float("nan")
