"""The array types of every signature, and places along an axis."""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

FloatArray: TypeAlias = NDArray[np.float64]
BoolArray: TypeAlias = NDArray[np.bool_]
IntArray: TypeAlias = NDArray[np.intp]
ComplexArray: TypeAlias = NDArray[np.complex128]


def evenly_spread(length: int, count: int) -> IntArray:
    """At most so many places of a sequence, its ends among them.

    Examples
    --------
    >>> evenly_spread(10, 4)
    array([0, 3, 6, 9])
    """
    return np.unique(np.linspace(0, length - 1, min(length, count)).round().astype(np.intp))
