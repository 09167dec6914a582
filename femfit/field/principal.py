"""Principal components of induced currents, by their power."""

import numpy as np

from femfit.core.arrays import FloatArray


def principal(products: FloatArray, tolerance: float) -> FloatArray:
    """Factors (q, k) of principal components of k rows by their products (k, k), the largest power first.

    What is left out of all rows together has less than the tolerance's square of their power.
    """
    powers, directions = np.linalg.eigh(products)
    kept = np.cumsum(np.maximum(powers, 0.0)) > tolerance**2 * powers.sum()
    return np.asarray(directions[:, kept].T[::-1])
