"""Short ways to a solved field."""

from femfit.field.layout import layout_of, stretch_groups
from femfit.field.linear_point import LinearActuator
from femfit.field.settings import SolverSettings


def prepared(actuator, distance, settings=None):
    """The prepared problem of the group that a distance belongs to."""
    settings = settings or SolverSettings()
    layout = layout_of(actuator, settings)
    group = next(g for g in stretch_groups(actuator.sweep.distances_m, layout, settings) if distance in g)
    return LinearActuator(actuator, group, layout, settings)


def solved(actuator, distance=None, settings=None):
    """Coefficients of force, flux linkage and Hall field at a distance (the first one by default)."""
    distance = actuator.sweep.distances_m[0] if distance is None else distance
    return prepared(actuator, distance, settings).solve(distance)


def fields(problem, distance):
    """Solutions w of magnets and of 1 A at a distance, with the mesh left stretched to it."""
    problem._moving.move_to(distance)
    problem._system.solve()
    return problem._system.total


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
