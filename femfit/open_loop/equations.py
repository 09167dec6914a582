"""The actuator's equations at one point in time, before stops, dry friction and what feeds it have their say.

    m v' = net force,    L i' = U - R i + k_m v,    L of shape (n, n), all else of shape (n,) for n windings:

the circuits, and after them the eddy currents, whose U is 0. Effects of the model join in; their own states follow the
currents.
"""

from dataclasses import dataclass, replace

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.device.mechanics import Mechanics
from femfit.model.actuator_model import ActuatorModel
from femfit.model.effect_dynamics import EffectDynamics
from femfit.model.float_point import PointMagnetics, point_magnetics


@dataclass(frozen=True)
class Point:
    """Forces and what the circuits do at one state."""

    net_N: float  # On the body along growing distance, without stops and dry friction
    motional_V: FloatArray  # k_m v of each winding: what the motion adds to its voltage
    inductance_H: FloatArray  # Shape (n, n)


@dataclass(frozen=True, eq=False)
class Equations:
    """Of one model, whose dry friction and stops are left to the modes."""

    smooth: Mechanics  # The model's, without dry friction
    resistance_ohm: FloatArray
    series_H: FloatArray  # In series with the coils, outside of the field, on the diagonal of shape (n, n)
    magnetics: PointMagnetics
    effects: EffectDynamics | None  # Where effects change the equations themselves
    sample_time_s: float

    @property
    def windings(self) -> int:
        """Number of windings n."""
        return len(self.resistance_ohm)

    def point(self, state: FloatArray) -> Point:
        """Forces and circuits at (distance, velocity, currents, states of effects)."""
        d, v = float(state[0]), float(state[1])
        force, motional, inductance = self.magnetics(d, state[2 : 2 + self.windings])
        return Point(self._force_beside(d, v) - force, motional * v, inductance + self.series_H)

    def _force_beside(self, distance: float, velocity: float) -> float:
        smooth = self.smooth
        force = smooth.mass_kg * smooth.gravity_m_s2 - smooth.viscous_N_s_per_m * velocity
        return float(force + smooth.beside_weight(np.asarray(distance)))

    def current_rate(self, point: Point, currents: FloatArray, voltage: FloatArray) -> FloatArray:
        """The rate i' in A/s that voltages give."""
        driving = voltage - self.resistance_ohm * currents + point.motional_V
        if self.windings <= 1:
            return np.asarray(driving / point.inductance_H[0] if self.windings else driving)
        return np.asarray(np.linalg.solve(point.inductance_H, driving), dtype=np.float64)

    def voltage(self, point: Point, currents: FloatArray, rate: FloatArray) -> FloatArray:
        """The voltages in V that give a rate i'."""
        return np.asarray(self.resistance_ohm * currents + point.inductance_H @ rate - point.motional_V)

    def with_effects(
        self, state: FloatArray, voltage: FloatArray, rate: float | None
    ) -> tuple[float, FloatArray, FloatArray]:
        """Under effects: net force, i', and the rates of their states; that of the circuit is ``rate`` if a number."""
        assert self.effects is not None  # noqa: S101  asked for by its callers
        rates = self.effects.derivative(
            state[None, :], voltage[:1], 0.0, self.smooth, self.sample_time_s, current_rate=rate
        )[0]
        end = 2 + self.windings
        return float(self.smooth.mass_kg * rates[1]), rates[2:end], rates[end:]


def equations_of(model: ActuatorModel) -> Equations:
    """The equations of a model."""
    motion = model.require_motion()
    model.require_dynamics()
    effects = model.dynamics if model.dynamics is not None and model.dynamics.drives else None
    return Equations(
        smooth=replace(motion, coulomb_N=0.0),
        resistance_ohm=model.windings.resistances_ohm,
        series_H=model.windings.series_H,
        magnetics=point_magnetics(model.windings.magnetics),
        effects=effects,
        sample_time_s=model.sample_time_s,
    )
