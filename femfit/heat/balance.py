"""Heat in balance: where a network settles, when there is no such temperature, and how it gets there.

C dT/dt = -L T + g T_a + q + P (1 + alpha (T - 20 degC)), P each winding's heat at 20 degC. At held currents that is
linear: it settles where L - alpha diag(P) is positive definite, and runs away beyond.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from femfit.core.arrays import FloatArray
from femfit.core.constants import COPPER_TEMPERATURE_COEFFICIENT
from femfit.device.parts import REFERENCE_TEMPERATURE
from femfit.heat.network import HeatNetwork
from femfit.heat.winding import growth

Powers = Callable[[FloatArray], FloatArray]
"""Heat of each part in W at their temperatures in degC, shape (n,)."""

HORIZON = 30.0
"""Numerical: of the slowest time constant, after which a network is taken as settled: 1e-13 is left."""


@dataclass(frozen=True, eq=False)
class Loads:
    """What heats a network at held currents: windings by their resistance at 20 degC, and parts by a given heat."""

    winding_W: FloatArray  # At 20 degC, shape (n,), zero where a part is no winding
    other_W: FloatArray  # Shape (n,)

    def scaled(self, factor: float) -> "Loads":
        """The same at currents that are larger by the root of a factor."""
        return Loads(factor * self.winding_W, factor * self.other_W)

    def at(self, temperatures: FloatArray) -> FloatArray:
        """Heat of each part at their temperatures."""
        return np.asarray(self.winding_W * growth(temperatures) + self.other_W)


def settled(network: HeatNetwork, ambient: float, loads: Loads) -> FloatArray | None:
    """Temperatures in degC at held currents, shape (n,); None where they grow until something gives way."""
    rising = COPPER_TEMPERATURE_COEFFICIENT * loads.winding_W
    matrix = network.laplacian - np.diag(rising)
    if not np.linalg.eigvalsh(matrix)[0] > 0.0:
        return None
    cold = loads.winding_W - rising * REFERENCE_TEMPERATURE + loads.other_W
    return np.asarray(np.linalg.solve(matrix, network.outwards * ambient + cold))


def largest_factor(network: HeatNetwork, loads: Loads) -> float:
    """What the loads may be multiplied by at most to settle at all; infinite without a winding that is heated."""
    rising = np.diag(COPPER_TEMPERATURE_COEFFICIENT * loads.winding_W)
    largest = np.linalg.eigvals(np.linalg.solve(network.laplacian, rising)).real.max(initial=0.0)
    return float(1.0 / largest) if largest > 0.0 else np.inf


def slowest_s(network: HeatNetwork) -> float:
    """The longest time constant in s, without what the windings' resistance does."""
    root = np.sqrt(network.capacities)
    return float(1.0 / np.linalg.eigvalsh(network.laplacian / np.outer(root, root))[0])


def time_until(
    network: HeatNetwork, ambient: float, powers: Powers, reached: Callable[[FloatArray], float]
) -> float | None:
    """Time in s from switching on, everything at ambient, to where ``reached`` becomes positive; None where never."""

    def slope(_: float, temperatures: FloatArray) -> FloatArray:
        heat = powers(temperatures) + network.outwards * ambient - network.laplacian @ temperatures
        return np.asarray(heat / network.capacities)

    def crossing(_: float, temperatures: FloatArray) -> float:
        return reached(temperatures)

    crossing.terminal, crossing.direction = True, 1.0  # type: ignore[attr-defined]  # as solve_ivp wants
    start = np.full(len(network.capacities), ambient)
    if reached(start) >= 0.0:
        return 0.0
    horizon = HORIZON * slowest_s(network)
    course = solve_ivp(slope, (0.0, horizon), start, "LSODA", events=crossing, rtol=1e-8, atol=1e-6)
    times = np.concatenate(course.t_events or [])
    return float(times[0]) if times.size else None
