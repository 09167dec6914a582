"""A study of the closed loop as lines of text, the answer first, and as data for JSON."""

import math
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from femfit.core.amount import amount
from femfit.core.atomic import json_ready
from femfit.simulation.design import LoopDesign
from femfit.simulation.experiment import Experiment
from femfit.simulation.fault import FaultRow

if TYPE_CHECKING:
    from femfit.simulation.study import ClosedLoopStudy


def study_lines(study: "ClosedLoopStudy") -> list[str]:
    """The whole study: which loops hold, how they measure, what a fault costs, and the design."""
    design = study.design
    stops = " -> ".join(f"{1e3 * d:g}" for d in design.targets_m)
    lines = [f"Closed loop of {design.model.name}: {_verdict(study)}", ""]
    lines += [
        f"Steps {stops} mm: rms of measured minus true distance",
        "  controller    measured by        rms",
        *(
            f"  {row.controller:12s}  {row.measurement:10s} {_length(row.rms_m)}{_lost(row.held, row.runs)}"
            for row in study.steps
        ),
        "",
        "At rest: noise of the direct measurement and of the filter; no filter gains more than the bound",
        "  controller    filter  distance    direct   filtered   gain  bound  innovations^2 (95 % band)",
    ]
    lines += [
        f"  {r.controller:12s}  {r.filter:6s}  {1e3 * r.distance_m:5.1f} mm {_length(r.direct_rms_m)}"
        f"  {_length(r.filtered_rms_m)}  {_ratio(r.ratio)}  {r.bound:5.2f}  {r.normalised_innovation_squared:.3f} "
        f"({r.innovation_band.lower:.3f} .. {r.innovation_band.upper:.3f}){_lost(r.held, r.runs)}"
        for r in study.holds
    ]
    if study.no_direct:
        lines += [f"  no direct measurement to compare with: {study.no_direct}"]
    lines += ["", "With a fault", *map(fault_line, study.faults)]
    lines += ["", "Filter started at the wrong end of the range", *map(fault_line, study.acquisition)]
    return [*lines, "", *design_lines(design), f"  seed {study.seed}"]


def _verdict(study: "ClosedLoopStudy") -> str:
    """Which controllers hold the body over the reference steps with their filter."""
    rows = [row for row in study.steps if row.measurement != "direct"]
    held = [row.controller for row in rows if row.held == row.runs]
    lost = [f"{row.controller} loses {row.runs - row.held} of {row.runs} runs" for row in rows if row.held < row.runs]
    parts = [f"{' and '.join(held)} {'holds' if len(held) == 1 else 'hold'} the body in all runs"] if held else []
    return "; ".join([*parts, *lost]) + "."


def design_lines(design: LoopDesign) -> list[str]:
    """Operating points and gains."""
    lines = ["Design from the model", "  distance  voltage  current  unstable pole  coil pole"]
    lines += [
        f"  {1e3 * p.distance_m:5.1f} mm  {p.voltage_V:5.3f} V  {p.current_A:5.3f} A"
        f"  {p.mechanical_pole_rad_s:6.1f} rad/s   {p.coil_pole_rad_s:6.1f} rad/s"
        for p in (design.points[0], design.points[len(design.points) // 2], design.points[-1])
    ]
    b, pid = design.backstepping, design.pid
    if pid is None:
        linear = f"no PID: {design.why_no_pid}"
    else:
        gains = ", ".join(f"{gain:.5g}" for gain in pid.gains_V_m)
        linear = f"PID: filter pole {pid.filter_pole:.4f}, gains {gains} V/m"
    sample, noise = 1e3 * design.model.sample_time_s, 1e3 * design.noise_V
    return [
        *lines,
        (
            f"  backstepping: position gain {b.position_gain:.4g} 1/s^2, velocity gain {b.velocity_gain:.4g} 1/s, "
            f"current gain {b.current_gain_ohm:.4g} ohm"
        ),
        f"  {linear}",
        f"  reference filters {design.reference_rate_rad_s:.4g} rad/s, sample time {sample:g} ms, "
        + (f"Hall noise {noise:.3g} mV rms" if noise else "no Hall noise"),
    ]


def study_data(study: "ClosedLoopStudy") -> dict[str, Any]:
    """The study's numbers without its time series and spectra, ready for JSON; what does not exist is null."""
    design, tables = study.design, ("steps", "holds", "faults", "acquisition")
    return {
        "model": design.model.name,
        "seed": study.seed,
        "no_direct": study.no_direct,
        **design_data(design),
        **{name: [json_ready(asdict(row)) for row in getattr(study, name)] for name in tables},
    }


def design_data(design: LoopDesign) -> dict[str, Any]:
    """Reference, gains and operating points, ready for JSON."""
    pid = design.pid
    return {
        "noise_V": design.noise_V,
        "targets_m": list(design.targets_m),
        "reference_rate_rad_s": design.reference_rate_rad_s,
        "backstepping": {
            "position_gain_1_s2": design.backstepping.position_gain,
            "velocity_gain_1_s": design.backstepping.velocity_gain,
            "current_gain_ohm": design.backstepping.current_gain_ohm,
        },
        "pid": None if pid is None else {"filter_pole": pid.filter_pole, "gains_V_m": list(pid.gains_V_m)},
        "no_pid": design.why_no_pid,
        "points": [
            {
                "distance_m": p.distance_m,
                "current_A": p.current_A,
                "voltage_V": p.voltage_V,
                "unstable_pole_rad_s": p.mechanical_pole_rad_s,
                "coil_pole_rad_s": p.coil_pole_rad_s,
            }
            for p in design.points
        ],
    }


def _length(metres: float) -> str:
    return f"{amount(metres, 'm', 3):>8s}" if math.isfinite(metres) else f"{'-':>8s}"


def _ratio(value: float) -> str:
    return f"{value:5.2f}" if math.isfinite(value) else f"{'-':>5s}"


def _lost(held: int, runs: int) -> str:
    return "" if held == runs else f"  ({runs - held} of {runs} runs lost)"


def fault_line(row: FaultRow) -> str:
    """One experiment with a fault: how many runs are lost, and what the fault moves."""
    parts = []
    if row.held < row.runs:
        lost = ", ".join(
            f"{n} x {name.lower().replace('_', ' ')}" for name, n in row.outcomes.items() if name != "HELD"
        )
        when = "" if row.last_loss_s is None else f", the last after {row.last_loss_s:.3f} s"
        parts.append(f"{row.runs - row.held} of {row.runs} runs lost ({lost}){when}")
    elif not math.isfinite(row.position_shift_m):
        parts.append(f"all {row.runs} runs held")
    if math.isfinite(row.position_shift_m):
        parts.append(
            f"estimate off by {amount(row.estimate_bias_m, 'm', 3)}, "
            f"body moved by {amount(row.position_shift_m, 'm', 3)} +-{amount(row.shift_error_m, 'm')}"
        )
    elif math.isfinite(row.estimate_rms_m):
        parts.append(f"estimate within {amount(row.estimate_rms_m, 'm', 3)} rms")
    return f"  {describe(row.experiment)}: {'; '.join(parts)}"


def describe(e: Experiment) -> str:
    """Controller, filter, place and what is wrong with the loop."""
    name: str = "no filter" if e.observer == "direct" else e.observer
    parts = [f"{e.controller}, {name}, {1e3 * e.targets_m[0]:.4g} mm"]
    if e.noise_V is not None:
        parts.append(f"noise {1e3 * e.noise_V:.3g} mV" if e.noise_V else "no noise")
    if e.offset_V:
        parts.append(f"Hall offset {1e3 * e.offset_V:+.3g} mV")
    if e.force_scale != 1.0:
        parts.append(f"force {100.0 * (e.force_scale - 1.0):+.2g} %")
    if e.believed_m is not None:
        parts.append(f"believed at {1e3 * e.believed_m:.4g} mm")
    return ", ".join(parts)
