"""Which loops of a model hold, how well its filters measure, and what a fault costs.

All experiments of one length run as one batch on the same noise, so that what differs between two rows is not hidden by
the noise.

- *Steps* follow the reference distances: root mean square of measured minus true distance over the whole run.
- *Holds* are at rest, at the smallest and the largest reference distance: the loop is closed once the filter has
  settled on the supported body, and the statistics start four time constants of the slowest loop that a design allows
  later. Direct and filtered distance come from the same readings; no filter passes 1/sqrt(2 lambda t_s).
- *Faults* are holds with something wrong: an offset of the first sensor, a wrong force law, no filter.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import product
from typing import Any

import numpy as np

from femfit.core.errors import DomainError
from femfit.core.files import json_ready
from femfit.core.numerics import FloatArray
from femfit.core.results import Printed
from femfit.estimate.noise import unstable_pole
from femfit.model.actuator_model import ActuatorModel
from femfit.simulation.constants import SETTLING_PART, SUPPORT_TIME_CONSTANTS
from femfit.simulation.design import CONTROLLERS, LoopDesign, ObserverName, design_loop
from femfit.simulation.experiment import Experiment, direct_distance, run_experiments
from femfit.simulation.loop import LoopProgress, LoopResult, Show, stage
from femfit.simulation.sensor import amplitude_spectrum, span_of
from femfit.simulation.summary import (
    FaultRow,
    HoldRow,
    SpectrumPair,
    StepRow,
    StepSeries,
    consistency,
    design_data,
    judged_loop,
)
from femfit.simulation.words import sentence

FILTERS: tuple[ObserverName, ...] = ("ukf", "ekf")

SETTLE, WINDOW = 4.0 / SETTLING_PART, 10.0
"""Time constants of the slowest unstable pole before the statistics of a hold, and of them. Derived: after four of the
slowest motion that a design allows 2 % of the release is left. Conventional: the window."""

RUNS = 16
"""Conventional: repeats of a hold; an rms over ten time constants of each is known to 6 %."""

STEP_RUNS, BARE_RUNS = 8, 8

OFFSET_SHARE, FORCE_ERROR = 0.004, 0.01
"""Conventional: offset of the first sensor over its range (20 mV of 5 V), and error of the force."""


@dataclass(frozen=True, eq=False, repr=False)
class ClosedLoopStudy(Printed):
    """Everything that command line, report and run show of the closed loop."""

    design: LoopDesign
    seed: int
    seconds: float  # Duration of one run over the reference steps
    steps: tuple[StepRow, ...]
    holds: tuple[HoldRow, ...]
    faults: tuple[FaultRow, ...]
    series: tuple[StepSeries, ...]  # One run of the reference steps a controller
    spectra: tuple[SpectrumPair, ...]  # At the smallest reference distance, of the controllers that held
    # Why nothing is compared with the direct measurement, whose rms is then NaN; empty where it is
    no_direct: str = ""

    def __str__(self) -> str:
        design = self.design
        missing = [design.why_no(name) for name in CONTROLLERS if design.why_no(name)]
        judged = [judged_loop(design, name, "ukf") for name in design.controllers]
        sections = [
            sentence("study", "held", self, missing),
            sentence("study", "steps", self),
            sentence("study", "rest", self, consistency(self.holds)),
            sentence("study", "faults", design, self.faults),
            sentence("study", "design", self, judged),
        ]
        return "\n\n".join(sections)

    def data(self) -> dict[str, Any]:
        """The numbers without time series and spectra, ready for JSON; what does not exist is null."""
        tables = ("steps", "holds", "faults")
        return {
            "model": self.design.model.name,
            "seed": self.seed,
            "no_direct": self.no_direct,
            **design_data(self.design, [(name, "ukf") for name in self.design.controllers]),
            **{name: [json_ready(asdict(row)) for row in getattr(self, name)] for name in tables},
        }


def closed_loop_study(
    model: ActuatorModel,
    seed: int = 1,
    noise: Mapping[str, float] | float | None = None,
    *,
    sensors: Sequence[str] | None = None,
    progress: LoopProgress | None = None,
) -> ClosedLoopStudy:
    """Run the study.

    Parameters
    ----------
    noise : mapping of str to float, float or None
        White noise of one sample by the sensors' names, or that of the first; the model's where None.
    sensors : sequence of str or None
        Which of the model's sensors the loops read; the Hall element, or all where there is none.
    progress : callable or None
        Called with what is simulated, the samples done and all of them, now and then.
    """
    design = design_loop(model, noise, sensors=sensors)
    if not design.controllers:
        raise DomainError(" ".join(design.why_no(name) for name in CONTROLLERS))
    steps, series = _steps(design, seed, stage(progress, "steps of the reference"))
    holds, faults, spectra = _holds(design, seed, stage(progress, "loops at rest"))
    near, far = _ends(design)
    bare = [Experiment(name, "direct", (d,)) for name, d in product(design.controllers, (near, far))]
    bare = [] if design.why_no_direct else bare
    # Apart from the other faults: a batch ends as soon as all of its runs are lost
    window, show = _window(design), stage(progress, "loops without a filter")
    options: dict[str, Any] = {"windows": (window,), "recorded": 0, "show": show}
    results = _run(design, bare, seed, BARE_RUNS, window.stop, **options) if bare else {}
    without_filter = tuple(_fault_row(e, r) for e, r in results.items())
    return ClosedLoopStudy(
        design=design,
        seed=seed,
        seconds=len(series[0].time_s) * model.sample_time_s,
        steps=steps,
        holds=holds,
        faults=(*without_filter, *faults),
        series=series,
        spectra=spectra,
        no_direct=design.why_no_direct,
    )


def _ends(design: LoopDesign) -> tuple[float, float]:
    return design.points[0].distance_m, design.points[-1].distance_m


def _window(design: LoopDesign) -> slice:
    return slice(design.steps(SETTLE), design.steps(SETTLE) + design.steps(WINDOW))


def _run(
    design: LoopDesign, experiments: Sequence[Experiment], seed: int, runs: int, steps: int, **options: Any
) -> dict[Experiment, LoopResult]:
    """Experiments side by side on the same noise."""
    results = run_experiments(design, experiments, np.random.default_rng(seed), runs=runs, steps=steps, **options)
    return dict(zip(experiments, results, strict=True))


def _holds(
    design: LoopDesign, seed: int, show: Show | None
) -> tuple[tuple[HoldRow, ...], tuple[FaultRow, ...], tuple[SpectrumPair, ...]]:
    """All loops at rest, with and without a fault, in one batch on the same noise."""
    places = list(product(design.controllers, _ends(design)))

    def everywhere(observer: ObserverName, **fault: Any) -> list[Experiment]:
        return [Experiment(controller, observer, (distance,), **fault) for controller, distance in places]

    clean = [experiment for name in FILTERS for experiment in everywhere(name)]
    clean4 = everywhere("ukf4")
    shift = OFFSET_SHARE * span_of(design.model, design.sensors[0])
    biased = [*everywhere("ukf4", offset=-shift), *everywhere("ukf4", offset=shift)]
    forces = everywhere("ukf", force_scale=1.0 + FORCE_ERROR)
    blind = [e for e in everywhere("ukf", offset=shift) if e.controller == "backstepping"]
    faulty: list[tuple[Experiment, Experiment | None]] = [
        *zip(biased, [*clean4, *clean4], strict=True),
        *((e, None) for e in blind),
        *zip(forces, clean[: len(forces)], strict=True),
    ]
    window = _window(design)
    experiments = [*clean, *clean4, *(e for e, _ in faulty)]
    results = _run(
        design,
        experiments,
        seed,
        RUNS,
        window.stop,
        windows=(window,),
        supported_steps=design.steps(SUPPORT_TIME_CONSTANTS),
        recorded=RUNS * len(clean),
        show=show,
    )
    holds: list[HoldRow] = []
    spectra: list[SpectrumPair] = []
    for e in clean:
        direct = _direct(design, results[e])[window]
        holds.append(_hold_row(design, e, results[e], direct))
        at_near = e.observer == "ukf" and e.targets_m[0] == design.points[0].distance_m
        held = results[e].held
        if at_near and held.any() and not design.why_no_direct:
            filtered, step = results[e].series.estimated_distance_m[window], design.model.sample_time_s
            frequency = np.fft.rfftfreq(len(direct), step).astype(np.float64)
            pair = amplitude_spectrum(direct[:, held]), amplitude_spectrum(filtered[:, held])
            spectra.append(SpectrumPair(e.controller, frequency, *pair))
    faults = tuple(_fault_row(e, results[e], results[c] if c else None) for e, c in faulty)
    return tuple(holds), faults, tuple(spectra)


def _direct(design: LoopDesign, result: LoopResult) -> FloatArray:
    """The direct measurement, or NaN where there is none."""
    if design.why_no_direct:
        return np.full_like(result.series.distance_m, np.nan)
    return direct_distance(design, result.series)


def _hold_row(design: LoopDesign, experiment: Experiment, result: LoopResult, direct: FloatArray) -> HoldRow:
    held, distance = result.held, experiment.targets_m[0]
    truth = result.series.distance_m[_window(design)]
    direct_rms, filtered_rms = _rms((direct - truth)[:, held]), _rms(result.windows[0].estimate_rms_m[held])
    quality, band = result.windows[0].consistency(held)
    try:  # the best ratio that a filter reaches, 1 / sqrt(2 lambda t_s)
        bound = float(1.0 / np.sqrt(2.0 * unstable_pole(design.model, distance) * design.model.sample_time_s))
    except DomainError:  # the body is stable
        bound = float("nan")
    return HoldRow(
        controller=experiment.controller,
        filter=experiment.observer,
        distance_m=distance,
        direct_rms_m=direct_rms,
        filtered_rms_m=filtered_rms,
        ratio=direct_rms / filtered_rms,
        bound=bound,
        normalised_innovation_squared=quality,
        innovation_band=band,
        held=int(held.sum()),
        runs=len(held),
    )


def _fault_row(experiment: Experiment, result: LoopResult, undisturbed: LoopResult | None = None) -> FaultRow:
    """Sum up the first window of an experiment, run by run against the same loop without the fault."""
    held, window = result.held, result.windows[0]
    shift = shift_error = float("nan")
    if undisturbed is not None and np.sum(both := held & undisturbed.held) > 1:
        moved = window.tracking_bias_m[both] - undisturbed.windows[0].tracking_bias_m[both]
        shift, shift_error = float(np.mean(moved)), float(np.std(moved, ddof=1) / np.sqrt(len(moved)))
    estimate, position = (
        float(np.mean(values[held])) if held.any() else float("nan")
        for values in (window.estimate_bias_m, window.tracking_bias_m)
    )
    return FaultRow(
        experiment=experiment,
        runs=len(held),
        outcomes=result.counts(),
        last_loss_s=float(np.nanmax(result.outcome_time_s)) if not held.all() else None,
        estimate_rms_m=_rms(window.estimate_rms_m[held]),
        estimate_bias_m=estimate,
        position_bias_m=position,
        position_shift_m=shift,
        shift_error_m=shift_error,
    )


def _steps(design: LoopDesign, seed: int, show: Show | None) -> tuple[tuple[StepRow, ...], tuple[StepSeries, ...]]:
    experiments = [Experiment(controller, "ukf", design.targets_m) for controller in design.controllers]
    steps = len(design.targets_m) * math.ceil(design.step_s / design.model.sample_time_s)
    support = design.steps(SUPPORT_TIME_CONSTANTS)
    rows: list[StepRow] = []
    drawn: list[StepSeries] = []
    for e, result in _run(design, experiments, seed, STEP_RUNS, steps, supported_steps=support, show=show).items():
        series, held, direct = result.series, result.held, _direct(design, result)
        run = int(np.argmax(held))  # the first that was held, or the first of all
        measured = {} if design.why_no_direct else {"direct": direct}
        for name, distance in (measured | {e.observer: series.estimated_distance_m}).items():
            rms = _rms((distance - series.distance_m)[:, held])
            rows.append(StepRow(e.controller, name, rms, int(held.sum()), len(held)))
        distances = (series.reference_m, series.distance_m, direct, series.estimated_distance_m)
        drives = (series.commands[..., 0], series.currents_A[..., 0])
        arrays = (array[:, run] for array in (*distances, *drives))
        drawn.append(StepSeries(e.controller, e.observer, result.time_s, *arrays))
    return tuple(rows), tuple(drawn)


def _rms(errors: FloatArray) -> float:
    return float(np.sqrt(np.mean(errors**2))) if errors.size else float("nan")
