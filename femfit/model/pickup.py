"""A pickup coil of a model: a winding without current, and the voltage that its flux linkage induces.

u = d(lambda)/dt = (d lambda/dd) v + sum (d lambda/di_k) di_k/dt. A reading of a sampled loop or record is the mean of u
over the sample before it, (lambda_k - lambda_(k-1)) / T: what an integrating converter or a low-pass before it gives,
and free of the steps that a driver's voltage makes at the samples. A current of the winding would pull the body by
-d lambda/dd for each ampere, and link each circuit by d lambda/di_k: the same function says both.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.device.sensors import Sensor
from femfit.model.sensed_field import SensedField


@dataclass(frozen=True, kw_only=True, eq=False)
class PickupSensor(Sensor):
    """The winding, whose flux linkage stands in Wb; its reading in V."""

    flux: SensedField
    kind: Literal["pickup_coil"] = "pickup_coil"

    def voltage(
        self, distance: FloatArray, currents: FloatArray, velocity: FloatArray, current_rates: FloatArray
    ) -> FloatArray:
        """The voltage at an instant, of shape (...); rates in A/s in the shape of the currents."""
        _, in_distance, in_currents = self.flux.derivatives(distance, currents)
        induced = in_currents * current_rates
        several = np.ndim(in_currents) > np.ndim(in_distance)
        return np.asarray(in_distance * velocity + (induced.sum(axis=-1) if several else induced))
