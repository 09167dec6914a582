"""Splines of known functions, for models without a sweep."""

import numpy as np

from femfit.model.bspline import TensorSpline, basis_matrix

REFERENCE_DISTANCE = 0.015


def fitted_spline(function, currents: np.ndarray, current_degree: int) -> TensorSpline:
    """Quartic spline in u = d_0 / d of a function of (d, i), by least squares over 15..45 mm."""
    u_knots = np.r_[[1 / 3] * 5, np.linspace(1 / 3, 1.0, 7)[1:-1], [1.0] * 5]
    i_knots = np.r_[[currents[0]] * (current_degree + 1), [currents[-1]] * (current_degree + 1)]
    u, i = (grid.ravel() for grid in np.meshgrid(np.linspace(1 / 3, 1.0, 80), currents, indexing="ij"))
    columns = basis_matrix(u, u_knots, 4)[:, :, None] * basis_matrix(i, i_knots, current_degree)[:, None, :]
    values = function(REFERENCE_DISTANCE / u, i)
    scale = np.abs(values).max()
    coefficients = np.linalg.lstsq(columns.reshape(len(u), -1), values / scale, rcond=None)[0] * scale
    return TensorSpline(u_knots, i_knots, 4, current_degree, coefficients.reshape(columns.shape[1:]))
