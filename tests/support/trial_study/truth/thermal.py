"""Temperatures along a campaign: winding, magnet and Hall element as a chain of heat capacities.

C dT/dt = i^2 R(T) - (T - T_neighbour) / R_th for the winding; magnet and element follow it through a resistance each.
"""

from dataclasses import dataclass

import numpy as np

from femfit.core.arrays import FloatArray, IntArray

COPPER_PER_K = 3.93e-3
"""Temperature coefficient of copper's resistance at 20 degC, IEC 60028."""

REFERENCE_C = 20.0


@dataclass(frozen=True)
class ThermalNetwork:
    """A bench's thermal constants.

    Parameters
    ----------
    rise_K : float
        Of the winding in steady state at the largest current.
    magnet_share, element_share : float
        Of the winding's rise that magnet and Hall element reach.
    """

    rise_K: float
    coil_s: float
    magnet_s: float
    element_s: float
    magnet_share: float
    element_share: float
    ambient_C: float


@dataclass(frozen=True, eq=False)
class Temperatures:
    """Temperatures at every reading.

    Parameters
    ----------
    coil, magnet, element : array, shape (n,)
        In degC.
    """

    coil: FloatArray
    magnet: FloatArray
    element: FloatArray


def heat(
    network: ThermalNetwork, current: FloatArray, run: IntArray, ambient: FloatArray, step_s: float
) -> Temperatures:
    """Integrate a campaign; every run starts cooled down to its own ambient temperature.

    Parameters
    ----------
    current : array, shape (n,)
        In A, in the order of measuring.
    run : array, shape (n,)
        Number of each reading's run.
    ambient : array, shape (n,)
        In degC.
    """
    scale = max(float(np.abs(current).max()), 1e-12)
    decay = [1.0 - np.exp(-step_s / tau) for tau in (network.coil_s, network.magnet_s, network.element_s)]
    result = np.empty((3, len(current)))
    state = np.zeros(3)
    for k in range(len(current)):
        if k == 0 or run[k] != run[k - 1]:
            state = np.zeros(3)
        hot = 1.0 + COPPER_PER_K * (ambient[k] + state[0] - REFERENCE_C)
        goal = network.rise_K * (current[k] / scale) ** 2 * hot
        state = state + np.array(
            [
                decay[0] * (goal - state[0]),
                decay[1] * (network.magnet_share * state[0] - state[1]),
                decay[2] * (network.element_share * state[0] - state[2]),
            ]
        )
        result[:, k] = ambient[k] + state
    return Temperatures(result[0], result[1], result[2])
