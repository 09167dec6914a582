"""Simulate a model in open loop: what it is fed with, where it begins, and what comes of it."""

from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from femfit.core.amount import amount_range
from femfit.core.arrays import FloatArray
from femfit.core.errors import DomainError, UsageError
from femfit.device.mechanics import Mechanics
from femfit.model.actuator_model import ActuatorModel
from femfit.model.json_file import read_model
from femfit.open_loop.energy import balance
from femfit.open_loop.equations import equations_of
from femfit.open_loop.feed import CONDUCTING, Feed
from femfit.open_loop.profile import Interpolation, Profile, read_profile
from femfit.open_loop.rest import rest_distance
from femfit.open_loop.result import OpenLoop
from femfit.open_loop.run import Run, Stretch, run
from femfit.open_loop.switching import switchings
from femfit.open_loop.system import ENERGIES, Side, System

DURATION_S = 0.1
"""Conventional: how long a command that never changes is followed."""

SAMPLES = 2000
"""Conventional: rows of the table where no sample time is given."""


def simulate(
    model: ActuatorModel | str | Path,
    *,
    drive: Profile | str | Path | None = None,
    voltage_V: float | None = None,
    current_A: float | None = None,
    duration_s: float | None = None,
    start_m: float | None = None,
    mechanics: Mechanics | None = None,
    interpolation: Interpolation = "held",
    outside: Literal["stop", "extrapolate"] = "stop",
    sample_time_s: float | None = None,
) -> OpenLoop:
    """Simulate a model in open loop: a voltage or current in, motion and switching out.

    The body begins at rest and without current. Stops, dry friction and a freewheel diode change the equations at
    moments that are located, not stepped over.

    Parameters
    ----------
    model : ActuatorModel, str or Path
        With circuit and motion, or its file.
    drive : Profile, str, Path or None
        What is commanded over time, or a table with the columns time_s and voltage_V or current_A.
    voltage_V, current_A : float or None
        A constant command in place of ``drive``; one of the three is needed.
    duration_s : float or None
        Up to the last time of ``drive``, or 0.1 s, where None.
    start_m : float or None
        Where the body begins; where it rests without current, on a stop or between springs, where None.
    mechanics : Mechanics or None
        In place of the model's.
    interpolation : str
        Of a table: ``held``, each value up to the next time, or ``linear``.
    outside : str
        Where distance or current leave the validity domain: ``stop`` there, or ``extrapolate`` and say so.
    sample_time_s : float or None
        Of the result's table; a 2000th of the duration where None.

    Raises
    ------
    MissingPartError
        If the model has no circuit or no motion.
    DomainError
        If the start lies outside of the validity domain or the stops, or volts command a current amplifier.
    UsageError
        If there is not one command, or the duration or the table's step is none.
    SimulationError
        If the motion cannot be followed.

    Examples
    --------
    >>> import femfit as ff
    >>> fall = ff.simulate("model.json", voltage_V=0.0, duration_s=0.01, start_m=0.02)
    >>> fall.end_s, len(fall.table["distance_m"])
    (0.01, 2001)
    """
    model = model if isinstance(model, ActuatorModel) else read_model(Path(model))
    if mechanics is not None:
        model = replace(model, motion=mechanics)
    profile = _profile(drive, voltage_V, current_A, interpolation)
    duration = _duration(duration_s, profile)
    system = _system(model, profile)
    notes = _limits(system.feed, profile)
    start = rest_distance(model, system) if start_m is None else _on_stop(system, start_m)
    if outside not in {"stop", "extrapolate"}:
        raise UsageError(f"outside must be stop or extrapolate; instead received {outside!r}.")
    if outside == "stop":
        model.validity.require(np.asarray(start), np.asarray(0.0))
    _require_between_stops(system.mechanics, start)
    first = np.zeros(system.size)
    first[0] = start
    given = profile.within(*system.feed.limits)
    found = run(system, given, first, duration, outside == "extrapolate")
    step = duration / SAMPLES if sample_time_s is None else sample_time_s
    size = system.size
    return OpenLoop(
        model=model,
        profile=profile,
        duration_s=duration,
        table=_table(model, system, found, step),
        events=found.events,
        switchings=switchings(found.events, _side(system.mechanics, start), given.turns_s.tolist()),
        energy=balance(model, system.mechanics, found.first[:3], found.last[:3], found.last[size:]),
        end_s=found.end_s,
        left_domain=found.left_domain,
        extrapolated=outside == "extrapolate" and bool(found.left_domain),
        notes=notes,
    )


def _profile(
    drive: Profile | str | Path | None, voltage: float | None, current: float | None, interpolation: Interpolation
) -> Profile:
    given = [one for one in (drive, voltage, current) if one is not None]
    if len(given) != 1:
        raise UsageError(
            "A simulation needs one of drive, voltage_V and current_A (--drive, --voltage, --current); "
            f"instead received {len(given)} of them."
        )
    if isinstance(drive, Profile):
        return drive
    if drive is not None:
        return read_profile(drive, interpolation)
    if voltage is not None:
        return Profile("voltage", np.zeros(1), np.array([voltage]))
    return Profile("current", np.zeros(1), np.array([current]))


def _duration(given: float | None, profile: Profile) -> float:
    last = float(profile.time_s[-1])
    duration = given if given is not None else last if last > 0.0 else DURATION_S
    if not 0.0 < duration < np.inf:
        raise UsageError(f"A simulation must last a time > 0 s; instead received {duration:g} s. Give 0.1, say.")
    return duration


def _system(model: ActuatorModel, profile: Profile) -> System:
    circuit, mechanics, box = model.require_circuit(), model.require_motion(), model.validity
    if circuit.drive.kind == "current" and profile.kind == "voltage":
        raise DomainError(
            f"Model {model.name!r} is driven by a current amplifier; its command must be a current. Give current_A "
            "(--current), or a table with the column current_A."
        )
    equations = equations_of(model)
    d, i = np.meshgrid(
        np.linspace(box.distance_min_m, box.distance_max_m, 15), np.linspace(box.current_min_A, box.current_max_A, 15)
    )
    force = float(np.abs(model.magnetics.force(d, i)).max() + np.abs(mechanics.static_force(d)).max())
    return System(
        feed=Feed(equations, circuit, profile.kind == "current"),
        mechanics=mechanics,
        domain=box,
        size=2 + equations.circuits + len(model.memory_names),
        force_scale_N=force or 1.0,
    )


def _limits(feed: Feed, profile: Profile) -> tuple[str, ...]:
    low, high = feed.limits
    smallest, largest = float(profile.value.min()), float(profile.value.max())
    if low <= smallest and largest <= high:
        return ()
    unit = "A" if feed.commands_current else "V"
    asked = amount_range(smallest, largest, unit, 3)
    limits = amount_range(low, high, unit, 3) if np.isfinite(low + high) else f"{low:g} to {high:g} {unit}"
    note = f"The command of {asked} exceeds what the driver gives, {limits}; it is cut there. Change the supply in the "
    return (note + "drawing to simulate a stronger one.",)


def _on_stop(system: System, start: float) -> float:
    """A start that rounding alone keeps from a stop is on it."""
    stops = [stop.distance_m for stop in (system.mechanics.near_stop, system.mechanics.far_stop) if stop is not None]
    return next((at for at in stops if abs(at - start) < system.least_rebound_m), start)


def _require_between_stops(mechanics: Mechanics, start: float) -> None:
    near, far = mechanics.near_stop, mechanics.far_stop
    if (near is not None and start < near.distance_m) or (far is not None and start > far.distance_m):
        ends = [f"{1e3 * stop.distance_m:g} mm" for stop in (near, far) if stop is not None]
        raise DomainError(
            f"The body must begin between its stops ({' and '.join(ends)}); instead received {1e3 * start:g} mm."
        )


def _side(mechanics: Mechanics, distance: float) -> Side | None:
    if mechanics.near_stop is not None and distance == mechanics.near_stop.distance_m:
        return "near"
    return "far" if mechanics.far_stop is not None and distance == mechanics.far_stop.distance_m else None


def _table(model: ActuatorModel, system: System, found: Run, step: float) -> dict[str, FloatArray]:
    """The motion at equal steps, up to where it ended."""
    if not step > 0.0 or found.end_s / step > 1e7:
        raise UsageError(
            f"The table's step must be > 0 s and give at most ten million rows; instead received {step:g} s."
        )
    time: FloatArray = step * np.arange(1.0 + np.floor(found.end_s / step * (1.0 + 1e-12)))
    time[-1] = min(time[-1], found.end_s)
    states, volts = np.empty((system.size + len(ENERGIES), len(time))), np.empty(len(time))
    ends = [stretch.end_s for stretch in found.stretches]
    which = np.minimum(np.searchsorted(ends, time, side="right"), len(ends) - 1)
    for k in np.unique(which):
        rows = np.flatnonzero(which == k)
        stretch = found.stretches[k]
        states[:, rows] = stretch.solution(time[rows])
        volts[rows] = _voltage(system, stretch, time[rows], states[:, rows])
    d, v, i = states[:3]
    slope, flux = model.magnetics.coenergy_derivatives(d, i, ((1, 0), (0, 1)))
    return {
        "time_s": time,
        "distance_m": d,
        "velocity_m_s": v,
        "current_A": i,
        "voltage_V": volts,
        "force_N": -slope,
        "static_force_N": system.mechanics.static_force(d),
        "flux_linkage_Wb": flux,
    }


def _voltage(system: System, stretch: Stretch, time: FloatArray, states: FloatArray) -> FloatArray:
    feed, line = system.feed, stretch.line
    if stretch.mode.feed == CONDUCTING and not feed.commands_current:
        command = line.value + line.slope * (time - line.start_s)
        return command if feed.diode_V is None else np.where(command > 0.0, command, -feed.diode_V)
    return np.array(
        [
            feed.flow(stretch.mode.feed, line, t, state[: system.size]).voltage_V[0]
            for t, state in zip(time, states.T, strict=True)
        ]
    )
