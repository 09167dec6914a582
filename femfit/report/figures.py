"""What can be drawn of a result: its figures by name, for pages, pictures and ``plot()``."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from femfit.device.parts import Actuator
from femfit.estimate.observe import Observation
from femfit.fit.build import swept_rows
from femfit.fit.result import FitResult
from femfit.identify.before_after import AddResult
from femfit.identify.compare import Comparison
from femfit.identify.decision.diagnose import Diagnosis
from femfit.model.actuator_model import ActuatorModel
from femfit.report.drawing import actuator_figure
from femfit.report.field_figures import PICTURES, field_figure, middle_point, view_figure
from femfit.report.field_sample import solve_point
from femfit.report.misfit_figures import bench_of, covariate_figure, curves_figure, residual_maps_figure
from femfit.report.model_figures import (
    circuits_figure,
    force_curves_figure,
    hall_figure,
    several_circuits,
    stroke_figure,
    sweep_grid,
)
from femfit.report.motion_figures import closed_loop_figure, open_loop_figure, replay_figure, sense_figure
from femfit.report.page import ReportContent, drawing_of, hangs
from femfit.report.style import Drawing
from femfit.simulation.open_result import OpenLoop
from femfit.simulation.sense import Sensing
from femfit.simulation.summary import ClosedLoopStudy, LoopSummary
from femfit.tables.sweep_table import SweepTable


def figures_of(result: object) -> dict[str, Drawing]:
    """The figures of a result by name, the one that says most first; what one needs is worked out when it is drawn."""
    return next((figures(result) for kind, figures in _FIGURES if isinstance(result, kind)), {})


def _of_actuator(actuator: Actuator) -> dict[str, Drawing]:
    """The drawing, and what ``femfit view`` shows of its field in the middle of the sweep."""
    solve = partial(solve_point, actuator, *middle_point(actuator))
    middle_m = float(np.median(actuator.sweep.distances_m))
    figures: dict[str, Drawing] = {"actuator": partial(actuator_figure, actuator, middle_m)}
    return figures | {what: lambda what=what: view_figure(what, solve()) for what in PICTURES}


def _of_sweep(table: SweepTable) -> dict[str, Drawing]:
    rows, actuator = swept_rows(table, table.manifest.get("actuator") or {}), drawing_of(table)
    grid = None if rows.several else sweep_grid(rows)
    weight = rows.weight if hangs(actuator, rows) else None
    figures: dict[str, Drawing] = {} if grid is None else {"force-curves": partial(force_curves_figure, grid, weight)}
    return figures if actuator is None else figures | _of_actuator(actuator)


def _of_content(content: ReportContent) -> dict[str, Drawing]:
    model, actuator, rows = content.model, content.actuator, content.rows
    weight, several = content.weight if hangs(actuator, rows) else None, len(model.current_names) > 1
    figures: dict[str, Drawing] = {}
    if model.circuit is not None:
        figures["stroke"] = lambda: stroke_figure(content.feeds, model.motion)
    if content.motion is not None:
        figures["motion"] = partial(open_loop_figure, content.motion)
    if several:
        figures["force-curves"] = lambda: force_curves_figure(several_circuits(model).grid, weight, "differential")
        figures["circuits"] = lambda: circuits_figure(several_circuits(model))
    elif content.grid is not None:
        figures["force-curves"] = partial(force_curves_figure, content.grid, weight)
    if rows is not None and rows.hall is not None and model.sensor is not None and not several:
        figures["hall"] = partial(hall_figure, model, rows)
    if actuator is not None:
        middle_m = content.field.distance_m if content.field else float(np.median(actuator.sweep.distances_m))
        figures["actuator"] = partial(actuator_figure, actuator, middle_m)
        if content.field is not None:
            figures["field"] = partial(field_figure, actuator, content.field)
    return figures if content.study is None else figures | figures_of(content.study)


def _of_loops(*loops: LoopSummary) -> dict[str, Drawing]:
    recorded = [loop for loop in loops if loop.result.series.distance_m.size]
    return {f"steps-{loop.experiment.controller}": partial(closed_loop_figure, loop) for loop in recorded}


def _of_bench(result: Comparison | Diagnosis | AddResult) -> dict[str, Drawing]:
    bench = bench_of(result)
    figures: dict[str, Drawing] = {}
    for channel in bench.channels:
        figures[f"curves-{channel}"] = partial(curves_figure, bench, channel)
    if not isinstance(result, AddResult):
        figures["misfit-maps"] = partial(residual_maps_figure, bench)
    if bench.covariates:
        figures["misfit-covariates"] = partial(covariate_figure, bench)
    return figures


_FIGURES: tuple[tuple[type, Callable[[Any], dict[str, Drawing]]], ...] = (
    (Actuator, _of_actuator),
    (SweepTable, _of_sweep),
    (ActuatorModel, lambda model: _of_content(ReportContent(model))),
    (FitResult, lambda fit: _of_content(ReportContent(fit.model, fit=fit))),
    (ReportContent, _of_content),
    (OpenLoop, lambda motion: {"motion": partial(open_loop_figure, motion)}),
    (LoopSummary, _of_loops),
    (ClosedLoopStudy, lambda study: _of_loops(*(loop for loop in study.loops if loop.held))),
    (Sensing, lambda sensing: {"sensing": partial(sense_figure, sensing)}),
    (Observation, lambda observation: {"replay": partial(replay_figure, observation)}),
    (Comparison, _of_bench),
    (Diagnosis, _of_bench),
    (AddResult, _of_bench),
)
"""Where a kind of result has its figures."""
