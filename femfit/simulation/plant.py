"""The simulated actuator: the model's own equations and drivers, with a wrong force on request.

A body that comes to a stop of its drawing bounces, or stays there until a force takes it away. Its steps are those of
:mod:`femfit.model.sample_step`.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from casadi import SX

from femfit.core.numerics import BoolArray, FloatArray
from femfit.model.actuator_model import ActuatorModel
from femfit.model.magnetics import Magnetics

LEAST_STEPS = 4
"""Chosen: steps of a plant in a sample, however short that is."""


@dataclass(frozen=True, eq=False)
class ScaledForce(Magnetics):
    """Magnetics whose force and motional constant are scaled, the inductance left alone.

    W'(d, i) = s (W'_0(d, i) - W'_0(d_ref, i)) + W'_0(d_ref, i): the plant stays conservative, and at d_ref the flux
    linkage is unchanged as well.
    """

    base: Magnetics
    scale: float  # s
    reference_distance_m: float

    def with_memory(self, memory: Mapping[str, SX]) -> Callable[[SX, SX], SX]:
        """W' of an expression's distance and currents where the states of effects are these."""
        inner = self.base.with_memory(memory)

        def coenergy(distance: SX, currents: SX) -> SX:
            held = inner(SX(self.reference_distance_m), currents)
            return self.scale * (inner(distance, currents) - held) + held

        return coenergy

    def expression(self, distance: SX, currents: SX) -> SX:
        """W' of an expression's distance and currents."""
        return self.with_memory({})(distance, currents)


@dataclass(frozen=True, eq=False)
class Plant:
    """A batch of simulated actuators with their drivers."""

    model: ActuatorModel

    @cached_property
    def steps(self) -> int:
        """Steps in a sample: twice as many as a filter's, so that a loop sees what its filter's steps are off by."""
        return max(LEAST_STEPS, 2 * self.model.sample_step.count)

    def start(self, state: FloatArray) -> FloatArray:
        """The first state from (distance, velocity, currents), shape (runs, 2 + n); all others are at rest."""
        added = self.model.order - state.shape[1]
        return np.concatenate([np.array(state, dtype=np.float64), np.zeros((len(state), added))], axis=1)

    def step(self, state: FloatArray, command: FloatArray, touched: BoolArray | None = None) -> FloatArray:
        """Advance by one sample period.

        Parameters
        ----------
        state : array, shape (runs, 2 + n or more)
            Distance in m, velocity in m/s, currents in A; after them the other ``model.state_names``.
        command : array, shape (runs, n), or (runs,) with one circuit
            Held over the period, in V, or in A for a current amplifier.
        touched : array, shape (2, runs), or None
            Is made true where a body meets its near stop, or its far one.
        """
        ends, n = self.model.require_motion().ends, len(self.model.circuits)
        commands = np.broadcast_to(command[:, None] if command.ndim == 1 else command, (len(state), n))
        step = self.model.sample_step.function(self.model.sample_time_s / self.steps, driven=True)
        for _ in range(self.steps):
            moved = step(state.T, commands.T).T
            state, way = moved[:, :-1], moved[:, -1]
            if touched is not None:
                touched |= [way < ends[0], way > ends[1]]
        return state


def with_force_scale(model: ActuatorModel, scale: float) -> ActuatorModel:
    """The model with its force scaled, 1.01 for one per cent more: a plant that the model describes wrongly."""
    middle = 0.5 * (model.validity.distance_min_m + model.validity.distance_max_m)
    return replace(model, magnetics=ScaledForce(model.magnetics, scale, middle))
