"""What came of a simulation in open loop."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from femfit.core import files as atomic
from femfit.core.files import OPEN_LOOP, require_outputs
from femfit.core.numerics import FloatArray
from femfit.core.results import Printed
from femfit.core.sweep_columns import circuit_currents
from femfit.core.text import amount, counted
from femfit.model.actuator_model import ActuatorModel
from femfit.simulation.energy import EnergyBalance
from femfit.simulation.events import Event
from femfit.simulation.profile import Profile
from femfit.simulation.switching import StepResponse, Switching, step_response

_WORDS = {
    "pull_in": "Pull-in",
    "drop_out": "Drop-out",
    "to_near": "The near stop is reached",
    "to_far": "The far stop is reached",
}

_SWITCHES = ("pull_in", "drop_out")

_MOST_PRINTED = 6
"""Conventional: ways to a stop that are printed; the JSON has all."""

_AT_ONCE = 1e-6
"""Numerical: part of the simulated time below which a wait is the integrator's first step."""

_LEAST_SHARE = 1e-3
"""Conventional: part of the energy supplied below which a share of it is not printed."""


@dataclass(frozen=True, eq=False, repr=False)
class OpenLoop(Printed):
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
        return "\n".join([*self._domain_lines(), *self._switching_lines(), *self.notes, *self._energy_lines()])

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

    def _domain_lines(self) -> list[str]:
        lines = []
        for name, time in self.left_domain:
            event = next(e for e in self.events if e.name == f"{name}_leaves_domain" and e.time_s == time)
            value = amount(
                event.distance_m if name == "distance" else self._current(name, event),
                "m" if name == "distance" else "A",
                3,
            )
            then = "The simulation ends there: give the body stops within the sweep, sweep wider, or extrapolate."
            if self.extrapolated:
                then = "What follows is extrapolated."
            lines.append(
                f"The {self._said(name)} leaves the validity domain after {amount(time, 's', 3)}, at {value}. {then}"
            )
        return lines

    @property
    def profile(self) -> Profile:
        """What was commanded of the only circuit, or of the first."""
        return self.profiles[0]

    def _current(self, name: str, event: Event) -> float:
        """The current of an event by the name of its range."""
        names = [column.rpartition("_")[0] for column in circuit_currents(self.model.circuit_names)]
        return float(np.atleast_1d(event.current_A)[names.index(name)])

    @staticmethod
    def _said(name: str) -> str:
        """A range in words: ``current of lower``."""
        quantity, _, circuit = name.partition("_")
        return f"{quantity} of {circuit}" if circuit else quantity

    def _switching_lines(self) -> list[str]:
        if not self.switchings:
            d, v = (self.table[name] for name in ("distance_m", "velocity_m_s"))
            currents = [
                f"the {self._said(column.rpartition('_')[0])} is {amount(self.table[column][-1], 'A', 3)}"
                for column in circuit_currents(self.model.circuit_names)
            ]
            end = f"at the end {' and '.join(currents)}" if currents else ""
            if np.all(d == d[0]):
                return [
                    f"The body stays at {amount(d[0], 'm', 3)} for {amount(self.end_s, 's', 3)}{end and '; ' + end}."
                ]
            if self.step is not None:
                return [f"{self.step}{end and f' {end[0].upper()}{end[1:]}.'}"]
            where = f"the body is at {amount(d[-1], 'm', 3)} and moves with {amount(v[-1], 'm')}/s"
            touched = any(event.name.startswith("hits") for event in self.events)
            way = "comes back to its stop" if touched else "reaches no stop"
            return [f"The body {way} in {amount(self.end_s, 's', 3)}; {end}{end and ', '}{where}."]
        lines = []
        for switching in self.switchings[:_MOST_PRINTED]:
            bounces = counted(switching.bounces, "bounce") if switching.bounces else "no bounce"
            rest = ""
            if switching.rested_s is not None and switching.bounces:
                rest = f", at rest after {amount(switching.rested_s - switching.command_s, 's', 3)}"
            waited = switching.started_s - switching.command_s
            starts = f"after {amount(waited, 's', 3)}" if waited > _AT_ONCE * self.end_s else "at once"
            if switching.kind not in _SWITCHES and len(self.switchings) > 1:
                lines.append(
                    f"{_WORDS[switching.kind]} at {amount(switching.reached_s, 's', 3)} with "
                    f"{amount(switching.seating_velocity_m_s, 'm', 3)}/s, {bounces}."
                )
                continue
            lines.append(
                f"{_WORDS[switching.kind]} {amount(switching.switching_time_s, 's', 3)} after the command: the body "
                f"starts {starts} and seats with {amount(switching.seating_velocity_m_s, 'm', 3)}/s, {bounces}{rest}."
            )
        more = len(self.switchings) - _MOST_PRINTED
        return lines + ([f"... and {counted(more, 'more arrival')} at a stop (--json)."] if more > 0 else [])

    def _energy_lines(self) -> list[str]:
        energy = self.energy
        total = energy.supplied_J
        if total <= 0.0:
            return []
        shares = {
            "copper": energy.copper_J,
            "eddy currents": energy.eddy_J,
            "diode": energy.diode_J,
            "friction": energy.friction_J,
            "stops": energy.impact_J,
            "field": energy.magnetic_J,
            "motion": energy.kinetic_J,
            "springs": energy.springs_J,
            "weight and load": energy.potential_J,
            "back to the source": -energy.source_J,
        }
        printed = [
            f"{name} {amount(value / total, '')}" for name, value in shares.items() if value > _LEAST_SHARE * total
        ]
        line = f"Of {amount(total, 'J', 3)} went to: {', '.join(printed)}."
        if self.model.effects_drive:
            return [line, f"The model's effects took {amount(energy.remainder_J, 'J')}."]
        return [line, f"The balance closes to {abs(energy.remainder_J) / total:.1g} of it."]

    def to_dict(self) -> dict[str, Any]:
        """The numbers without the table, ready for JSON."""
        return {
            "model": self.model.name,
            "duration_s": self.duration_s,
            "end_s": self.end_s,
            "switchings": [
                asdict(switching) | {"switching_time_s": switching.switching_time_s} for switching in self.switchings
            ],
            "events": [asdict(event) for event in self.events],
            "step": None if self.step is None else asdict(self.step),
            "energy": self.energy.to_dict(),
            "left_domain": [{"name": name, "time_s": time} for name, time in self.left_domain],
            "extrapolated": self.extrapolated,
            "notes": list(self.notes),
        }

    def write_csv(self, path: str | Path) -> None:
        """Write the table, one row a step."""
        require_outputs([], (Path(path), OPEN_LOOP))
        names = list(self.table)
        rows = np.column_stack([self.table[name] for name in names])
        with atomic.replacing(path) as partial:
            np.savetxt(partial, rows, delimiter=",", header=",".join(names), comments="", fmt="%.9g")
