"""The chapter on the closed loop: its figures, the numbers for its tables, and the picture of one run."""

from functools import partial
from typing import Any

import numpy as np

from femfit.report.style import BLUE, CATEGORIES, GREEN, INK, Drawing, Figure, new_figure, words
from femfit.simulation.design import CONTROLLERS
from femfit.simulation.margins import worst_of
from femfit.simulation.study import FILTER, ClosedLoopStudy
from femfit.simulation.summary import LoopSummary
from femfit.simulation.words import sentence

name_of = partial(words, "loop")
"""A controller, filter or measurement as it is written."""


def loop_figures(study: ClosedLoopStudy) -> dict[str, Drawing]:
    """The figures of a study by name; none where every run was lost."""
    held = [loop for loop in study.loops if loop.held]
    return {f"steps-{loop.experiment.controller}": partial(closed_loop_figure, loop) for loop in held}


def loop_facts(study: ClosedLoopStudy) -> dict[str, Any]:
    """The numbers of a study as its template shows them."""
    design = study.design
    lost, runs = sum(loop.runs - loop.held for loop in study.loops), sum(loop.runs for loop in study.loops)
    filtered = [row for row in study.steps if row.measurement != "direct"]
    return {
        "study": study,
        "first": design.points[0],
        "last": design.points[-1],
        "lost": lost,
        "runs": runs,
        "verdict": [(name_of(row.controller), row.held, row.runs, row.rms_m) for row in filtered],
        "series": [
            (f"steps-{loop.experiment.controller}", name_of(loop.experiment.controller), name_of(FILTER))
            for loop in study.loops
            if loop.held
        ],
        "controllers": list(dict.fromkeys(row.controller for row in study.steps)),
        "margins": [
            (name_of(name), sentence("loop", "margins", design, worst_of(design.margins(name, "ukf"))))
            for name in design.controllers
        ],
        "gains": [
            (name_of(name), sentence("loop", "gains", design, design.controller(name))) for name in design.controllers
        ],
        "missing": [(name_of(name), design.why_no(name)) for name in CONTROLLERS if design.why_no(name)],
        "sensors": sentence("loop", "sensors", design),
        "measurements": list(dict.fromkeys(row.measurement for row in study.steps)),
        "steps": {(row.measurement, row.controller): row for row in study.steps},
    }


def closed_loop_figure(loop: LoopSummary) -> Figure:
    """Draw distances, currents and commands over time, of the first recorded run that was held, or the first of all."""
    figure = new_figure(5.0)
    top, middle, bottom = figure.subplots(3, 1, sharex=True, height_ratios=(2.0, 1.0, 1.0))
    series, time = loop.result.series, loop.result.time_s
    run = int(np.argmax(loop.result.held[: series.distance_m.shape[1]]))
    top.plot(time, 1e3 * series.estimated_distance_m[:, run], color=BLUE, label=words("loop", loop.experiment.observer))
    top.plot(time, 1e3 * series.distance_m[:, run], color=INK, dashes=(4, 2), label=words("loop", "true"))
    top.plot(time, 1e3 * series.reference_m[:, run], color=GREEN, label=words("loop", "reference"))
    top.set_ylabel(words("loop", "distance"))
    names = loop.design.model.circuit_names
    for k, name in enumerate(names):
        look = CATEGORIES[k % len(CATEGORIES)]
        middle.plot(time, series.currents_A[:, run, k], color=look, label=name)
        bottom.plot(time, series.commands[:, run, k], color=look, linewidth=0.6, rasterized=True)
    if len(names) > 1:
        middle.legend(ncols=len(names))
    middle.set_ylabel(words("loop", "current"))
    bottom.set(ylabel=words("loop", "voltage"), xlabel=words("loop", "time"))
    figure.align_ylabels()
    figure.legend(*top.get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return figure
