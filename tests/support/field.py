"""Short ways to a solved field."""

from dataclasses import replace

import numpy as np

from femfit.field.layout import layout_of, stretch_groups
from femfit.field.problem import prepare
from femfit.field.tolerance import SolverSettings
from femfit.field.weak_form import function_of

QUICK = SolverSettings(order=3, corner_fraction=0.3)
"""For sweeps whose accuracy does not matter."""


def prepared(actuator, distance, settings=None):
    settings = settings or SolverSettings()
    layout = layout_of(actuator, settings)
    group = next(g for g in stretch_groups(actuator.sweep.distances_m, layout, settings) if distance in g)
    return prepare(actuator, group, layout, settings)


def solved(actuator, distance=None, settings=None):
    """Coefficients of force, flux linkage and Hall field at a distance (the first one by default), for one circuit."""
    distance = actuator.sweep.distances_m[0] if distance is None else distance
    return in_current(prepared(actuator, distance, settings).solve(distance))


def in_current(solution):
    """A distance's solution for one circuit, with forces as the three coefficients of 1, i and i^2."""
    forces = ("force", "force_change")
    known = {name: getattr(solution, name) for name in forces if getattr(solution, name) is not None}
    return replace(
        solution,
        flux_linkage=solution.flux_linkage[0],
        **{name: coefficients(matrix) for name, matrix in known.items()},
    )


def coefficients(matrix):
    """Of 1, i and i^2 in a quadratic form of (1, i)."""
    return np.array([matrix[0, 0], 2.0 * matrix[0, 1], matrix[1, 1]])


def fields(problem, distance):
    """Solutions w of the magnets and of 1 A in each circuit at a distance, with the mesh left stretched to it."""
    problem._moving.move_to(distance)
    problem._system.solve()
    return [function_of(problem._system.space, total) for total in problem._system.total]


def finer_settings(settings):
    """Settings for checking others: one order more and corners a quarter of the size, about ten times the work."""
    return SolverSettings(
        order=settings.order + 1,
        corner_fraction=settings.corner_fraction / 4.0,
        region_fraction=settings.region_fraction / 2.0,
        grading=0.6 * settings.grading,
        outer_radius_factor=2.0 * settings.outer_radius_factor,
        stretch_limit=1.0,
    )
