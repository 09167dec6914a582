"""Points of the circuits' currents: how they are given, swept and ordered."""

from collections.abc import Sequence
from itertools import product
from typing import TypeAlias

import numpy as np

from femfit.core.arrays import BoolArray, FloatArray
from femfit.device.parts import Actuator, SweepAxes

CurrentsLike: TypeAlias = float | Sequence[float] | FloatArray
"""Currents in A: of shape (points, circuits), or one number a point where there is one circuit at most."""


def current_points(currents: CurrentsLike, circuits: int) -> FloatArray:
    """Currents in A of shape (points, circuits); without a circuit the zeros that stand for it are left out."""
    given = np.atleast_1d(np.asarray(currents, dtype=np.float64))
    return np.zeros((len(given), 0)) if circuits == 0 else given.reshape(-1, circuits)


def sources(currents: CurrentsLike, circuits: Sequence[str]) -> FloatArray:
    """(1, i_1 .. i_n) of each point; shape (points, 1 + circuits)."""
    points = current_points(currents, len(circuits))
    return np.column_stack([np.ones(len(points)), points])


def swept_currents(axes: SweepAxes) -> FloatArray:
    """All combinations of a sweep's currents in A, the last circuit's fastest; a column of zeros without one."""
    return np.array(list(product(axes.currents_A, *axes.further_A)))


def weakest(points: FloatArray) -> int:
    """The place of the point with the smallest currents."""
    return int(np.argmin(np.linalg.norm(points, axis=1))) if points.size else 0


def between(points: FloatArray, one: FloatArray, other: FloatArray) -> BoolArray:
    """Which points lie between two others, each current between theirs; shape (points,)."""
    low, high = np.minimum(one, other), np.maximum(one, other)
    return np.asarray(np.all((low <= points) & (points <= high), axis=-1))


def bias_currents(actuator: Actuator) -> FloatArray:
    """The currents in A, shape (circuits,), about which the fields of a saturating actuator's eddy currents are small.

    Those that the drawing gives; else the middle of the swept ones beside a magnet, and half of the largest without.
    """
    if actuator.eddy_bias_A:
        return np.array(actuator.eddy_bias_A)
    axes = (actuator.sweep.currents_A, *actuator.sweep.further_A)[: len(actuator.circuits)]
    if any(region.material.remanence_T for region in (*actuator.fixed, *actuator.moving.regions)):
        return np.array([0.5 * (min(axis) + max(axis)) for axis in axes])
    return np.array([0.5 * max(axis, key=abs) for axis in axes])
