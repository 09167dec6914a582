"""A study of closed loops as text."""

import math
from typing import TYPE_CHECKING

from femfit.core.text import amount, counted
from femfit.simulation.design import CONTROLLERS, LoopDesign
from femfit.simulation.experiment import Experiment
from femfit.simulation.loop_text import consistency_line, design_lines, losses, sensor_word, verdict
from femfit.simulation.study_rows import FaultRow

if TYPE_CHECKING:
    from femfit.simulation.study import ClosedLoopStudy


SEEN = 2.0
"""Derived: standard errors beyond which a mean is more than chance, 95 %."""


def study_lines(study: "ClosedLoopStudy") -> list[str]:
    """The whole study as text: which loops hold, how they measure, what a fault costs, and the design."""
    design = study.design
    stops = " -> ".join(f"{1e3 * d:g}" for d in design.targets_m)
    loops = [
        (Experiment(row.controller, row.measurement, design.targets_m), row.held, row.runs)  # type: ignore[arg-type]
        for row in study.steps
        if row.measurement != "direct"
    ]
    missing = [f"  {design.why_no(name)}" for name in CONTROLLERS if design.why_no(name)]
    lines = [verdict(design, study.seconds, loops), *missing, ""]
    lines += [
        f"Steps {stops} mm: rms of measured minus true distance",
        "  controller    measured by        rms",
        *(
            f"  {row.controller:12s}  {row.measurement:10s} {_length(row.rms_m)}{_lost(row.held, row.runs)}"
            for row in study.steps
        ),
        "",
        "At rest: noise of the direct measurement and of the filter, and squared errors of the filter's predictions",
        "over what it expects; no filter gains more than the bound",
        "  controller    filter  distance    direct   filtered   gain  bound  errors^2 (95 % band)",
    ]
    lines += [
        f"  {r.controller:12s}  {r.filter:6s}  {1e3 * r.distance_m:5.1f} mm {_length(r.direct_rms_m)}"
        f"  {_length(r.filtered_rms_m)}  {_ratio(r.ratio)}  {_ratio(r.bound)}  "
        f"{_ratio(r.normalised_innovation_squared, 3)} "
        f"({r.innovation_band.lower:.3f} .. {r.innovation_band.upper:.3f}){_lost(r.held, r.runs)}"
        for r in study.holds
    ]
    lines += [f"  {consistency_line(study.holds)}"] if any(row.held for row in study.holds) else []
    if study.no_direct:
        lines += [f"  no direct measurement to compare with: {study.no_direct}"]
    lines += ["", "With a fault", *(_fault_line(design, row) for row in study.faults)]
    lines += [
        "",
        "Filter started at the wrong end of the range",
        *(_fault_line(design, row) for row in study.acquisition),
    ]
    return [*lines, "", *design_lines(design, [(name, "ukf") for name in design.controllers]), f"  seed {study.seed}"]


def _length(metres: float) -> str:
    return f"{amount(metres, 'm', 3) if math.isfinite(metres) else '-':>8s}"


def _ratio(value: float, digits: int = 2) -> str:
    return f"{value:5.{digits}f}" if math.isfinite(value) else f"{'-':>5s}"


def _lost(held: int, runs: int) -> str:
    return "" if held == runs else f"  ({runs - held} of {counted(runs, 'run')} lost)"


def _fault_line(design: LoopDesign, row: FaultRow) -> str:
    """One experiment with a fault: how many runs are lost, and what the fault moves."""
    e, parts = row.experiment, []
    if row.held < row.runs:
        when = "" if row.last_loss_s is None else f", the last after {row.last_loss_s:.3f} s"
        parts.append(f"{row.runs - row.held} of {counted(row.runs, 'run')} lost ({losses(row.outcomes)}){when}")
    elif not math.isfinite(row.position_shift_m):
        parts.append(f"all {row.runs} runs held")
    if math.isfinite(row.position_shift_m):
        moved = f"moved by {amount(row.position_shift_m, 'm', 3)} +-{amount(row.shift_error_m, 'm')}"
        moves = abs(row.position_shift_m) > SEEN * row.shift_error_m
        parts.append(f"estimate off by {amount(row.estimate_bias_m, 'm', 3)}, body {moved if moves else 'not moved'}")
    elif math.isfinite(row.estimate_rms_m):
        parts.append(f"estimate within {amount(row.estimate_rms_m, 'm', 3)} rms")
    name: str = "no filter" if e.observer == "direct" else e.observer
    what = [f"{e.controller}, {name}, {1e3 * e.targets_m[0]:.4g} mm"]
    if e.offset:
        sensor = design.loop_sensors()[0]
        what.append(
            f"{sensor_word(sensor.name)} offset {'+' if e.offset > 0.0 else ''}"
            f"{amount(e.offset, sensor.reading.unit, 3)}"
        )
    if e.force_scale != 1.0:
        what.append(f"force {100.0 * (e.force_scale - 1.0):+.2g} %")
    if e.believed_m is not None:
        what.append(f"believed at {1e3 * e.believed_m:.4g} mm")
    return f"  {', '.join(what)}: {'; '.join(parts)}"
