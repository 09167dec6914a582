"""What is said of a closed loop, by one loop and by a study of many: the first line, the design, its margins."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from math import degrees, inf, isfinite
from typing import Any

import numpy as np

from femfit.core.errors import DomainError, FilterError
from femfit.core.files import json_ready
from femfit.core.text import amount, counted, quoted
from femfit.model.sensors import HALL
from femfit.simulation.adjust import gains_of
from femfit.simulation.blind import blind_bound
from femfit.simulation.constants import LESS_NOISE, NEARLY, WANTED_MODULUS, WANTED_PHASE_DEG
from femfit.simulation.controllers import Backstepping, Controller, Pid
from femfit.simulation.design import ControllerName, LoopDesign, keeping_margins
from femfit.simulation.experiment import Experiment
from femfit.simulation.loop import LoopOutcome
from femfit.simulation.margins import Margins, worst_of
from femfit.simulation.operating_point import OperatingPoint
from femfit.simulation.state_feedback import StateFeedback
from femfit.simulation.study_rows import HoldRow

TOO_CAUTIOUS = (
    "the filter is too cautious here: it allows for errors of force and voltage that a plant which is the model itself "
    "does not have. Nothing is wrong with its estimate"
)


def consistency_line(holds: Sequence[HoldRow]) -> str:
    """How many filters' predictions are as wrong as they expect, and what it means where most are not."""
    judged = [row for row in holds if isfinite(row.normalised_innovation_squared)]
    inside = sum(row.innovation_band.contains(row.normalised_innovation_squared) for row in judged)
    below = sum(row.normalised_innovation_squared < row.innovation_band.lower for row in judged)
    above = len(judged) - inside - below
    counts = f"Of {len(judged)} mean normalised innovations {inside} lie in their 95 % band"
    if 2 * below > len(judged):
        return f"{counts} and {below} below it, because {TOO_CAUTIOUS}."
    if 2 * above > len(judged):
        return f"{counts} and {above} above it: the filter's error is larger than it expects."
    if inside == len(judged):
        return f"{counts}, as they do for a filter that knows its own error."
    return f"{counts}, {below} below it and {above} above it."


def verdict(
    design: LoopDesign, seconds: float, loops: Sequence[tuple[Experiment, int, int]], plant: str | None = None
) -> str:
    """The first line: were all runs held, and with what; each loop comes with its runs held and all its runs."""
    held, runs = sum(held for _, held, _ in loops), sum(runs for *_, runs in loops)
    word = "Held" if held == runs else "Lost" if held == 0 else "Lost in part"
    apart = len(loops) > 1 and 0 < held < runs
    names = ", ".join(
        f"{e.controller} on {e.observer}{f' {held_of_loop} of {all_own}' if apart else ''}"
        for e, held_of_loop, all_own in loops
    )
    around = f" around the plant {quoted(plant)}" if plant else ""
    model = quoted(design.model.name)
    return f"{word}: {held} of {counted(runs, 'run')} of {seconds:.3g} s held the body; {names}, {model}{around}"


def losses(outcomes: Mapping[str, int]) -> str:
    """How runs were lost, in a few words."""
    return ", ".join(
        f"{count} {name.lower().replace('_', ' ')}" for name, count in outcomes.items() if name != LoopOutcome.HELD.name
    )


def sensor_word(name: str) -> str:
    """A sensor as it is written."""
    return "Hall" if name == HALL else name


def command_unit(design: LoopDesign) -> str:
    """Of the first circuit's command."""
    circuit = design.model.circuits[0]
    return "A" if circuit.drive.kind == "current" else "V"


def design_lines(design: LoopDesign, loops: Sequence[tuple[ControllerName, str]] = ()) -> list[str]:
    """Operating points, gains and margins.

    Parameters
    ----------
    loops : sequence of (str, str)
        Controller and observer of each loop whose margins are told; every controller's gains are where it is empty.
    """
    chosen = dict.fromkeys(name for name, _ in loops) or dict.fromkeys(("backstepping", "pid", "state-feedback"))
    sample = 1e3 * design.model.sample_time_s
    late = f", commands {counted(design.latency, 'sample')} after their readings" if design.latency else ""
    return [
        "Design from the model",
        *_point_lines(design),
        *(f"  {line}" for name in chosen for line in _controller_lines(design, name, bool(loops))),
        *(f"  {line}" for name, observer in loops for line in _margin_lines(design, name, observer)),
        f"  reference filters {design.reference_rate_rad_s:.4g} rad/s, sample time {sample:g} ms{late}",
        f"  {sensor_line(design)}",
        *(f"  {line}" for line in observed_lines(design)),
    ]


def _point_lines(design: LoopDesign) -> list[str]:
    unit, names = command_unit(design), [circuit.name for circuit in design.model.circuits]
    chosen = (design.points[0], design.points[len(design.points) // 2], design.points[-1])
    if len(names) == 1 and unit == "V":
        head = "  distance  voltage  current  coil pole  unstable pole at constant current"
        return [head, *(f"  {1e3 * p.distance_m:5.1f} mm  {p.commands[0]:5.3f} V  {_poles(p)}" for p in chosen)]
    if len(names) == 1:
        head = "  distance  current  coil pole  unstable pole at constant current"
        return [head, *(f"  {1e3 * p.distance_m:5.3g} mm  {_poles(p)}" for p in chosen)]
    shared = f"{', '.join(names)} (which share the force about half of their range)"
    head = f"  distance  {shared}  coil pole  unstable pole at constant current"
    return [head, *(f"  {1e3 * p.distance_m:5.3g} mm  {_poles(p)}" for p in chosen)]


def _poles(point: OperatingPoint) -> str:
    currents = ", ".join(f"{current:5.3f} A" for current in point.currents_A)
    unstable = f"{point.unstable_pole_rad_s:6.1f} rad/s" if point.unstable_pole_rad_s else "stable"
    return f"{currents}  {point.coil_pole_rad_s:6.1f} rad/s  {unstable}"


def _controller_lines(design: LoopDesign, name: ControllerName, used: bool) -> list[str]:
    if (reason := design.why_no(name)) and not used:
        return [f"no {name}: {reason}"]
    return [f"{name}: {gains_text(design, design.controller(name))}"]


def gains_text(design: LoopDesign, controller: Controller) -> str:
    """Gains with their units."""
    unit = command_unit(design)
    if isinstance(controller, Backstepping):
        current = f", current gain {controller.current_gain_ohm:.4g} ohm" if unit == "V" else ""
        return (
            f"position gain {controller.position_gain:.4g} 1/s^2, velocity gain {controller.velocity_gain:.4g} 1/s"
            + current
        )
    if isinstance(controller, Pid):
        parts = controller.parts
        return (
            f"kp {parts['kp']:.4g} {unit}/m, ki {parts['ki']:.4g} {unit}/(m s), kd {parts['kd']:.4g} {unit} s/m, "
            f"derivative filter {parts['filter_rad_s']:.4g} rad/s"
            + (f", inner loop of the current {parts['current']:.4g} ohm" if parts["current"] else "")
        )
    if isinstance(controller, StateFeedback) and len(controller.gains) == 1:
        gains = gains_of(design, controller)
        units = {"distance": f"{unit}/m", "velocity": f"{unit} s/m", "integral": f"{unit}/(m s)"}
        return ", ".join(f"{name} {value:.4g} {units.get(name, f'{unit}/A')}" for name, value in gains.items())
    if isinstance(controller, StateFeedback):
        rows = [
            f"{row[0]:.4g} {unit}/m, {row[1]:.4g} {unit} s/m, "
            + ", ".join(f"{gain:.4g} {unit}/A" for gain in row[2:])
            + f", integral {-integral:.4g} {unit}/(m s)"
            for row, integral in zip(-controller.gains, controller.integral, strict=True)
        ]
        return "; ".join(rows)
    return type(controller).__name__


def _margin_lines(design: LoopDesign, name: ControllerName, observer: str) -> list[str]:
    try:
        margins = design.margins(name, observer)  # type: ignore[arg-type]
    except (DomainError, FilterError) as error:
        return [f"no margins of {name} on {observer}: {error}"]
    worst = worst_of(margins)
    lines = [f"{name} on {observer}: {margins_text(worst, len(design.model.circuits), design.reads_slowly)}"]
    return [*lines, *([thin] if (thin := thin_text(design, name, observer, worst)) else [])]


def thin_text(design: LoopDesign, name: ControllerName, observer: str, worst: Margins) -> str:
    """Of a loop with thin margins, that they are and what takes them; empty of any other loop."""
    if not worst.thin:
        return ""
    head = f"thin: {_kept(worst)}, where {WANTED_PHASE_DEG:g} degrees and {WANTED_MODULUS:g} are aimed at"
    bound = blind_bound(design.bench("ekf"))
    if bound is not None and bound.modulus < WANTED_MODULUS:
        head += (
            f"; at {amount(bound.distance_m, 'm', 3)} the reading of {sensor_word(design.sensors[0])} has a zero at "
            f"{bound.zero_rad_s:.3g} rad/s beside the unstable pole of {bound.pole_rad_s:.3g} rad/s, so that no "
            f"controller keeps a modulus margin above {bound.modulus:.2g} with this sensor alone"
        )
    better = [(way, of) for way, of in _raised(design, name, observer).items() if NEARLY * of.kept > worst.kept]
    better.sort(key=lambda pair: pair[1].kept, reverse=True)
    gained = ", ".join(f"{_kept(margins)} {way}" for way, margins in better)
    return f"{head}; it would keep {gained}" if gained else head


def _kept(margins: Margins) -> str:
    return f"{degrees(margins.phase_rad):.2g} degrees of phase and a modulus margin of {margins.modulus:.2g}"


def _raised(design: LoopDesign, name: ControllerName, observer: str) -> dict[str, Margins]:
    """The margins of the same controller, designed anew, without one of what may take them; the stable ones."""
    noise = {sensor: LESS_NOISE * white for sensor, white in design.noise.items()}
    sensors = ", ".join(
        f"{amount(white, sensor.reading.unit, 2)} of {sensor_word(sensor.name)}"
        for sensor, white in zip(design.loop_sensors(), design.noise.values(), strict=True)
    )
    ways: dict[str, tuple[LoopDesign, str]] = {
        f"with a tenth of the sensors' noise ({sensors})": (keeping_margins(replace(design, noise=noise)), observer),
        "with the exact state": (design, "exact"),
    }
    if observer.endswith("4"):
        ways[f"on {observer[:-1]}, which takes the offset of {sensor_word(design.sensors[0])} as known"] = (
            design,
            observer[:-1],
        )
    if design.latency:
        ways["without latency"] = keeping_margins(replace(design, latency=0)), observer
    raised = {}
    for way, (better, by) in ways.items():
        try:
            margins = worst_of(better.margins(name, by))  # type: ignore[arg-type]
        except (DomainError, FilterError):
            continue
        if margins.stable:
            raised[way] = margins
    return raised


def margins_text(margins: Margins, circuits: int = 1, slow: bool = False) -> str:
    """The margins of a loop at its worst point of rest, in a line; with several circuits of what they are.

    Parameters
    ----------
    slow : bool
        Whether a sensor is not read at each sample: its noise, which comes at once, is then counted as spread evenly,
        and runs have more of it.
    """
    if not margins.stable:
        return f"unstable about its rest: a deviation grows by {-margins.slowest_pole_rad_s:.3g} 1/s"
    above = f"{margins.gain_above:.3g}" if isfinite(margins.gain_above) else "any number of"
    below = f"{margins.gain_below:.2g}" if margins.gain_below else "0"
    delay = amount(margins.delay_s, "s") if margins.delay_s < inf else "any"
    gains, each = ("all gains", "of one circuit at a time ") if circuits > 1 else ("gains", "")
    return (
        f"stable with {gains} from {below} to {above} times these, {each}phase margin {degrees(margins.phase_rad):.3g} "
        f"degrees, delay margin {delay}, modulus margin {margins.modulus:.2g}; noise takes "
        f"{'at least ' if slow else ''}{100.0 * margins.noise_share:.2g} % of the command's room"
        f"{', spread evenly over the samples between two readings' if slow else ''}"
    )


def sensor_line(design: LoopDesign) -> str:
    """The sensors with noise, delay and sample time."""
    parts = []
    for sensor in design.loop_sensors():
        noise = f"{amount(sensor.reading.noise, sensor.reading.unit, 3)} rms" if sensor.reading.noise else "no noise"
        late = f", {amount(sensor.reading.delay_s, 's')} late" if sensor.delay else ""
        slow = f", every {sensor.period} samples" if sensor.period > 1 else ""
        parts.append(f"{sensor_word(sensor.name)} {noise}{late}{slow}")
    return f"sensors: {'; '.join(parts)}"


def observed_lines(design: LoopDesign) -> list[str]:
    """What error a settled filter expects of distance and velocity at rest, in the middle of the reference."""
    settled = design.told
    if settled is None:
        return ["these sensors cannot tell the distance of a body at rest"]
    distance, velocity = settled
    both = f"the distance to {amount(distance, 'm')} and the velocity to {amount(velocity, 'm/s')}"
    lines = [f"a filter that allows for this model's process noises expects to know {both} rms"]
    if design.command_error > 1.0:
        volts = float(np.max(design.filter_noise.voltage_V))
        trusting = replace(design, command_error=1.0).told
        lines[0] += (
            f"; it allows for an error of the voltage of {amount(volts, 'V')}, {design.command_error:g} times the "
            "driver's, because one that trusts its commands leaves the loop less margin"
            + (f" (it would expect {amount(trusting[0], 'm')})" if trusting else "")
        )
    return lines


def design_data(design: LoopDesign, loops: Sequence[tuple[ControllerName, str]] = ()) -> dict[str, Any]:
    """Reference, gains, margins and operating points, ready for JSON."""
    b, pid = design.backstepping, design.pid
    feedback = design.controller("state-feedback") if not design.why_no("state-feedback") else None
    return {
        "sensors": list(design.sensors),
        "noise": dict(design.noise),
        "latency_samples": design.latency,
        "targets_m": list(design.targets_m),
        "reference_rate_rad_s": design.reference_rate_rad_s,
        "backstepping": {
            "position_gain_1_s2": b.position_gain,
            "velocity_gain_1_s": b.velocity_gain,
            "current_gain_ohm": b.current_gain_ohm,
        },
        "pid": None if pid is None else {**pid.parts, "filter_pole": pid.filter_pole, "gains": list(pid.gains)},
        "no_pid": design.why_no("pid"),
        "state_feedback": {"gains": feedback.gains.tolist(), "integral": feedback.integral.tolist()}
        if isinstance(feedback, StateFeedback)
        else None,
        "no_state_feedback": design.why_no("state-feedback"),
        "margins": [
            {"controller": name, "observer": observer, **json_ready(asdict(worst_of(design.margins(name, observer))))}  # type: ignore[arg-type]
            for name, observer in loops
        ],
        "points": [
            {
                "distance_m": point.distance_m,
                "currents_A": point.currents_A.tolist(),
                "commands": point.commands.tolist(),
                "unstable_pole_rad_s": point.unstable_pole_rad_s,
                "coil_pole_rad_s": point.coil_pole_rad_s,
            }
            for point in design.points
        ],
    }
