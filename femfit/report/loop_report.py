"""The chapter on the closed loop: its figures, the numbers for its tables, and the picture of one run."""

from functools import partial
from typing import Any

import numpy as np

from femfit.report.style import (
    BLUE,
    CATEGORIES,
    GREEN,
    INK,
    MUTED,
    ORANGE,
    Drawing,
    Figure,
    new_figure,
    percent,
    quantity,
    words,
)
from femfit.simulation.design import CONTROLLERS
from femfit.simulation.experiment import Experiment
from femfit.simulation.margins import worst_of
from femfit.simulation.study import ClosedLoopStudy
from femfit.simulation.summary import FaultRow, LoopSummary, SpectrumPair, StepSeries, consistency
from femfit.simulation.words import sensor_word, sentence

MM = 1e3
MICRO = 1e6

name_of = partial(words, "loop")
"""A controller, filter or measurement as it is written."""


def loop_figures(study: ClosedLoopStudy) -> dict[str, Drawing]:
    """The figures of a study by name; none where every run was lost."""
    if not any(row.held for row in study.steps):
        return {}
    figures: dict[str, Drawing] = {f"steps-{s.controller}": partial(steps_figure, s) for s in study.series}
    return figures | {f"spectrum-{pair.controller}": partial(spectrum_figure, pair) for pair in study.spectra}


def loop_facts(study: ClosedLoopStudy) -> dict[str, Any]:
    """The numbers of a study as its template shows them."""
    design = study.design
    filtered = [row for row in study.steps if row.measurement != "direct"]
    lost, runs = sum(row.runs - row.held for row in filtered), sum(row.runs for row in filtered)
    held = [row for row in study.holds if row.held]
    shares = [row.ratio / row.bound for row in held if np.isfinite(row.ratio)]
    return {
        "study": study,
        "first": design.points[0],
        "last": design.points[-1],
        "lost": lost,
        "runs": runs,
        "verdict": [(name_of(row.controller), row.held, row.runs, row.rms_m) for row in filtered],
        "ratios": (min(r.ratio for r in held), max(r.ratio for r in held)) if shares else None,
        "bounds": (min(r.bound for r in held), max(r.bound for r in held)) if shares else None,
        "shares": (min(shares), max(shares)) if shares else None,
        "consistency": sentence("loop", "consistency", consistency(study.holds)),
        "ends": _ends(study),
        "series": [(f"steps-{s.controller}", name_of(s.controller), name_of(s.observer)) for s in study.series],
        "spectra": [(f"spectrum-{p.controller}", name_of(p.controller)) for p in study.spectra],
        "controllers": list(dict.fromkeys(row.controller for row in study.steps)),
        "margins": [
            (name_of(name), sentence("loop", "margins", design, worst_of(design.margins(name, "ukf"))))
            for name in design.controllers
        ],
        "gains": [
            (name_of(name), sentence("loop", "gains", design, design.controller(name))) for name in design.controllers
        ],
        "bounded": any(np.isfinite(row.bound) for row in study.holds),
        "missing": [(name_of(name), design.why_no(name)) for name in CONTROLLERS if design.why_no(name)],
        "sensors": sentence("loop", "sensors", design),
        "observed": sentence("loop", "observed", design),
        "measurements": list(dict.fromkeys(row.measurement for row in study.steps)),
        "steps": {(row.measurement, row.controller): row for row in study.steps},
        "faults": _fault_rows(study),
    }


def _ends(study: ClosedLoopStudy) -> list[tuple[str, float, float, float]]:
    """Where each recorded run was last: controller, distance in m, current in A, time in s."""
    ends = []
    for series in study.series:
        recorded = np.flatnonzero(np.isfinite(series.true_m))
        if recorded.size:
            last = int(recorded[-1])
            place = float(series.true_m[last]), float(series.current_A[last]), float(series.time_s[last])
            ends.append((name_of(series.controller), *place))
    return ends


def _fault_rows(study: ClosedLoopStudy) -> tuple[list[float], list[tuple[str, str, list[FaultRow | None]]]]:
    """Distances, and for each loop and fault what became of it at each of them."""
    faults = study.faults
    distances = sorted({row.experiment.targets_m[0] for row in faults})
    cells: dict[tuple[str, str], dict[float, FaultRow]] = {}
    for row in faults:
        e = row.experiment
        key = (f"{name_of(e.controller)}, {name_of(e.observer)}", _fault(study, e))
        cells.setdefault(key, {})[e.targets_m[0]] = row
    return distances, [(*key, [ends.get(d) for d in distances]) for key, ends in cells.items()]


def _fault(study: ClosedLoopStudy, experiment: Experiment) -> str:
    if experiment.offset:
        reading = study.design.loop_sensors()[0].reading
        return f"{sensor_word(reading.name)} offset {quantity(experiment.offset, reading.unit, 2)}"
    if experiment.force_scale != 1.0:
        return f"true force {percent(experiment.force_scale - 1.0)} above the model's"
    return "no filter"


def steps_figure(series: StepSeries) -> Figure:
    """Draw reference steps: distances, errors of both measurements, coil voltage; noisy curves are rasterised."""
    figure = new_figure(5.0)
    top, middle, bottom = figure.subplots(3, 1, sharex=True, height_ratios=(2.2, 1.3, 1.0))
    t = series.time_s
    has_direct = bool(np.isfinite(series.direct_m).any())
    if has_direct:
        direct = MM * series.direct_m
        top.plot(t, direct, color=ORANGE, linewidth=0.5, label=name_of("direct"), rasterized=True)
        middle.plot(t, direct - MM * series.true_m, color=ORANGE, linewidth=0.5, rasterized=True)
    top.plot(t, MM * series.estimated_m, color=BLUE, linewidth=1.3, label=name_of(series.observer))
    top.plot(t, MM * series.true_m, color=INK, linewidth=0.9, dashes=(4, 2), label=words("loop", "true"))
    top.plot(t, MM * series.reference_m, color=GREEN, linewidth=0.9, label=words("loop", "reference"))
    top.set_ylabel(words("loop", "distance"))
    middle.plot(t, MM * (series.estimated_m - series.true_m), color=BLUE, linewidth=0.9, rasterized=True)
    middle.set_ylabel(words("loop", "error"))
    bottom.plot(t, series.voltage_V, color=MUTED, linewidth=0.6, rasterized=True)
    bottom.set(ylabel=words("loop", "voltage"), xlabel=words("loop", "time"))
    figure.align_ylabels()
    figure.legend(*top.get_legend_handles_labels(), loc="outside upper center", ncols=4)
    return figure


def spectrum_figure(pair: SpectrumPair) -> Figure:
    """Draw spectra of the direct measurement and of the filter at rest."""
    figure = new_figure(2.8)
    axes = figure.subplots()
    keep = pair.frequency_Hz > 0.0
    for amplitude, colour, name in ((pair.direct_m, ORANGE, "direct"), (pair.filtered_m, BLUE, "ukf")):
        axes.loglog(pair.frequency_Hz[keep], MICRO * amplitude[keep], color=colour, linewidth=1.1, label=name_of(name))
    axes.set(xlabel=words("loop", "frequency"), ylabel=words("loop", "amplitude"))
    axes.legend(loc="lower left")
    return figure


def closed_loop_figure(loop: LoopSummary) -> Figure:
    """Draw distances, currents and commands of the first recorded run over time."""
    figure = new_figure(5.0)
    top, middle, bottom = figure.subplots(3, 1, sharex=True, height_ratios=(2.0, 1.0, 1.0))
    series, time = loop.result.series, loop.result.time_s
    top.plot(time, 1e3 * series.estimated_distance_m[:, 0], color=BLUE, label=words("loop", loop.experiment.observer))
    top.plot(time, 1e3 * series.distance_m[:, 0], color=INK, dashes=(4, 2), label=words("loop", "true"))
    top.plot(time, 1e3 * series.reference_m[:, 0], color=GREEN, label=words("loop", "reference"))
    top.set_ylabel(words("loop", "distance"))
    names = loop.design.model.circuit_names
    for k, name in enumerate(names):
        look = CATEGORIES[k % len(CATEGORIES)]
        middle.plot(time, series.currents_A[:, 0, k], color=look, label=name)
        bottom.plot(time, series.commands[:, 0, k], color=look, linewidth=0.6, rasterized=True)
    if len(names) > 1:
        middle.legend(ncols=len(names))
    middle.set_ylabel(words("loop", "current"))
    bottom.set(ylabel=words("loop", "voltage"), xlabel=words("loop", "time"))
    figure.align_ylabels()
    figure.legend(*top.get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return figure
