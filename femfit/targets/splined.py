"""The co-energy that effects change, as splines at fixed parameters: less work where an effect solves an equation.

W'(d, i) and the field at the Hall element are interpolated at Greville's abscissae, by finer splines until force, flux
linkage and field are near enough.

References
----------
C. de Boor, A Practical Guide to Splines (Springer, 2001), chapters IX (Greville's abscissae) and XVII (tensors).
"""

from dataclasses import replace

import casadi as ca
import numpy as np
from casadi import SX
from scipy.interpolate import make_interp_spline

from femfit.core.graph import GraphFunction, building
from femfit.core.numerics import FloatArray
from femfit.fit.basis import clamped_knots
from femfit.model.actuator_model import ActuatorModel
from femfit.model.bspline import DistanceCoordinate, TensorSpline
from femfit.model.hall import HallSpline
from femfit.model.magnetics import CoenergySpline, derivatives_of

SPLINES = ((4, 3), (8, 3), (8, 4), (16, 4))
"""Chosen: cells along the distance and along the current, and degree; at 3 inductances are continuous."""

NEAR = 1e-3
"""Chosen: error of force, flux linkage and field over their largest values in the model's domain."""

CHECKED = 41
"""Numerical: distances, and currents, at which errors are looked for."""


def splined(model: ActuatorModel) -> tuple[ActuatorModel, float]:
    """The model with changed co-energy and Hall field as splines, and their largest error over the largest value.

    The model itself, and 0, where no effect changes its co-energy, the change follows states of effects or currents of
    several circuits, a spline takes as many operations, or none of :data:`SPLINES` comes near.
    """
    changing, box = [added for added in model.effects if added.effect.coenergy is not None], model.validity
    if not changing or any(added.memory for added in changing) or len(box.current_limits_A) != 1:
        return model, 0.0
    base, exact = model.without_effects.magnetics, _field(model)
    coordinate = getattr(base, "coordinate", None) or DistanceCoordinate(box.distance_max_m)
    distances, currents = box.grid(CHECKED, CHECKED)
    points = np.vstack([distances, currents.T])
    wanted = exact(points)[1:]
    for cells, degree in SPLINES:
        changed = _interpolated(model, exact, coordinate, cells, degree)
        field = _field(changed)
        if field.operations >= exact.operations:
            break
        error = float(np.max(np.abs(field(points)[1:] - wanted).max(axis=1) / np.abs(wanted).max(axis=1)))
        if error <= NEAR:
            return changed, error
    return model, 0.0


def _field(model: ActuatorModel) -> GraphFunction:
    """(d, i) -> W', force, flux linkage, and the field at a Hall element apart from effects of its reading."""
    with building():
        d, i = SX.sym("d"), SX.sym("i")
        coenergy = SX(model.magnetics.with_memory({})(d, i))
        parts = derivatives_of(("value", "force", "flux_linkage"), coenergy, d, i).values()
        hall = [] if model.sensor is None else [SX(model.sensor.field.with_memory({})(d, i))]
        return GraphFunction([ca.vertcat(d, i)], ca.vertcat(*parts, *hall))


def _interpolated(
    model: ActuatorModel, exact: GraphFunction, coordinate: DistanceCoordinate, cells: int, degree: int
) -> ActuatorModel:
    """The model with splines through the values at Greville's abscissae."""
    box = model.validity
    ends = np.sort(coordinate.of(np.array([box.distance_min_m, box.distance_max_m])))
    axes = [clamped_knots(np.linspace(a, b, cells + 1), degree) for a, b in (ends, box.current_limits_A[0])]
    u, i = (np.convolve(knots, np.full(degree, 1.0 / degree), mode="valid")[1:-1] for knots in axes)
    points = np.stack([x.ravel() for x in np.meshgrid(coordinate.distance(u), i, indexing="ij")])

    def spline(values: FloatArray) -> TensorSpline:
        along = make_interp_spline(u, values.reshape(len(u), len(i)), degree, t=axes[0]).c
        both = make_interp_spline(i, along.T, degree, t=axes[1]).c.T
        return TensorSpline(axes[0], axes[1], degree, degree, both)

    coenergy, _, _, *hall = exact(points)
    sensor = model.sensor
    if sensor is not None:
        sensor = replace(sensor, field=HallSpline(coordinate, spline(hall[0])))
    return replace(model, magnetics=CoenergySpline(coordinate=coordinate, spline=spline(coenergy)), sensor=sensor)
