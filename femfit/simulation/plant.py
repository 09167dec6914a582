"""The simulated actuator: the model's own equations and drivers, with a wrong force on request.

A body that comes to a stop of its drawing bounces, or stays there until a force takes it away.

References
----------
A. Chowdhury and A. Sarjas, Sensors 16 (2016) 1504, eqs. (2) and (3), corrected in femfit.model.dynamics.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from casadi import SX

from femfit.core.numerics import BoolArray, FloatArray
from femfit.model.actuator_model import ActuatorModel
from femfit.model.contact import step_between_stops
from femfit.model.drive import (
    blocked_by_diodes,
    commands_currents,
    current_targets,
    is_plain,
    voltage_limits,
    winding_voltage,
)
from femfit.model.dynamics import accurate_step, currents_by_voltages, plant_steps
from femfit.model.magnetics import Magnetics


@dataclass(frozen=True, eq=False)
class ScaledForce(Magnetics):
    """Magnetics whose force and motional constant are scaled, the inductance left alone.

    W'(d, i) = s (W'_0(d, i) - W'_0(d_ref, i)) + W'_0(d_ref, i): the plant stays conservative, and at d_ref the flux
    linkage is unchanged as well.
    """

    base: Magnetics
    scale: FloatArray  # s, one factor a run, or one for all; shape (runs,) or ()
    reference_distance_m: float

    def with_memory(self, memory: Mapping[str, SX]) -> Callable[[SX, SX], SX]:
        """W' of an expression's distance and currents where the states of effects are these."""
        inner, scale = self.base.with_memory(memory), self.given if np.ndim(self.scale) else float(self.scale)

        def coenergy(distance: SX, currents: SX) -> SX:
            held = inner(SX(self.reference_distance_m), currents)
            return scale * (inner(distance, currents) - held) + held

        return coenergy

    def expression(self, distance: SX, currents: SX) -> SX:
        """W' of an expression's distance and currents."""
        return self.with_memory({})(distance, currents)

    @cached_property
    def given(self) -> SX:
        """The scale as a symbol; none where it is one for all runs."""
        return SX.sym("scale", int(np.ndim(self.scale) > 0))

    @property
    def given_values(self) -> FloatArray:
        """The scale of each run, (1, runs), or (0,)."""
        return self.scale[None] if np.ndim(self.scale) else np.zeros(0)

    def __reduce__(self) -> tuple[type["ScaledForce"], tuple[Magnetics, FloatArray, float]]:
        return ScaledForce, (self.base, self.scale, self.reference_distance_m)


@dataclass(frozen=True, eq=False)
class Plant:
    """A batch of simulated actuators with their drivers."""

    model: ActuatorModel

    @cached_property
    def substeps(self) -> int:
        """Steps of the integration in a sample."""
        model, box = self.model, self.model.validity
        if isinstance(model.magnetics, ScaledForce):  # whose scales are those of a batch
            model = replace(model, magnetics=model.magnetics.base)
        return plant_steps(model, (box.distance_min_m, box.distance_max_m))

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
        model, count = self.model, self.substeps
        command = command[:, None] if command.ndim == 1 else command
        step = model.sample_time_s / count
        for _ in range(count):
            state = self._moved(state, command, step, touched)
        return state

    def _moved(self, state: FloatArray, command: FloatArray, step: float, touched: BoolArray | None) -> FloatArray:
        model, n = self.model, len(self.model.circuits)
        volts = winding_voltage(model, state, command, step)
        moved = self._integrated(state, volts, step, touched)
        if is_plain(model.circuits):
            return moved
        amplified = commands_currents(model)
        if amplified.any():  # what the filters' step missed, taken back by one secant
            missing = current_targets(model, state[:, 2 : 2 + n], command, step) - moved[:, 2 : 2 + n]
            more = np.einsum("rjk,rk->rj", self._needed(moved, step), np.where(amplified, missing, 0.0))
            corrected = np.clip(volts + more, *voltage_limits(model.circuits))
            moved = self._integrated(state, np.where(amplified, corrected, volts), step)
        return blocked_by_diodes(model, moved)

    def _needed(self, state: FloatArray, step: float) -> FloatArray:
        """Voltages held over a step for a change of the currents, in V/A, shape (runs, n, n)."""
        model, n = self.model, len(self.model.circuits)
        magnetic = model.windings.magnetics.state(state[:, 0], state[:, 2 : model.windings.end])
        if model.eddy is None:
            return (magnetic.inductance + model.series_inductances_H) / step
        return np.asarray(
            np.linalg.inv(currents_by_voltages(model, state[:, 0], state[:, 2 : model.windings.end], step)[:, :n, :n])
        )

    def _integrated(
        self, state: FloatArray, volts: FloatArray, step: float, touched: BoolArray | None = None
    ) -> FloatArray:
        voltage = volts[:, 0] if len(self.model.circuits) == 1 else volts

        def moved(begun: FloatArray, free: bool) -> FloatArray:
            result = np.empty_like(begun)
            for runs, model in self._parts:
                result[runs] = accurate_step(model, begun[runs], voltage[runs], step, free=free)
            return result

        return step_between_stops(self.model, state, step, moved, touched)

    @cached_property
    def _parts(self) -> list[tuple[BoolArray | slice, ActuatorModel]]:
        """Runs of one force each, and their models: what has one co-energy for all steps by tables."""
        magnetics = self.model.magnetics
        if self.model.eddy is None or not isinstance(magnetics, ScaledForce):
            return [(slice(None), self.model)]
        scales = np.atleast_1d(magnetics.scale)
        each = [(scales == factor, replace(magnetics, scale=np.array(factor))) for factor in np.unique(scales)]
        return [(slice(None) if len(each) == 1 else runs, replace(self.model, magnetics=one)) for runs, one in each]


def with_force_scale(model: ActuatorModel, scale: FloatArray | float) -> ActuatorModel:
    """The model with its force scaled: a plant that the unscaled model describes wrongly by that much.

    Parameters
    ----------
    scale : array, shape (runs,), or float
        1.01 for a force one per cent larger; one factor for all runs or one a run.
    """
    box = model.validity
    middle, factor = 0.5 * (box.distance_min_m + box.distance_max_m), np.asarray(scale, dtype=np.float64)
    return replace(model, magnetics=ScaledForce(model.magnetics, factor, middle))
