"""Points of the circuits' currents: how they are given, swept and ordered."""

from collections.abc import Sequence
from itertools import product
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from femfit.core.numerics import BIAS_SHARE, BoolArray, FloatArray
from femfit.device.parts import Actuator, SweepAxes

if TYPE_CHECKING:
    import pandas as pd

CurrentsLike: TypeAlias = float | Sequence[float] | FloatArray
"""Currents in A: of shape (points, circuits), or one number a point where there is one circuit at most."""


def current_points(currents: CurrentsLike, circuits: int) -> FloatArray:
    """Currents in A of shape (points, circuits); without a circuit the zeros that stand for it are left out."""
    values = np.atleast_1d(np.asarray(currents, dtype=np.float64))
    return np.zeros((len(values), 0)) if circuits == 0 else values.reshape(-1, circuits)


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


def between(points: FloatArray, start: FloatArray, end: FloatArray) -> BoolArray:
    """Which points lie between two others, each current between theirs; shape (points,)."""
    low, high = np.minimum(start, end), np.maximum(start, end)
    return np.asarray(np.all((low <= points) & (points <= high), axis=-1))


def bias_currents(actuator: Actuator, rows: "pd.DataFrame") -> dict[float, tuple[float, ...]]:
    """The currents in A by distance about which the fields of a saturating actuator's eddy currents are small.

    Those that the drawing gives; else the middle of the swept ones, beside magnets and of several circuits. A single
    circuit without a magnet gets those of BIAS_SHARE of its largest flux linkage in rows of the sweep: the iron is then
    about the same all along the stroke, and so are its eddy currents. Nothing where nothing saturates.
    """
    swept = actuator.sweep.distances_m
    if not actuator.saturates:
        return {}
    if actuator.eddy_bias_A:
        return dict.fromkeys(swept, actuator.eddy_bias_A)
    axes = (actuator.sweep.currents_A, *actuator.sweep.further_A)[: len(actuator.circuits)]
    bias = dict.fromkeys(swept, tuple(0.5 * (min(axis) + max(axis)) for axis in axes))
    magnet = any(region.material.remanence_T for region in actuator.regions)
    if magnet or len(axes) != 1:
        return bias
    current, linked = rows["current_A"].to_numpy(), np.abs(rows["flux_linkage_Wb"].to_numpy())
    for distance in swept:
        here = np.flatnonzero((rows["distance_m"] == distance) & (rows["status"] == "ok"))
        here = here[np.argsort(linked[here])]
        if len(here):
            bias[distance] = (float(np.interp(BIAS_SHARE * np.nanmax(linked), linked[here], current[here])),)
    return bias
