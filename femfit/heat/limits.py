"""How warm parts may become, and what current brings the first of them there."""

import numpy as np
from scipy.optimize import brentq

from femfit.core.arrays import FloatArray
from femfit.device.thermal import Surroundings
from femfit.heat.balance import Loads, largest_factor, settled
from femfit.heat.network import HeatNetwork


def hottest(network: HeatNetwork, ambient: float, temperatures: FloatArray) -> FloatArray:
    """Temperature near that of the hottest strand of each winding in degC, shape (windings,).

    It is taken to be as far over the mean as the network's mean is over the faces: in a slab it is half as far, in a
    square 0.92.
    """
    inside = network.inside @ np.append(temperatures, ambient)
    return np.asarray(temperatures[: len(network.windings)] + np.maximum(inside, 0.0))


def largest_loads(network: HeatNetwork, around: Surroundings, loads: Loads) -> tuple[float, str]:
    """Factor of the loads that brings a part to its limit, infinite where none can, and that part's name."""
    count = len(network.windings)
    known = [part.material.thermal.working_temperature_C for part in network.regions]
    limits = np.array([around.winding_limit_C] * count + [np.inf if one is None else one for one in known])

    def over(factor: float) -> FloatArray:
        temperatures = settled(network, around.ambient_C, loads.scaled(factor))
        if temperatures is None:
            return np.where(np.isfinite(limits), np.inf, -np.inf)
        temperatures[:count] = hottest(network, around.ambient_C, temperatures)
        return np.asarray(temperatures - limits)

    if over(0.0).max() >= 0.0:
        return 0.0, network.names[int(over(0.0).argmax())]
    high = largest_factor(network, loads)
    if not np.isfinite(high):
        return np.inf, ""
    factor = float(brentq(lambda one: over(one).max(), 0.0, high * (1.0 - 1e-9), rtol=1e-12))
    return factor, network.names[int(over(factor).argmax())]
