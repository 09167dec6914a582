"""Analytic force tables: one co-energy gives force, flux linkage and inductance, so that reciprocity is exact."""

from dataclasses import dataclass

import numpy as np
import pandas as pd

SATURATION_A = 1.5
DISTANCES_M = np.linspace(5e-3, 25e-3, 21)


@dataclass(frozen=True)
class Law:
    """W' = W0(d) + lambda_m(d) i + L(d) g(i), g = i^2/2 or a saturating one; F = -dW'/dd attracts, lambda = dW'/di."""

    magnet: bool = True
    saturating: bool = False

    def force(self, d, i):
        s = SATURATION_A
        g = s**2 * np.log(np.cosh(i / s)) if self.saturating else i**2 / 2
        passive = self.magnet * (6e-9 / (d + 1e-3) ** 4 + 2 * 3.5e-6 / (d + 6e-3) ** 3 * 8e-3 * i)
        return passive + 6e-6 / (d + 8e-3) ** 2 * g

    def flux_linkage(self, d, i):
        slope = SATURATION_A * np.tanh(i / SATURATION_A) if self.saturating else i
        return self.magnet * 3.5e-6 / (d + 6e-3) ** 2 * 8e-3 + (1e-4 + 6e-6 / (d + 8e-3)) * slope

    def table(self, currents=(0.0, 0.4, 0.8, 1.2), distances=DISTANCES_M):
        """SI rows of the grid, distance inside current."""
        i, d = (axis.ravel() for axis in np.meshgrid(currents, distances, indexing="ij"))
        return pd.DataFrame(
            {"current_A": i, "distance_m": d, "force_N": self.force(d, i), "flux_linkage_Wb": self.flux_linkage(d, i)}
        )
