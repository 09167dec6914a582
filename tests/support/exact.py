"""Closed forms that tests of several rooms compare with."""

import numpy as np


def axis_field_of_cylinder(remanence, radius, height, z):
    """B_z on the axis at z above the upper face of a uniformly magnetised cylinder."""
    return remanence / 2.0 * ((z + height) / np.hypot(radius, z + height) - z / np.hypot(radius, z))
