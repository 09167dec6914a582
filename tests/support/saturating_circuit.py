"""A pot magnet as a magnetic circuit with a core that saturates: force, flux linkage and inductance to rounding."""

from dataclasses import dataclass

import numpy as np

from femfit.core.numerics import MU_0
from support.sweeps import force_table


@dataclass(frozen=True)
class SaturatingCircuit:
    """N i = R(d) phi + H(phi), R = 2 d / (mu_0 A (1 + d / d_f)), H = h (x + x^12), x = phi / phi_s.

    The pole area A and the fringing's length d_f make the gap's reluctance; a leakage inductance stands beside it.
    """

    turns: float = 1240.0
    area: float = 4.7e-4
    fringing: float = 2.5e-3
    saturation: float = 8.3e-4
    core: float = 120.0
    leakage: float = 0.045

    def _reluctance(self, d):
        return 2.0 * d / (MU_0 * self.area * (1.0 + d / self.fringing))

    def _flux(self, d, i):
        """By bisection: the left side grows with the flux."""
        low, high = np.zeros_like(d + i), np.full_like(d + i, 3.0 * self.saturation)
        for _ in range(70):
            middle = 0.5 * (low + high)
            x = middle / self.saturation
            above = self._reluctance(d) * middle + self.core * (x + x**12) > self.turns * i
            low, high = np.where(above, low, middle), np.where(above, middle, high)
        return 0.5 * (low + high)

    def force(self, d, i):
        slope = 2.0 / (MU_0 * self.area) / (1.0 + d / self.fringing) ** 2
        return 0.5 * slope * self._flux(d, i) ** 2

    def flux_linkage(self, d, i):
        return self.turns * self._flux(d, i) + self.leakage * i

    def inductance(self, d, i):
        x = self._flux(d, i) / self.saturation
        return self.turns**2 / (self._reluctance(d) + self.core / self.saturation * (1.0 + 12.0 * x**11)) + self.leakage

    def table(self, currents, distances):
        """With all columns that a sweep has of it."""
        table = force_table(self.force, currents, distances)
        i, d = table.rows["current_A"].to_numpy(), table.rows["distance_m"].to_numpy()
        table.rows["flux_linkage_Wb"] = self.flux_linkage(d, i)
        table.rows["inductance_H"] = self.inductance(d, i)
        return table
