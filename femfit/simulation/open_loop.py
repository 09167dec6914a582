"""Simulate a model in open loop: what it is fed with, where it begins, and what comes of it.

What the drawing's own supply does to a body at rest: it switches there and back, or answers a step.
"""

from pathlib import Path
from typing import Literal

import numpy as np

from femfit.core.errors import DomainError, MissingPartError, SimulationError, UsageError
from femfit.core.numerics import FloatArray
from femfit.core.sweep_columns import circuit_currents, flux_columns, voltage_columns
from femfit.device.mechanics import Mechanics
from femfit.model.actuator_model import ActuatorModel
from femfit.model.json_file import model_of
from femfit.model.with_effects import with_parts
from femfit.simulation.events import Walk
from femfit.simulation.open_result import OpenLoop, balance, switchings
from femfit.simulation.operating_point import rest_distance, sensor_columns
from femfit.simulation.profile import Command, Constant, Driver, Interpolation, Profile, commanded
from femfit.simulation.system import System
from femfit.simulation.words import sentence

DURATION_S = 0.1
"""Conventional: how long a command that never changes is followed."""

SAMPLES = 2000
"""Conventional: rows of the table where no sample time is given."""


def simulate(
    model: ActuatorModel | str | Path,
    *,
    drive: Command = None,
    voltage_V: Constant = None,
    current_A: Constant = None,
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
    drive : Profile, mapping of str to Profile, str, Path or None
        Command over time, of several circuits by their names, or a table with the columns time_s and voltage_V or
        current_A (voltage_NAME_V or current_NAME_A); a circuit of which nothing is said gets 0.
    voltage_V : float, mapping of str to float, or None
        Constant command in V; for several circuits by their names, as ``{"bias": 2, "diff": 1}``.
    current_A : float, mapping of str to float, or None
        Constant command in A of a current amplifier; for several circuits by their names. One of the three commands is
        needed where there is a winding.
    duration_s : float > 0 or None
        Duration of the open loop; up to the last time of ``drive``, or 0.1 s, by default.
    start_m : float or None
        Distance at which the body begins; by default where it rests without current, on a stop or between springs.
    mechanics : Mechanics or None
        In place of the model's.
    interpolation : {'held', 'linear'}
        Interpolation of the drive's table: held (each value up to the next time) or linear.
    outside : str
        Where distance or current leave the validity domain: ``stop`` there, or ``extrapolate`` and say so.
    sample_time_s : float > 0 or None
        Time between two rows of the result's table; a 2000th of the duration by default.

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
    model = model_of(model)
    if mechanics is not None:
        model = with_parts(model, motion=mechanics)
    model.require_motion()
    profiles = commanded(model, drive, voltage_V, current_A, interpolation)
    last = max((float(profile.time_s[-1]) for profile in profiles), default=0.0)
    duration = duration_s if duration_s is not None else last if last > 0.0 else DURATION_S
    if not 0.0 < duration < np.inf:
        raise UsageError(f"A simulation must last a time > 0 s; instead received {duration:g} s. Give 0.1, say.")
    model.require_dynamics()
    drivers = tuple(Driver.of(*driven) for driven in zip(model.circuits, profiles, strict=True))
    system, several = System(model, drivers), len(drivers) > 1
    exceeded = [
        (driver, profile)
        for driver, profile in zip(drivers, profiles, strict=True)
        if not driver.limits[0] <= profile.value.min() <= profile.value.max() <= driver.limits[1]
    ]
    notes = [sentence("open_loop", "beyond_limits", *pair, several) for pair in exceeded]
    start = rest_distance(model) if start_m is None else start_m
    # What rounding alone keeps from a stop is on it
    stops = system.stops.items()
    begun_at = next((side for side, stop in stops if abs(stop.distance_m - start) < system.least_rebound_m), None)
    start = start if begun_at is None else system.stops[begun_at].distance_m
    if outside not in {"stop", "extrapolate"}:
        raise UsageError(f"outside must be stop or extrapolate; instead received {outside!r}.")
    if outside == "stop":
        model.validity.require(np.asarray(start), model.currents_of(np.zeros(model.order)))
    near, far = system.mechanics.ends
    if not near <= start <= far:
        ends = [f"{1e3 * stop.distance_m:g} mm" for stop in system.stops.values()]
        raise DomainError(
            f"The body must begin between its stops ({' and '.join(ends)}); instead received {1e3 * start:g} mm."
        )
    walk = Walk(system, np.append(start, np.zeros(model.order - 1)), duration, outside == "extrapolate")
    step = duration / SAMPLES if sample_time_s is None else sample_time_s
    return OpenLoop(
        model=model,
        profiles=profiles,
        duration_s=duration,
        table=_table(system, walk, step, notes),
        events=tuple(walk.events),
        switchings=switchings(walk.events, begun_at, [driver.commanded for driver in drivers]),
        energy=balance(model, walk.first, walk.state),
        end_s=walk.time,
        left_domain=tuple(walk.left_domain.items()),
        extrapolated=outside == "extrapolate" and bool(walk.left_domain),
        notes=tuple(notes),
    )


def _table(system: System, walk: Walk, step: float, notes: list[str]) -> dict[str, FloatArray]:
    """The motion at equal steps, up to where it ended; its own columns are true, whatever a sensor reads of them."""
    if not step > 0.0 or walk.time / step > 1e7:
        raise UsageError(
            f"The table's step must be > 0 s and give at most ten million rows; instead received {step:g} s."
        )
    model, windings = system.model, system.model.windings
    time: FloatArray = step * np.arange(1.0 + np.floor(walk.time / step * (1.0 + 1e-12)))
    time[-1] = min(time[-1], walk.time)
    circuits, names = len(model.circuits), model.circuit_names
    states, volts = np.empty((len(walk.state), len(time))), np.empty((circuits, len(time)))
    ends = [float(solution.t_max) for _, solution in walk.stretches]
    which = np.minimum(np.searchsorted(ends, time, side="right"), len(ends) - 1)
    for k in np.unique(which):
        rows, (mode, solution) = which == k, walk.stretches[k]
        states[:, rows] = solution(time[rows])
        pairs = zip(time[rows], states[:, rows].T, strict=True)
        volts[:, rows] = np.array([system.voltages(mode, at_s, state) for at_s, state in pairs]).T
    d, i = states[0], states[2 : windings.end]
    flux = windings.magnetics.flux_linkage(d, i.T)[:, :circuits]
    motion = {
        "time_s": time,
        "distance_m": d,
        "velocity_m_s": states[1],
        **dict(zip(circuit_currents(names), i[:circuits], strict=True)),
        **dict(zip(voltage_columns(names), volts, strict=True)),
        **dict(zip(model.eddy_names, i[circuits:], strict=True)),
        "force_N": windings.magnetics.force(d, i.T),
        "static_force_N": system.mechanics.static_force(d),
        **dict(zip(flux_columns(names), flux.T, strict=True)),
    }
    return motion | sensor_columns(model, time, states[: model.order].T, notes) | motion


FIRST_S, LONGEST_S = 0.05, 3.0
"""Conventional: duration that is tried first and doubled while something still moves, and the longest."""

WEAKEST = 1.0 / 64.0
"""Conventional: smallest part of the supply's voltage that is tried on a body that it drives out of its travel."""


def motion_at_supply(model: ActuatorModel) -> OpenLoop | None:
    """The motion that the supply's largest voltage makes of a body at rest.

    A body that rests on one of two stops is switched on and, once it is at rest again, off. A body that springs hold
    between them gets a step of the whole voltage, or of half, a quarter ... of it where that drives it to its ends.

    Returns
    -------
    OpenLoop or None
        None where there is no voltage drive, no mechanics, or nothing that keeps the body within the model, as with a
        levitated one.
    """
    circuit, motion = model.circuit, model.motion
    if circuit is None or motion is None or circuit.drive.kind == "current":
        return None
    voltage = max((circuit.voltage_max_V, circuit.voltage_min_V), key=abs)
    try:
        stops = [stop.distance_m for stop in (motion.near_stop, motion.far_stop) if stop is not None]
        if len(stops) == 2 and rest_distance(model) in stops:
            on = _until_rest(model, [voltage], [0.0])
            if on is None or not on.switchings or on.left_domain:
                return on
            return _until_rest(model, [voltage, 0.0], [0.0, on.duration_s])
        return _stepped(model, voltage) if motion.springs else None
    except (DomainError, MissingPartError, SimulationError):
        return None


def _until_rest(model: ActuatorModel, values: list[float], times: list[float]) -> OpenLoop | None:
    """A simulation of the command that lasts until nothing moves any more; None where the body leaves the domain."""
    after = FIRST_S
    while True:
        command = Profile("voltage", np.array(times), np.array(values))
        motion = simulate(model, drive=command, duration_s=times[-1] + after)
        if motion.left_domain:
            return None if any(name == "distance" for name, _ in motion.left_domain) else motion
        moved_s = max((event.time_s for event in motion.events if event.name != "sticks"), default=0.0)
        still = motion.table["velocity_m_s"][-1] == 0.0 and moved_s < times[-1] + 0.8 * after
        if (still and len(motion.switchings) == len(values)) or after > LONGEST_S:
            return motion
        after *= 2.0


def _stepped(model: ActuatorModel, voltage: float) -> OpenLoop | None:
    share, duration = 1.0, FIRST_S
    while share >= WEAKEST:
        motion = simulate(model, voltage_V=share * voltage, duration_s=duration)
        if motion.step is not None:
            return motion
        if motion.left_domain or motion.switchings or motion.touched:
            share *= 0.5
        elif duration > LONGEST_S:
            return None
        else:
            duration *= 2.0
    return None
