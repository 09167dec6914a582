"""Where the energy went: what the source gave, what was stored and what was lost.

    source = copper + eddy + diode + friction + impact + growth of (magnetic + kinetic + springs + weight and load)

The magnetic energy is i . flux linkage - W'(d, i); its growth is i . d(flux linkage) less the work on the body.
"""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from femfit.core.numerics import FloatArray
from femfit.device.mechanics import Mechanics
from femfit.model.actuator_model import ActuatorModel


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
