"""Covariances of first estimates."""

import numpy as np


def initial_covariance(distance_m=1e-3, velocity_m_s=0.05, current_A=0.1, biases=()):
    """From standard deviations; those of biases after them."""
    return np.diag(np.square([distance_m, velocity_m_s, current_A, *biases]))
