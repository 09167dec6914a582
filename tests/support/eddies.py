"""Eddy currents from closed forms: polynomials of the distance, so that splines hold them to rounding."""

from dataclasses import replace

import numpy as np

from femfit.model.bspline import DistanceCoordinate, basis_matrix
from femfit.model.eddy_currents import EddyCurrents, EddyError
from femfit.model.validity import ActuatorKind

REFERENCE_M = 0.03
"""Of the coordinate d / d_0, in which everything below is a polynomial."""


def knots_over(low_m, high_m, degree, inner=()):
    ends = np.array([low_m, high_m]) / REFERENCE_M
    return np.concatenate([np.full(degree + 1, ends[0]), np.asarray(inner) / REFERENCE_M, np.full(degree + 1, ends[1])])


def spline_of(function, knots, degree):
    """Coefficients (N, ...) of a polynomial function of u with values (points, ...)."""
    u = np.linspace(knots[0], knots[-1], 4 * (len(knots) - degree))
    values = function(u)
    flat = values.reshape(len(u), int(np.prod(values.shape[1:])))
    found = np.linalg.lstsq(basis_matrix(u, knots, degree), flat, rcond=None)[0]
    return found.reshape(len(knots) - degree - 1, *values.shape[1:])


def couplings(u, n, r):
    """C: patterns act like a part of an ampere in each circuit, less the farther away."""
    k, j = np.arange(r), np.arange(n)[:, None]
    return (0.55 - 0.1 * k - 0.07 * j) * (1.0 + (0.3 * (k + 1) - 0.2 * j) * (1.0 - u[:, None, None]))


def flux_linkages(u, n, r):
    """Lambda in Wb."""
    k = np.arange(r)
    return 2e-4 * (1.0 + k) * (1.0 - 0.8 * u[:, None] + 0.3 * (k - 1.0) * u[:, None] ** 2)


def inductances(u, n, r, time_constants):
    """Q in H for patterns of 1 ohm: neighbours are linked a little."""
    rows, columns = np.triu_indices(r)
    apart = np.where(rows == columns, 1.0, 0.1 / (1.0 + np.abs(rows - columns)))
    size = np.sqrt(np.take(time_constants, rows) * np.take(time_constants, columns)) * apart
    return size * (1.0 + (0.2 + 0.05 * (rows + columns)) * (1.0 - u[:, None]) ** 2)


def eddies(circuits, time_constants, low_m=0.015, high_m=0.045, hall=True):
    """Patterns of 1 ohm whose inductances beside the circuits' are the time constants in s, at 30 mm."""
    n, r, degree = len(circuits), len(time_constants), 3
    knots = knots_over(low_m, high_m, degree, (0.5 * (low_m + high_m),))
    return EddyCurrents(
        names=tuple(f"eddy_{k + 1}" for k in range(r)),
        resistances_ohm=np.ones(r),
        circuits=tuple(circuits),
        coordinate=DistanceCoordinate(REFERENCE_M, kind="distance"),
        u_knots=knots,
        u_degree=degree,
        couplings=spline_of(lambda u: couplings(u, n, r), knots, degree),
        flux_linkages_Wb=spline_of(lambda u: flux_linkages(u, n, r), knots, degree),
        inductances_H=spline_of(lambda u: inductances(u, n, r, time_constants), knots, degree),
        hall_T_per_A=spline_of(lambda u: 1e-3 * (1.0 + np.arange(r)) * (1.0 - 0.4 * u[:, None]), knots, degree)
        if hall
        else None,
        error=EddyError(1.0, 1e4, 0.004, 0.009, 0.006),
    )


def magnets_alone(model):
    kind = ActuatorKind(True, True, False, False, coil=False, saturates=False)
    return replace(
        model, circuits=(), sensor=None, kind=kind, validity=replace(model.validity, current_limits_A=np.zeros((0, 2)))
    )


def with_eddies(model, time_constants=(10e-3, 3e-3, 0.5e-3)):
    box = model.validity
    found = eddies(
        model.circuit_names, time_constants, box.distance_min_m, box.distance_max_m, hall=model.sensor is not None
    )
    return replace(model, eddy=found)
