"""Where the energy went: what the source gave, what was stored and what was lost.

    source = copper + eddy + diode + friction + impact + growth of (magnetic + kinetic + springs + weight and load)

The magnetic energy is i . flux linkage - W'(d, i); its growth is i . d(flux linkage) less the work on the body.

The actuator's equations at one point in time, before stops, dry friction and what feeds it have their say.

    m v' = net force,    L i' = U - R i + k_m v,    L of shape (n, n), all else of shape (n,) for n windings:

the circuits, and after them the eddy currents, whose U is 0. Effects of the model join in; their own states follow the
currents.
"""

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from femfit.core.numerics import FloatArray
from femfit.device.mechanics import Mechanics
from femfit.model import equations
from femfit.model.actuator_model import ActuatorModel
from femfit.model.magnetics import Magnetics


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
    def supplied_J(self) -> float:  # noqa: N802  the unit
        """From the source and from what was stored."""
        stored = (self.magnetic_J, self.kinetic_J, self.springs_J, self.potential_J)
        return max(self.source_J, 0.0) + sum(max(-growth, 0.0) for growth in stored)

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready."""
        return {**asdict(self), "supplied_J": self.supplied_J}


def balance(
    model: ActuatorModel, mechanics: Mechanics, first: FloatArray, last: FloatArray, gone: FloatArray
) -> EnergyBalance:
    """The balance between two states (distance, velocity, all currents); ``gone`` is what the integration summed up.

    The magnetic energy has that of the inductances in series, 1/2 L_s i^2.
    """
    source, copper, eddy, diode, friction, impact = (float(energy) for energy in gone)
    ends, windings = np.array([first, last]), model.windings
    d, v, i = ends[:, 0], ends[:, 1], ends[:, 2 : windings.end]
    coenergy, flux = windings.magnetics.coenergy(d, i), windings.magnetics.flux_linkage(d, i)
    linked = (i * flux).sum(axis=1)
    in_series = 0.5 * np.einsum("pk,kl,pl->p", i, windings.series_H, i)
    stored = [
        linked - coenergy + in_series,
        0.5 * mechanics.mass_kg * v**2,
        mechanics.energy_of_springs(d),
        -(mechanics.mass_kg * mechanics.gravity_m_s2 + mechanics.load_N) * d,
    ]
    magnetic, kinetic, strain, potential = (float(ends_J[1] - ends_J[0]) for ends_J in stored)
    gone_to = (copper, eddy, diode, friction, impact, magnetic, kinetic, strain, potential)
    return EnergyBalance(source, *gone_to, source - sum(gone_to))


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
    magnetics: Magnetics
    effects: equations.Equations | None  # Where effects change the equations themselves

    @property
    def windings(self) -> int:
        """Number of windings n."""
        return len(self.resistance_ohm)

    def point(self, state: FloatArray) -> Point:
        """Forces and circuits at (distance, velocity, currents, states of effects)."""
        d, v = float(state[0]), float(state[1])
        at = self.magnetics.at_point(state[0], state[2 : 2 + self.windings])
        return Point(
            self._force_beside(d, v) - float(at.force), at.motional_constant * v, at.inductance + self.series_H
        )

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
        function, driving = (
            (self.effects.rates, voltage[:1]) if rate is None else (self.effects.driven_rates, np.array([rate]))
        )
        rates = function(state, driving, np.zeros(3), np.zeros(0))[:, 0]
        end = 2 + self.windings
        return float(self.smooth.mass_kg * rates[1]), rates[2:end], rates[end:]


def equations_of(model: ActuatorModel) -> Equations:
    """The equations of a model."""
    motion = model.require_motion()
    model.require_dynamics()
    smooth = replace(motion, coulomb_N=0.0)
    return Equations(
        smooth=smooth,
        resistance_ohm=model.windings.resistances_ohm,
        series_H=model.windings.series_H,
        magnetics=model.windings.magnetics,
        effects=replace(model, motion=smooth).equations if model.effects_drive else None,
    )
