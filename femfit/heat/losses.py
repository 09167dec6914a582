"""What eddy currents turn into heat, by material, for sinusoidal currents.

With patterns of 1 ohm, e = -(1 + s N)^-1 s m i and the loss in a material is e^H R_m e for the rms currents i. Over all
materials it is i^T (Re Z - R) i.
"""

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.tables.eddy_table import EddyTable


def eddy_losses(table: EddyTable, place: int, frequencies: FloatArray, currents: FloatArray) -> FloatArray:
    """Losses in W, shape (f, materials).

    Parameters
    ----------
    place : int
        Which of the table's distances.
    frequencies : array, shape (f,)
        In Hz.
    currents : array, shape (n,)
        Rms values in A of the circuits, in phase or against each other.
    """
    n, flux = 1 + len(table.circuits), table.flux_linkage[place]
    among, linked = flux[n - 1 :, n:], flux[n - 1 :, 1:n] @ currents
    s = 2j * np.pi * np.asarray(frequencies)[:, None, None]
    driven = np.linalg.solve(np.eye(len(among)) + s * among, s * linked[:, None])[..., 0]
    return np.asarray(np.einsum("fj,mjk,fk->fm", driven.conj(), table.resistances, driven).real)
