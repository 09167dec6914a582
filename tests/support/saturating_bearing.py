"""A steel bearing of two circuits without a magnet, in closed form, as a folder with its sweep.

W' = sum over both magnets of E (sqrt(1 + q^2) - 1): q is the magnet's ampere-turns, a part of which is the other
circuit's, over those at which its iron saturates, times the reach of its iron over that and the gap.
"""

import json
from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from support.bearing import grid

NAMES = ("bottom", "top")
ENERGY, REACH, GAP, COUPLING = 0.12, 0.15e-3, 1e-3, 0.6 * np.array([[1.0, 0.02], [0.02, 1.0]])
DISTANCES = np.array([0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8]) * 1e-3
KIND = {
    "fixed_magnet": False, "moving_magnet": False, "fixed_iron": True, "moving_iron": True, "coil": True,
    "saturates": True,
}  # fmt: skip
CIRCUIT = {"resistance_ohm": 0.8, "inductance_H": 0.0, "voltage_min_V": -24.0, "voltage_max_V": 24.0}
ENTRY = {
    "name": "steel-bearing",
    "mass_kg": 0.6,
    "kind": KIND,
    "circuits": [{"name": name, **CIRCUIT} for name in NAMES],
    "mechanics": {"gravity_m_s2": -9.81},
    "sensors": [
        {"kind": "position", "name": "gap", "noise": 1e-6, "distances_m": [0, 1], "readings": [0, 1], "unit": "m"}
    ],
    "reference_distances_m": [0.5e-3, 0.55e-3],
}


@dataclass(frozen=True)
class SteelBearing:
    """Energy in J, reach in m, ampere-turns over those at the knee by each current in A, and of a magnet."""

    energy: float = ENERGY
    reach: float = REACH
    coupling: np.ndarray = field(default_factory=lambda: COUPLING)
    magnet: float = 0.0

    def drive(self, d, i):
        """q of both magnets, its slope in d over itself, and its slopes in the currents (rows, magnet, circuit)."""
        gap = np.stack([d + self.reach, GAP - d + self.reach], axis=-1)
        per_ampere = (self.reach / gap)[..., None] * self.coupling
        q = np.einsum("...mk,...k->...m", per_ampere, i) + self.magnet * self.reach / gap
        return q, np.array([-1.0, 1.0]) / gap, per_ampere

    def force(self, d, i):
        q, rate, _ = self.drive(d, i)
        return -np.sum(self.energy * q**2 * rate / np.sqrt(1.0 + q**2), axis=-1)

    def flux_linkage(self, d, i):
        q, _, per_ampere = self.drive(d, i)
        return np.einsum("...m,...mk->...k", self.energy * q / np.sqrt(1.0 + q**2), per_ampere)

    def inductance(self, d, i):
        q, _, per_ampere = self.drive(d, i)
        return np.einsum("...m,...mj,...mk->...jk", self.energy * (1.0 + q**2) ** -1.5, per_ampere, per_ampere)

    def rows(self, names, distances, *currents):
        """Rows of a sweep without inductances."""
        d, i = grid(np.array(distances), *map(np.array, currents))
        rows = pd.DataFrame({"distance_m": d, "force_N": self.force(d, i), "status": "ok"})
        for k, (name, flux) in enumerate(zip(names, self.flux_linkage(d, i).T, strict=True)):
            rows[f"current_{name}_A"], rows[f"flux_linkage_{name}_Wb"] = i[:, k], flux
        return rows


STEEL = SteelBearing()
force, inductance = STEEL.force, STEEL.inductance


def swept_rows(bottom, top, distances=DISTANCES):
    """Rows of its sweep."""
    rows = STEEL.rows(NAMES, distances, bottom, top)
    slopes = inductance(rows["distance_m"].to_numpy(), rows[[f"current_{name}_A" for name in NAMES]].to_numpy())
    each = {f"inductance_{name}_H": slopes[:, k, k] for k, name in enumerate(NAMES)}
    return rows.assign(**each, inductance_bottom_top_H=slopes[:, 0, 1])


def write_sweep(folder, bottom, top, distances=DISTANCES, entry=ENTRY):
    """A folder as ``femfit sweep`` leaves it."""
    folder.mkdir(parents=True)
    swept_rows(bottom, top, distances).to_csv(folder / "sweep.csv", index=False)
    (folder / "manifest.json").write_text(json.dumps({"kind": "sweep", "name": entry["name"], "actuator": entry}))
    return folder


def share(found, true):
    """Error of a force, as a part of itself and at least of 2 % of the largest."""
    return np.abs(found - true) / np.maximum(np.abs(true), 0.02 * np.abs(true).max())
