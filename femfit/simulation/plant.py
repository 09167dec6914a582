"""The simulated actuator: the model's own equations and drivers, with a wrong force on request.

A body that comes to a stop of its drawing stays there until a force takes it away.

References
----------
A. Chowdhury and A. Sarjas, Sensors 16 (2016) 1504, eqs. (2) and (3), corrected in femfit.model.dynamics.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from femfit.core.numerics import BoolArray, FloatArray
from femfit.effects.taylor_series import CoenergySeries, TaylorSeries
from femfit.estimate.levitation import fastest_time_constant, kept_between_stops
from femfit.model.actuator_model import ActuatorModel
from femfit.model.bspline import basis_matrix
from femfit.model.drive import (
    blocked_by_diodes,
    commands_currents,
    current_targets,
    currents_by_voltages,
    is_plain,
    voltage_limits,
    winding_voltage,
)
from femfit.model.dynamics import LONGEST_STEP, runge_kutta_step
from femfit.model.exponential_step import extrapolated_step, motion_steps
from femfit.model.magnetics import CoenergySpline, Magnetics, MagneticSlopes, MagneticState


@dataclass(frozen=True, eq=False)
class ScaledForce(Magnetics):
    """Magnetics whose force and motional constant are scaled, the inductance left alone.

    W'(d, i) = s (W'_0(d, i) - W'_0(d_ref, i)) + W'_0(d_ref, i): the plant stays conservative, and at d_ref the flux
    linkage is unchanged as well.
    """

    base: Magnetics
    scale: FloatArray  # s, one factor a run; shape (runs,)
    reference_distance_m: float

    def alike(self, scale: float) -> Magnetics:
        """The magnetics of runs with one scale: of a spline again one, since its functions of the distance add to 1."""
        base = self.base
        if scale == 1.0:
            return base
        if type(base) is CoenergySpline:
            spline, u = base.spline, base.coordinate.of(np.array([self.reference_distance_m]))
            held = basis_matrix(u, spline.x_knots, spline.x_degree) @ spline.coefficients
            coefficients = scale * spline.coefficients + (1.0 - scale) * held
            return replace(base, spline=replace(spline, coefficients=coefficients))
        return replace(self, scale=np.array(scale))

    def coenergy(self, distance: FloatArray, currents: FloatArray) -> FloatArray:
        """W' in J, of shape (...)."""
        reference = np.full_like(distance, self.reference_distance_m)
        return self._mixed(self.base.coenergy(distance, currents), self.base.coenergy(reference, currents), 0)

    def flux_linkage(self, distance: FloatArray, currents: FloatArray) -> FloatArray:
        """dW'/di_k in Wb, of shape (..., n)."""
        reference = np.full_like(distance, self.reference_distance_m)
        return self._mixed(self.base.flux_linkage(distance, currents), self.base.flux_linkage(reference, currents), 1)

    def state(self, distance: FloatArray, currents: FloatArray) -> MagneticState:
        """Force, motional constants and inductances together."""
        there, reference = self.base.state(distance, currents), np.full_like(distance, self.reference_distance_m)
        inductance, scale = self.base.inductance(reference, currents), np.asarray(self.scale)
        inductance = self._mixed(there.inductance, inductance, 2)
        return MagneticState(scale * there.force, scale[..., None] * there.motional_constant, inductance)

    def slopes(self, distance: FloatArray, currents: FloatArray) -> MagneticSlopes:
        """The same with their slopes."""
        there, reference = self.base.slopes(distance, currents), np.full_like(distance, self.reference_distance_m)
        scale, held = np.asarray(self.scale), self.base.slopes(reference, currents).inductance_slope
        return MagneticSlopes(
            **vars(self.state(distance, currents)),
            force_gradient=scale * there.force_gradient,
            motional_gradient=scale[..., None] * there.motional_gradient,
            inductance_gradient=scale[..., None, None] * there.inductance_gradient,
            inductance_slope=self._mixed(there.inductance_slope, held, 3),
        )

    def _mixed(self, there: FloatArray, at_reference: FloatArray, axes: int) -> FloatArray:
        """What no scale changes at the reference distance, with so many axes of circuits."""
        scale = np.asarray(self.scale)[(..., *[None] * axes)]
        return np.asarray(scale * there + (1.0 - scale) * at_reference)


@dataclass(frozen=True, eq=False)
class ScaledSeries:
    """The same of the co-energy that effects change, called as :data:`femfit.effects.taylor_series.CoenergySeries`."""

    base: CoenergySeries
    scale: FloatArray
    reference_distance_m: float

    def __call__(self, distance: FloatArray, current: FloatArray, in_distance: int, in_current: int) -> TaylorSeries:
        """Taylor coefficients at points (n,) in m and A."""
        coefficients = self.scale * self.base(distance, current, in_distance, in_current).coefficients
        reference = np.full_like(distance, self.reference_distance_m)
        coefficients[:, 0] += (1.0 - self.scale) * self.base(reference, current, 0, in_current).coefficients[:, 0]
        return TaylorSeries(coefficients)


@dataclass(frozen=True, eq=False)
class Plant:
    """A batch of simulated actuators with their drivers."""

    model: ActuatorModel

    @cached_property
    def substeps(self) -> int:
        """Steps of the integration in a sample; none is longer than the time constant of a coil.

        With eddy currents, whose steps are exact for the fastest decay, the motion sets their length.
        """
        model, box = self.model, self.model.validity
        if isinstance(model.magnetics, ScaledForce):  # whose scales are those of a batch
            model = replace(model, magnetics=model.magnetics.base)
        if model.eddy is not None:
            return motion_steps(model)
        ends = (box.distance_min_m, box.distance_max_m)
        shortest = min(fastest_time_constant(model, distance) for distance in ends)
        return max(1, int(np.ceil(self.model.sample_time_s / shortest / LONGEST_STEP)))

    def start(self, state: FloatArray) -> FloatArray:
        """The first state from (distance, velocity, currents), shape (runs, 2 + n); all others are at rest."""
        added = self.model.order - state.shape[1]
        return np.concatenate([np.array(state, dtype=np.float64), np.zeros((len(state), added))], axis=1)

    def step(self, state: FloatArray, command: FloatArray) -> FloatArray:
        """Advance by one sample period.

        Parameters
        ----------
        state : array, shape (runs, 2 + n or more)
            Distance in m, velocity in m/s, currents in A; after them the other ``model.state_names``.
        command : array, shape (runs, n), or (runs,) with one circuit
            Held over the period, in V, or in A for a current amplifier.
        """
        model, count = self.model, self.substeps
        command = command[:, None] if command.ndim == 1 else command
        step = model.sample_time_s / count
        for _ in range(count):
            state = self._moved(state, command, step)
        return kept_between_stops(model, state)

    def _moved(self, state: FloatArray, command: FloatArray, step: float) -> FloatArray:
        model, n = self.model, len(self.model.circuits)
        volts = winding_voltage(model, state, command, step)
        moved = self._integrated(state, volts, step)
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
        return np.asarray(np.linalg.inv(currents_by_voltages(model, magnetic, step)[:, :n, :n]))

    def _integrated(self, state: FloatArray, volts: FloatArray, step: float) -> FloatArray:
        voltage = volts[:, 0] if len(self.model.circuits) == 1 else volts
        if self.model.eddy is None:
            return runge_kutta_step(self.model, state, voltage, step)
        if len(self._parts) == 1:
            return extrapolated_step(self._parts[0][1], state, voltage, step)
        result = np.empty_like(state)
        for runs, model in self._parts:
            result[runs] = extrapolated_step(model, state[runs], voltage[runs], step)
        return result

    @cached_property
    def _parts(self) -> list[tuple[BoolArray, ActuatorModel]]:
        """Runs of one force each, and their models: what has one co-energy for all steps by tables."""
        model, magnetics = self.model, self.model.magnetics
        if not isinstance(magnetics, ScaledForce) or model.dynamics is not None:
            return [(np.ones(1, dtype=np.bool_), model)]
        scales = np.atleast_1d(magnetics.scale)
        return [(scales == factor, replace(model, magnetics=magnetics.alike(factor))) for factor in np.unique(scales)]


def with_force_scale(model: ActuatorModel, scale: FloatArray | float) -> ActuatorModel:
    """The model with its force scaled: a plant that the unscaled model describes wrongly by that much.

    Parameters
    ----------
    scale : array, shape (runs,), or float
        1.01 for a force one per cent larger; one factor for all runs or one a run.
    """
    box = model.validity
    middle, factor = 0.5 * (box.distance_min_m + box.distance_max_m), np.asarray(scale, dtype=np.float64)
    dynamics = model.dynamics
    if dynamics is not None:
        dynamics = replace(dynamics, motion_coenergy=ScaledSeries(dynamics.motion_coenergy, factor, middle))
    return replace(model, magnetics=ScaledForce(model.magnetics, factor, middle), dynamics=dynamics)
