"""Why no controller of a kind was found: what stands against it, and which other one is stable in its place."""

from dataclasses import replace
from typing import TYPE_CHECKING

from femfit.core.amount import amount, counted
from femfit.core.errors import DomainError

if TYPE_CHECKING:
    from femfit.simulation.design import ControllerName, LoopDesign
    from femfit.simulation.tune import Bench


def why_none(design: "LoopDesign", name: "ControllerName", bench: "Bench") -> str:
    """What is said where no controller of this name is stable; others are advised only where they are."""
    points = design.points
    unstable = max(point.unstable_pole_rad_s for point in points)
    slowest = min(point.coil_pole_rad_s for point in points)
    start = (
        f"No {name} was found that keeps this body at rest from the nearest to the farthest distance of the reference: "
    )
    rivals: list[ControllerName] = ["backstepping", "state-feedback"]
    stable = [rival for rival in rivals if rival != name and _is_stable(design, rival, bench)]
    instead = f"{' or '.join(stable)}, which feeds back the current, or " if stable else ""
    late = design.latency * design.model.sample_time_s
    if design.latency and not replace(design, latency=0, given={}).why_no(name):
        return (
            f"{start}the latency of {counted(design.latency, 'sample')}, {amount(late, 's')}, stands against it, since "
            f"without it there is one. Use {instead}a shorter latency."
        )
    between = f", the latency {amount(late, 's')}" if late else ""
    return (
        f"{start}its unstable pole at constant current is {unstable:.4g} rad/s, the coil's R/L {slowest:.4g} rad/s, "
        f"the sample time {amount(design.model.sample_time_s, 's')}{between}. Use {instead}a faster coil, sensors with "
        "less delay, or reference distances that are nearer to each other."
    )


def _is_stable(design: "LoopDesign", name: "ControllerName", bench: "Bench") -> bool:
    try:
        return bench.growth(design.controller(name)) < 0.0
    except DomainError:
        return False
