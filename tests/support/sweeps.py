"""Sweep tables with known truth."""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from femfit.core.numerics import MU_0
from femfit.tables.sweep_table import SweepTable

MASS = 4.35e-3
CURRENTS = np.linspace(0.0, 1.4, 8)
DISTANCES = np.linspace(0.015, 0.045, 61)
WIDE = 1e-3 * np.array([0.2, 0.3, 0.4, 0.55, 0.75, 1.0, 1.4, 1.9, 2.6, 3.5, 4.6, 6.0])
"""From a closed gap to where iron saturates no more, in m."""

ACTUATOR = {
    "name": "test-rig",
    "mass_kg": MASS,
    "resistance_ohm": 2.69,
    "voltage_min_V": 0.5,
    "voltage_max_V": 3.0,
    "sample_time_s": 0.5e-3,
    "reference_distances_m": [0.022, 0.03],
    "hall": {
        "radius_m": 0.0,
        "height_m": -1e-4,
        "sensitivity_V_per_T": 50.0,
        "quiescent_V": 2.5,
        "output_min_V": 0.0,
        "output_max_V": 5.0,
        "adc_bits": 12,
        "noise_V": 0.0,
    },
}


@dataclass(frozen=True)
class ClosedForm:
    """W' = a A(d) + b i B(d) + (L_0 + L_1 C(d)) g(i), a magnet's pull, a coil's and an inductance that may saturate.

    A = 1 / (3 (d + s)^3), B = (d^2 + R^2)^-1/2, C = exp(-d / h), g = i_s^2 ln cosh(i / i_s), which is i^2 / 2 without
    saturation.
    """

    a: float = 6.1e-9
    s: float = 1.35e-3
    b: float = 2.2e-4
    R: float = 0.021
    L_0: float = 16e-3
    L_1: float = 2e-3
    h: float = 0.012
    saturation: float | None = None

    def _g(self, i, order):
        if self.saturation is None:
            return (0.5 * i**2, i, np.ones_like(i))[order]
        x = i / self.saturation
        return (self.saturation**2 * np.log(np.cosh(x)), self.saturation * np.tanh(x), 1.0 / np.cosh(x) ** 2)[order]

    def force(self, d, i):
        return (
            self.a * (d + self.s) ** -4.0
            + self.b * i * d * (d**2 + self.R**2) ** -1.5
            + self.L_1 / self.h * np.exp(-d / self.h) * self._g(i, 0)
        )

    def flux_linkage(self, d, i):
        return self.b * (d**2 + self.R**2) ** -0.5 + (self.L_0 + self.L_1 * np.exp(-d / self.h)) * self._g(i, 1)

    def motional_constant(self, d, i):
        return self.b * d * (d**2 + self.R**2) ** -1.5 + self.L_1 / self.h * np.exp(-d / self.h) * self._g(i, 1)

    def inductance(self, d, i):
        return (self.L_0 + self.L_1 * np.exp(-d / self.h)) * self._g(i, 2)

    def hall(self, d, i):
        return 0.05 * (d / 0.01 + 0.4) ** -3.0 + 3.9e-3 * i * (1.0 + 0.002 * np.exp(-d / self.h))


def grid(currents=CURRENTS, distances=DISTANCES):
    d, i = np.meshgrid(distances, currents, indexing="ij")
    return i.ravel(), d.ravel()


def force_table(force, currents=CURRENTS, distances=DISTANCES, actuator=None):
    """A table with a force alone; ``force`` takes distance and current."""
    i, d = grid(currents, distances)
    rows = pd.DataFrame({"current_A": i, "distance_m": d, "force_N": force(d, i), "status": "ok"})
    return SweepTable(rows, {} if actuator is None else {"actuator": actuator})


def paper_force(d, i):
    """Eq. (13) of the levitation paper, in N."""
    return 5.996e-9 * d**-4 + 4.509e-6 * i * d**-2


def full_table(truth=None, currents=CURRENTS, distances=DISTANCES, actuator=ACTUATOR):
    truth = truth or ClosedForm()
    table = force_table(truth.force, currents, distances, actuator)
    i, d = grid(currents, distances)
    table.rows.insert(3, "flux_linkage_Wb", truth.flux_linkage(d, i))
    table.rows.insert(4, "hall_T", truth.hall(d, i))
    return table


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
