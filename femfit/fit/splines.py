"""Knots of splines that end at the data, and products of splines in several variables."""

from functools import reduce

import numpy as np

from femfit.core.numerics import FloatArray


def clamped_knots(breaks: FloatArray, degree: int) -> FloatArray:
    """The knots of splines of a degree over ascending breaks, the outermost ones repeated."""
    return np.concatenate([np.repeat(breaks[0], degree), breaks, np.repeat(breaks[-1], degree)])


def row_products(*factors: FloatArray) -> FloatArray:
    """Each product of one column of each factor at the same row, the last factor's columns fastest."""
    return reduce(lambda a, b: (a[:, :, None] * b[:, None, :]).reshape(len(a), -1), factors)
