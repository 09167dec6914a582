"""The inner product of two vectors, in one thread.

BLAS splits long products over threads: on a machine whose cores are all at work their waiting costs a hundred times the
product, and the digits would depend on the number of threads, which a resumed sweep must not.
"""

import numpy as np

from femfit.core.arrays import FloatArray


def inner(a: FloatArray, b: FloatArray) -> float:
    """Sum of a b.

    Parameters
    ----------
    a, b : array, shape (n,)
        Any.
    """
    return float(np.einsum("i,i->", a, b))
