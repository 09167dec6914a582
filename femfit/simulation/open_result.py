"""What came of a simulation in open loop: switchings, the answer to a step, and where the energy went.

Pull-in and drop-out are when the body leaves one stop and reaches the other; a body that reaches no stop answers one
step of the command with rise, overshoot and settling. Energy is given by the source, stored and lost:

    source = copper + eddy + diode + friction + impact + growth of (magnetic + kinetic + springs + weight and load)

The magnetic energy is i . flux linkage - W'(d, i); its growth is i . d(flux linkage) less the work on the body.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd

from femfit.core import files as atomic
from femfit.core.files import OPEN_LOOP, require_outputs
from femfit.core.numerics import FloatArray
from femfit.core.results import Plotted, Result
from femfit.core.sweep_columns import circuit_currents
from femfit.model.actuator_model import ActuatorModel
from femfit.simulation.events import Event
from femfit.simulation.profile import Profile
from femfit.simulation.system import Side
from femfit.simulation.words import sentence

Kind = Literal["pull_in", "drop_out", "to_near", "to_far"]


@dataclass(frozen=True)
class Switching:
    """One way to a stop.

    Parameters
    ----------
    kind : str
        ``pull_in`` from rest on the far stop to the near one, ``drop_out`` back; ``to_near`` or ``to_far`` from between
        them, or rebounding from the other one without having come to rest there.
    command_s : float
        The last change of the command before the body started.
    started_s, reached_s : float
        When it started, and when it first touched the stop.
    rested_s : float or None
        When it came to rest on it; None where it has not, or the stop gives way.
    seating_velocity_m_s : float
        Speed of the first touch.
    bounces : int
        Touches after the first.
    """

    kind: Kind
    command_s: float
    started_s: float
    reached_s: float
    rested_s: float | None
    seating_velocity_m_s: float
    bounces: int

    @property
    def switching_time_s(self) -> float:
        """From the command to the first touch."""
        return self.reached_s - self.command_s

    @property
    def data(self) -> dict[str, Any]:
        """What programs read."""
        return vars(self) | {"switching_time_s": self.switching_time_s}


def switchings(events: Sequence[Event], begun_at: Side | None, profiles: Sequence[Profile]) -> tuple[Switching, ...]:
    """Every way to a stop in a list of events, from a start on a stop or in the air."""
    ways: list[Switching] = []
    turns = np.concatenate([[0.0], *(profile.turns_s for profile in profiles)])
    last_side: str | None = begun_at
    started, rebounds = 0.0, False
    for event in events:
        action, _, side = event.name.partition("_")
        if action == "hits" and side != last_side:
            rested = last_side is not None and not rebounds
            kinds: dict[str, tuple[Kind, Kind]] = {"near": ("to_near", "pull_in"), "far": ("to_far", "drop_out")}
            kind, command = kinds[side][rested], float(turns[turns <= started].max())
            ways.append(Switching(kind, command, started, event.time_s, None, abs(event.velocity_m_s), 0))
            last_side = side
        elif action == "hits" and ways:
            ways[-1] = replace(ways[-1], bounces=ways[-1].bounces + 1, rested_s=None)
        elif action == "rests" and ways:
            ways[-1] = replace(ways[-1], rested_s=event.time_s)
        if action in {"hits", "rests", "starts", "leaves"}:
            rebounds = action == "hits"
        if action in {"hits", "leaves", "starts"}:
            started = event.time_s
    return tuple(ways)


BAND = 0.02
"""Conventional: settled is what stays within this part of the whole change."""

LAST = 0.1
"""Conventional: part of the time at whose beginning the motion must have settled for its end to be known."""


@dataclass(frozen=True)
class StepResponse:
    """From one place of rest to another.

    Parameters
    ----------
    start_m, end_m : float
        Distances at rest.
    rise_s : float
        From 10 to 90 % of the change, at their first passing.
    overshoot : float
        Largest excess over the change, as a part of it; 0 where there is none.
    settling_s : float
        After which the distance stays within 2 % of the change.
    """

    start_m: float
    end_m: float
    rise_s: float
    overshoot: float
    settling_s: float


def step_response(time: FloatArray, distance: FloatArray) -> StepResponse | None:
    """Of a motion that begins at rest at time 0; None where it does not move, or has not settled at its end."""
    change = float(distance[-1] - distance[0])
    if change == 0.0:
        return None
    way = (distance - distance[0]) / change
    outside = np.flatnonzero(np.abs(way - 1.0) > BAND)
    settled = outside[-1] + 1
    if time[settled] > (1.0 - LAST) * time[-1]:
        return None
    crossings = []
    for level in (0.1, 0.9):  # linear between the samples on either side
        after = int(np.argmax(way >= level))
        pair = slice(after - 1, after + 1)
        crossings.append(float(np.interp(0.0, way[pair] - level, time[pair])))
    rise = crossings[1] - crossings[0]
    excess = float(way.max() - 1.0)
    overshoot = excess if excess > 1e-6 else 0.0
    return StepResponse(float(distance[0]), float(distance[-1]), rise, overshoot, float(time[settled]))


@dataclass(frozen=True)
class EnergyBalance:
    """Energies in J of a motion in open loop.

    Parameters
    ----------
    source_J : float
        From the driver; what a bridge takes back counts against it.
    copper_J, eddy_J, diode_J, friction_J, impact_J : float
        Lost in the winding, to eddy currents, in the freewheel diode, viscous and dry friction, and given to the stops.
    magnetic_J, kinetic_J, springs_J, potential_J : float
        Growth of what is stored in field, motion, springs, and weight with load.
    remainder_J : float
        What is left over: the integration's error, and with it what the model's effects take.
    """

    source_J: float
    copper_J: float
    eddy_J: float
    diode_J: float
    friction_J: float
    impact_J: float
    magnetic_J: float
    kinetic_J: float
    springs_J: float
    potential_J: float
    remainder_J: float

    @property
    def data(self) -> dict[str, float]:
        """What programs read."""
        return vars(self) | {"supplied_J": self.supplied_J}

    @property
    def supplied_J(self) -> float:  # noqa: N802  the unit
        """From the source and from what was stored."""
        stored = (self.magnetic_J, self.kinetic_J, self.springs_J, self.potential_J)
        return max(self.source_J, 0.0) + sum(max(-growth, 0.0) for growth in stored)


def balance(model: ActuatorModel, first: FloatArray, last: FloatArray) -> EnergyBalance:
    """The balance between two states, behind which the energies stand that the integration summed up.

    The magnetic energy has that of the inductances in series, 1/2 L_s i^2.
    """
    source, *gone = (last - first)[model.order :].tolist()
    ends, windings, mechanics = np.array([first, last]), model.windings, model.require_motion()
    d, v, i = ends[:, 0], ends[:, 1], ends[:, 2 : windings.end]
    linked = (i * windings.magnetics.flux_linkage(d, i)).sum(axis=1)
    in_series = 0.5 * np.einsum("pk,kl,pl->p", i, windings.series_H, i)
    stored = [
        linked - windings.magnetics.coenergy(d, i) + in_series,
        0.5 * mechanics.mass_kg * v**2,
        mechanics.energy_of_springs(d),
        -(mechanics.mass_kg * mechanics.gravity_m_s2 + mechanics.load_N) * d,
    ]
    parts = [*gone, *(float(energy[1] - energy[0]) for energy in stored)]
    return EnergyBalance(*[source, *parts, source - sum(parts)])


@dataclass(frozen=True, eq=False, repr=False)
class OpenLoop(Plotted, Result):
    """A motion in open loop; printed, it says how the actuator switched and where the energy went.

    Parameters
    ----------
    table : mapping of str to array
        Columns at equal steps: time_s, distance_m, velocity_m_s, current_A, voltage_V (across the circuit), force_N
        (magnetic, towards smaller distance), static_force_N (weight, springs and load, towards larger distance) and
        flux_linkage_Wb. Of several circuits current_NAME_A, voltage_NAME_V and flux_linkage_NAME_Wb. Of eddy currents
        eddy_1_A and on. Of the drawn sensors hall_V, position_V, pickup_V and acceleration_m_s2, without noise and
        rounding.
    profiles : tuple of Profile
        What was commanded, one a circuit.
    events : tuple of Event
        Each with its time, and the state before it.
    switchings : tuple of Switching
        Every way to a stop.
    end_s : float
        Where the simulation ended: at ``duration_s``, or where the validity domain was left.
    left_domain : tuple of (str, float)
        distance or current (current_NAME of several circuits), and when it left the validity domain.
    extrapolated : bool
        Whether what comes after that is the model continued beyond its domain.
    notes : tuple of str
        What was not done as it was asked for.

    Examples
    --------
    >>> import femfit as ff
    >>> motion = ff.simulate("model.json", voltage_V=1.5, duration_s=0.005, start_m=0.022)
    >>> print(motion)
    The body reaches no stop in 5.00 ms; ...
    >>> abs(motion.energy.remainder_J) < 1e-6 * motion.energy.supplied_J
    True
    """

    data = (
        *("model=model.name", "duration_s", "end_s", "switchings", "events", "step", "energy"),
        *("left_domain=domain_left", "extrapolated", "notes"),
    )

    model: ActuatorModel
    profiles: tuple[Profile, ...]
    duration_s: float
    table: Mapping[str, FloatArray]
    events: tuple[Event, ...]
    switchings: tuple[Switching, ...]
    energy: EnergyBalance
    end_s: float
    left_domain: tuple[tuple[str, float], ...]
    extrapolated: bool
    notes: tuple[str, ...]

    def __str__(self) -> str:
        names = [column.removesuffix("_A") for column in circuit_currents(self.model.circuit_names)]
        leavings = []
        for name, time in self.left_domain:
            event = next(event for event in self.events if event.name == f"{name}_leaves_domain")
            values = dict(zip(names, np.atleast_1d(event.current_A), strict=True)) | {"distance": event.distance_m}
            leavings.append((name, time, float(values[name]), "m" if name == "distance" else "A"))
        return sentence("open_loop", "motion", self, leavings, {name: self.table[f"{name}_A"][-1] for name in names})

    @property
    def step(self) -> StepResponse | None:
        """Rise, overshoot and settling where one constant command moved the body and no stop was in its way."""
        if (
            any(len(profile.value) > 1 for profile in self.profiles)
            or self.left_domain
            or any("near" in e.name or "far" in e.name for e in self.events)
        ):
            return None
        return step_response(self.table["time_s"], self.table["distance_m"])

    @property
    def profile(self) -> Profile:
        """What was commanded of the only circuit, or of the first."""
        return self.profiles[0]

    @property
    def touched(self) -> bool:
        """Whether the body came to a stop, be it the one that it began at."""
        return any(event.name.startswith("hits") for event in self.events)

    @property
    def domain_left(self) -> list[dict[str, Any]]:
        """What left the validity domain, and when, by their names."""
        return [{"name": name, "time_s": time} for name, time in self.left_domain]

    def write_csv(self, path: str | Path) -> None:
        """Write the table, one row a step."""
        require_outputs([], (Path(path), OPEN_LOOP))
        write_table(path, pd.DataFrame(self.table))


def write_table(path: str | Path, table: pd.DataFrame) -> None:
    """Write numbers to nine digits, whole or not at all."""
    with atomic.replacing(path) as partial:
        table.to_csv(partial, index=False, float_format="%.9g", na_rep="nan")
