"""What is said of a closed loop, by one loop and by a study of many: the first line, numbers, the design."""

from collections.abc import Mapping, Sequence
from typing import Any

from femfit.core.amount import counted
from femfit.core.quoted import quoted
from femfit.simulation.design import LoopDesign
from femfit.simulation.experiment import Experiment
from femfit.simulation.loop import LoopOutcome

POINT = ("distance_m", "current_A", "voltage_V", "unstable_pole_rad_s", "coil_pole_rad_s")
"""What is written of a point of rest."""


def verdict(
    design: LoopDesign, seconds: float, loops: Sequence[tuple[Experiment, int, int]], plant: str | None = None
) -> str:
    """The first line: were all runs held, and with what; each loop comes with its runs held and all its runs."""
    held, runs = sum(held for _, held, _ in loops), sum(runs for *_, runs in loops)
    word = "Held" if held == runs else "Lost" if held == 0 else "Lost in part"
    apart = len(loops) > 1 and 0 < held < runs
    names = ", ".join(
        f"{e.controller} on {e.observer}{f' {own} of {all_own}' if apart else ''}" for e, own, all_own in loops
    )
    around = f" around the plant {quoted(plant)}" if plant else ""
    model = quoted(design.model.name)
    return f"{word}: {held} of {counted(runs, 'run')} of {seconds:.3g} s held the body; {names}, {model}{around}"


def losses(outcomes: Mapping[str, int]) -> str:
    """How runs were lost, in a few words."""
    return ", ".join(
        f"{count} {name.lower().replace('_', ' ')}" for name, count in outcomes.items() if name != LoopOutcome.HELD.name
    )


def design_lines(design: LoopDesign) -> list[str]:
    """Operating points and gains."""
    b, pid = design.backstepping, design.pid
    if pid is None:
        linear = f"no PID: {design.why_no_pid}"
    else:
        gains = ", ".join(f"{gain:.5g}" for gain in pid.gains_V_m)
        linear = f"PID: filter pole {pid.filter_pole:.4f}, gains {gains} V/m"
    sample, noise = 1e3 * design.model.sample_time_s, 1e3 * design.noise_V
    return [
        "Design from the model",
        "  distance  voltage  current  unstable pole  coil pole",
        *(
            f"  {1e3 * p.distance_m:5.1f} mm  {p.voltage_V:5.3f} V  {p.current_A:5.3f} A"
            f"  {p.unstable_pole_rad_s:6.1f} rad/s   {p.coil_pole_rad_s:6.1f} rad/s"
            for p in (design.points[0], design.points[len(design.points) // 2], design.points[-1])
        ),
        (
            f"  backstepping: position gain {b.position_gain:.4g} 1/s^2, velocity gain {b.velocity_gain:.4g} 1/s, "
            f"current gain {b.current_gain_ohm:.4g} ohm"
        ),
        f"  {linear}",
        f"  reference filters {design.reference_rate_rad_s:.4g} rad/s, sample time {sample:g} ms, "
        + (f"Hall noise {noise:.3g} mV rms" if noise else "no Hall noise"),
    ]


def design_data(design: LoopDesign) -> dict[str, Any]:
    """Reference, gains and operating points, ready for JSON."""
    pid, b = design.pid, design.backstepping
    return {
        "noise_V": design.noise_V,
        "targets_m": list(design.targets_m),
        "reference_rate_rad_s": design.reference_rate_rad_s,
        "backstepping": {
            "position_gain_1_s2": b.position_gain,
            "velocity_gain_1_s": b.velocity_gain,
            "current_gain_ohm": b.current_gain_ohm,
        },
        "pid": None if pid is None else {"filter_pole": pid.filter_pole, "gains_V_m": list(pid.gains_V_m)},
        "no_pid": design.why_no_pid,
        "points": [{name: getattr(point, name) for name in POINT} for point in design.points],
    }
