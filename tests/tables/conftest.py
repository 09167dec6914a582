"""Analytic force tables: one co-energy gives force, flux linkage and inductance, so that reciprocity is exact."""

import numpy as np
import pandas as pd
import pytest

TURNS = 30
SATURATION_A = 1.5


class Law:
    """W' = W0(d) + lambda_m(d) i + L(d) g(i), g = i^2/2 or a saturating one; all parts fall with d.

    F = -dW'/dd attracts, lambda = dW'/di.
    """

    def __init__(self, magnet=True, saturating=False):
        self.magnet, self.saturating = magnet, saturating

    def _g(self, i):
        s = SATURATION_A
        return (s**2 * np.log(np.cosh(i / s)), s * np.tanh(i / s)) if self.saturating else (i**2 / 2, i)

    def force(self, d, i):
        g, _ = self._g(i)
        passive = self.magnet * (6e-9 / (d + 1e-3) ** 4 + 2 * 3.5e-6 / (d + 6e-3) ** 3 * 8e-3 * i)
        return passive + 6e-6 / (d + 8e-3) ** 2 * g

    def flux_linkage(self, d, i):
        _, slope = self._g(i)
        return self.magnet * 3.5e-6 / (d + 6e-3) ** 2 * 8e-3 + (1e-4 + 6e-6 / (d + 8e-3)) * slope

    def table(self, currents=(0.0, 0.4, 0.8, 1.2), distances=None):
        """SI rows of the grid, distance inside current."""
        distances = np.linspace(5e-3, 25e-3, 21) if distances is None else np.asarray(distances)
        i, d = (axis.ravel() for axis in np.meshgrid(currents, distances, indexing="ij"))
        return pd.DataFrame(
            {"current_A": i, "distance_m": d, "force_N": self.force(d, i), "flux_linkage_Wb": self.flux_linkage(d, i)}
        )


@pytest.fixture
def law():
    return Law()


@pytest.fixture
def make_law():
    return Law
