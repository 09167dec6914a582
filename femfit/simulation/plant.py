"""The simulated actuator: the model's own equations, with a wrong force on request.

References
----------
A. Chowdhury and A. Sarjas, Sensors 16 (2016) 1504, eqs. (2) and (3), corrected in femfit.model.dynamics.
"""

from dataclasses import dataclass, replace

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.model.actuator_model import ActuatorModel
from femfit.model.coenergy_series import ModelCoenergy
from femfit.model.dynamics import runge_kutta_step
from femfit.model.magnetics import Magnetics
from femfit.model.with_effects import EffectMagnetics


@dataclass(frozen=True, eq=False)
class ScaledForce(Magnetics):
    """Magnetics whose force and motional constant are scaled, the inductance left alone.

    W'(d, i) = s (W'_0(d, i) - W'_0(d_ref, i)) + W'_0(d_ref, i): the plant stays conservative, and at d_ref the flux
    linkage is unchanged as well.
    """

    base: Magnetics
    scale: FloatArray  # s, one factor a run; shape (runs,)
    reference_distance_m: float

    def _derivatives(
        self, distance: FloatArray, current: FloatArray, orders: tuple[tuple[int, int], ...]
    ) -> list[FloatArray]:
        values = self.base.coenergy_derivatives(distance, current, orders)
        reference = np.full_like(distance, self.reference_distance_m)
        unscaled = iter(self.base.coenergy_derivatives(reference, current, tuple((0, b) for a, b in orders if a == 0)))
        return [
            self.scale * value if a else self.scale * value + (1.0 - self.scale) * next(unscaled)
            for (a, _), value in zip(orders, values, strict=True)
        ]


@dataclass(frozen=True, eq=False)
class Plant:
    """A batch of simulated actuators."""

    model: ActuatorModel

    def start(self, state: FloatArray) -> FloatArray:
        """The first state from (distance, velocity, current), shape (runs, 3); those of effects at rest."""
        added = len(self.model.memory_names)
        return np.concatenate([np.array(state, dtype=np.float64), np.zeros((len(state), added))], axis=1)

    def step(self, state: FloatArray, voltage: FloatArray) -> FloatArray:
        """Advance by one sample period.

        Parameters
        ----------
        state : array, shape (runs, 3 or more)
            Distance in m, velocity in m/s, current in A; after them ``model.memory_names``.
        voltage : array, shape (runs,)
            Held over the period, in V.
        """
        return runge_kutta_step(self.model, state, voltage, self.model.sample_time_s)


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
        scaled = ScaledForce(EffectMagnetics(dynamics.motion_coenergy), factor, middle)
        dynamics = replace(dynamics, motion_coenergy=ModelCoenergy(scaled, None))
    return replace(model, magnetics=ScaledForce(model.magnetics, factor, middle), dynamics=dynamics)
