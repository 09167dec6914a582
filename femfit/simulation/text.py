"""The closed loop's numbers as lines of text and as JSON-ready data."""

import math
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from femfit.simulation.design import CONTROLLERS, LoopDesign
from femfit.simulation.experiment import Experiment
from femfit.simulation.monte_carlo import MonteCarloSummary
from femfit.simulation.outcome import LoopOutcome
from femfit.simulation.study import ClosedLoopStudy
from femfit.simulation.study_rows import LossRow, ShiftRow
from femfit.simulation.table6 import PAPER_RMS_M

PAPER_ACTUATOR = "emaws"
"""Name, or its beginning, of the actuator whose Table 6 the paper prints."""


def design_lines(design: LoopDesign) -> list[str]:
    """Operating points and gains."""
    lines = ["  distance  voltage  current  unstable pole  coil pole"]
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
        f"  backstepping: position gain {b.position_gain:.4g} 1/s^2, velocity gain {b.velocity_gain:.4g} 1/s",
        f"  current gain of backstepping {b.current_gain_ohm:.4g} ohm",
        f"  {linear}",
        f"  reference filters {design.reference_rate_rad_s:.4g} rad/s, t_s {sample:g} ms, "
        + (f"Hall noise {noise:g} mV rms" if noise else "no Hall noise"),
    ]


def study_lines(study: ClosedLoopStudy) -> list[str]:
    """The whole study, section by section."""
    design = study.design
    own = design.model.name.startswith(PAPER_ACTUATOR)
    stops = " -> ".join(f"{1e3 * d:g}" for d in design.targets_m)
    title = "paper" if own else "paper (of another actuator)"
    lines = [f"Closed loop of {design.model.name}, seed {study.seed}", *design_lines(design), ""]
    if study.no_direct:
        lines += [f"Filters alone, nothing to compare them with: {study.no_direct}", ""]
    lines += [
        f"Table 6: rms of (true - measured distance) over {stops} mm",
        f"  controller    measured by      rms  {title}",
    ]
    for row in study.table6:
        paper = "       -" if row.paper_rms_m is None else f"{_um(row.paper_rms_m)}"
        lines.append(
            f"  {row.controller:12s}  {row.measurement:10s} {_um(row.rms_m)}  {paper}{_lost(row.held, row.runs)}"
        )
    if own:
        ratios = (PAPER_RMS_M[c, "direct"] / PAPER_RMS_M[c, "ukf"] for c in CONTROLLERS)
        text = " and ".join(f"{ratio:.1f}" for ratio in ratios)
        bounds = sorted({row.bound for row in study.holds})
        lines.append(
            f"  the paper's ratios are {text}; white noise allows {bounds[0]:.2f} .. {bounds[-1]:.2f} (next table)"
        )
    lines += [
        "",
        "At rest: direct against filtered rms; the bound is 1/sqrt(2 lambda t_s)",
        "  controller    filter  distance    direct   filtered  ratio  bound  innovations^2 (95 % band)",
    ]
    lines += [
        f"  {r.controller:12s}  {r.filter:6s}  {1e3 * r.distance_m:5.1f} mm {_um(r.direct_rms_m)}"
        f"  {_um(r.filtered_rms_m)}  {_ratio(r.ratio)}  {r.bound:5.2f}  {r.normalised_innovation_squared:.3f} "
        f"({r.innovation_band.lower:.3f} .. {r.innovation_band.upper:.3f}){_lost(r.held, r.runs)}"
        for r in study.holds
    ]
    if not study.no_direct:
        lines += ["", "Direct measurement as feedback, one second", *map(_loss_line, study.direct_feedback)]
    lines += ["", "Filter started at the wrong end of the range", *map(_loss_line, study.acquisition)]
    lines += ["", "Hall bias that the filter estimates (four states)", *map(_shift_line, study.hall_bias)]
    lines += ["", "The same bias without the fourth state", *map(_loss_line, study.hall_bias_three_states)]
    lines += ["", "Force error of the model (three states)", *map(_shift_line, study.force_error)]
    return lines


def summary_lines(summary: MonteCarloSummary) -> list[str]:
    """One repeated loop.

    Returns
    -------
    list of str
        Lines; each outcome with the sentence that says what to do.
    """
    experiment = summary.experiment
    lines = [f"{experiment.controller} on {experiment.observer}: {summary.runs} runs of {summary.steps} samples"]
    lines += [f"  {count} x {name}: {LoopOutcome[name].sentence}" for name, count in summary.outcomes.items()]
    if summary.last_loss_s is not None:
        lines.append(f"  lost between {summary.first_loss_s:.4g} and {summary.last_loss_s:.4g} s")
    if summary.outcomes.get(LoopOutcome.HELD.name):
        for text, spread in (
            ("estimated - true distance", summary.estimate_rms_m),
            ("true distance - reference", summary.tracking_rms_m),
        ):
            lines.append(f"  rms of {text}: median{_um(spread.median)}, 95 % below{_um(spread.upper)}")
    if summary.normalised_innovation_squared is not None:
        band = summary.innovation_band
        lines.append(
            f"  normalised innovations squared {summary.normalised_innovation_squared:.4f} "
            f"(95 % band {band.lower:.4f} .. {band.upper:.4f})"
        )
    return lines


def study_data(study: ClosedLoopStudy) -> dict[str, Any]:
    """The study's numbers without its time series and spectra.

    Returns
    -------
    dict
        JSON-ready; numbers that do not exist are null.
    """
    design = study.design
    pid = design.pid
    tables = (
        "table6",
        "holds",
        "direct_feedback",
        "acquisition",
        "hall_bias",
        "hall_bias_three_states",
        "force_error",
    )
    return {
        "model": design.model.name,
        "seed": study.seed,
        "noise_V": design.noise_V,
        "targets_m": list(design.targets_m),
        "no_direct": study.no_direct,
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
        **{name: [json_ready(asdict(row)) for row in getattr(study, name)] for name in tables},
    }


def json_ready(value: Any) -> Any:
    """Tuples to lists, and what is no finite number to null."""
    if isinstance(value, Mapping):
        return {key: json_ready(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [json_ready(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def _um(metres: float) -> str:
    return f"{1e6 * metres:8.2f} um" if math.isfinite(metres) else f"{'-':>8s} um"


def _ratio(value: float) -> str:
    return f"{value:5.2f}" if math.isfinite(value) else f"{'-':>5s}"


def _lost(held: int, runs: int) -> str:
    return "" if held == runs else f"  ({runs - held} of {runs} runs lost)"


def _what(e: Experiment) -> str:
    name: str = "direct, raw derivative" if e.observer == "direct" else e.observer
    if math.isfinite(e.velocity_cutoff_rad_s):
        name = f"direct, derivative below {e.velocity_cutoff_rad_s:.0f} rad/s"
    parts = [f"{e.controller}, {name}, {1e3 * e.targets_m[0]:g} mm"]
    if e.noise_V is not None:
        parts.append(f"noise {1e3 * e.noise_V:g} mV" if e.noise_V else "no noise")
    if e.offset_V:
        parts.append(f"bias {1e3 * e.offset_V:+g} mV")
    if e.force_scale != 1.0:
        parts.append(f"force {100.0 * (e.force_scale - 1.0):+.2g} %")
    if e.believed_m is not None:
        parts.append(f"believed at {1e3 * e.believed_m:g} mm")
    return ", ".join(parts)


def _loss_line(row: LossRow) -> str:
    outcomes = ", ".join(f"{count} x {name}" for name, count in row.outcomes.items())
    when = "" if row.last_loss_s is None else f", last after {row.last_loss_s:.3f} s"
    rms = "" if row.estimate_rms_m is None else f", estimate rms{_um(row.estimate_rms_m)}"
    return f"  {_what(row.experiment)}: {outcomes}{when}{rms}"


def _shift_line(row: ShiftRow) -> str:
    return (
        f"  {_what(row.experiment)}: estimate off by{_um(row.estimate_bias_m)}, "
        f"body moved by{_um(row.position_shift_m)} +-{_um(row.shift_error_m)}{_lost(row.held, row.runs)}"
    )
