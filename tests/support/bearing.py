"""A two-coil axial bearing from closed forms, as a sweep table."""

import numpy as np
import pandas as pd

from femfit.device.electrics import HallElement
from femfit.tables.sweep_table import SweepTable

DISTANCES = np.linspace(0.2e-3, 0.8e-3, 9)
NAMES = ("lower", "upper")
CIRCUITS = [
    {"name": "lower", "resistance_ohm": 1.5, "inductance_H": 0.0, "voltage_min_V": -24.0, "voltage_max_V": 24.0},
    {
        "name": "upper",
        "resistance_ohm": 1.2,
        "inductance_H": 1e-3,
        "voltage_min_V": 0.0,
        "voltage_max_V": 24.0,
        "drive": {"diode_V": 0.7},
    },
]
ENTRY = {"name": "bearing", "mass_kg": 0.5, "circuits": CIRCUITS, "mechanics": {"gravity_m_s2": -9.81}}


def form(alone, magnet, lower, mutual, upper):
    """A symmetric matrix (n, 3, 3) of v = (1, i_1, i_2), of entries (n,) or the same everywhere."""
    rows = np.broadcast_arrays(alone, magnet, -magnet, magnet, lower, -mutual, -magnet, -mutual, upper)
    return np.moveaxis(np.reshape(rows, (3, 3, -1)), -1, 0)


class Bearing:
    """Two gaps d and 1 mm - d: L_1 = A / (d + a), L_2 = A / (1 mm - d + a), a mutual M(d) and a magnet's flux."""

    AREA, PATH, GAP = 6e-6, 0.15e-3, 1e-3
    ALONE, MAGNET, MUTUAL = 40.0, (0.01, 3.0), (1e-3, 0.4)  # of d^2; with their slopes

    def matrix(self, d):
        """M of v = (1, i_1, i_2), and its slope."""
        one, two = d + self.PATH, self.GAP - d + self.PATH
        (magnet, rising), (mutual, slope) = self.MAGNET, self.MUTUAL
        M = form(self.ALONE * d**2, magnet + rising * d, self.AREA / one, mutual + slope * d, self.AREA / two)
        return M, form(2.0 * self.ALONE * d, rising, -self.AREA / one**2, slope, self.AREA / two**2)

    def force(self, d, i):
        v = np.concatenate([np.ones((len(d), 1)), i], axis=1)
        return -0.5 * np.einsum("na,nab,nb->n", v, self.matrix(d)[1], v)

    def flux_linkage(self, d, i):
        v = np.concatenate([np.ones((len(d), 1)), i], axis=1)
        return np.einsum("nab,nb->na", self.matrix(d)[0], v)[:, 1:]


TRUTH = Bearing()


def grid(distances, *currents):
    d, *i = (axis.ravel() for axis in np.meshgrid(distances, *currents, indexing="ij"))
    return d, np.stack(i, axis=1)


def table_of(truth=TRUTH, distances=DISTANCES, currents=(-2.0, 0.0, 2.0), entry=ENTRY):
    d, i = grid(distances, currents, currents)
    flux = truth.flux_linkage(d, i)
    columns = {"current_lower_A": i[:, 0], "current_upper_A": i[:, 1], "distance_m": d, "force_N": truth.force(d, i)}
    columns |= {"flux_linkage_lower_Wb": flux[:, 0], "flux_linkage_upper_Wb": flux[:, 1], "status": "ok"}
    return SweepTable(pd.DataFrame(columns), {"actuator": entry})


def hall_field(d, i):
    """Field in T at an element that both currents reach, and that tells the distance at all of them."""
    return 0.01 + 60.0 * d + 4e-3 * i[..., 0] - 3e-3 * i[..., 1]


def table_with_hall(truth=TRUTH, entry=ENTRY, **hall):
    """The sweep with a Hall element of 50 V/T."""
    table = table_of(truth, entry={**entry, "hall": vars(HallElement(0.04, 5e-3, **hall))})
    rows = table.rows
    currents = rows[["current_lower_A", "current_upper_A"]].to_numpy()
    return SweepTable(rows.assign(hall_T=hall_field(rows["distance_m"].to_numpy(), currents)), table.manifest)


class Symmetric(Bearing):
    """Without the magnet, and the same seen from both sides."""

    ALONE, MAGNET, MUTUAL = 0.0, (0.0, 0.0), (1e-3, 0.0)

    def force_per_current(self, current):
        """dF/di_1 in the middle at a bias."""
        return self.AREA * current / (0.5 * self.GAP + self.PATH) ** 2

    def stiffness(self, current):
        """dF/dd in the middle at a bias."""
        return -2.0 * self.AREA * current**2 / (0.5 * self.GAP + self.PATH) ** 3
