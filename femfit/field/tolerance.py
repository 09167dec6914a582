"""Accuracy on demand: the coarsest refinement level that gives force and flux linkage to a tolerance.

From level to level the polynomial order grows by one and the elements at the corners shrink to a quarter. At the
corners of iron, where the solution behaves like distance^(2/3), force and flux err by size^(4/3): a factor of six a
level; away from them by the order. Measured on eight actuators, errors fall by a factor of 5 to 10 a level.

Distances that share a mesh are checked at the group's two ends and its middle, against the next level: the difference
is the level's own error but for a sixth. All of the group is then solved on the one level, so that the discretisation,
and with it the error, changes smoothly with the distance. A distance with a mesh of its own is compared with the level
below instead, which costs a third of the solution: the difference is four times the error where that falls to a fifth,
and once the error where corners of saturating steel let it fall to a half (relay, push solenoid). What the comparison
solved on the level that is chosen is kept.

A row states the difference as its error. The settings have the defaults that the validation was made with.

References
----------
C. Schwab, p- and hp-Finite Element Methods, Oxford 1998, chapter 4: orders growing on meshes graded towards corners
converge exponentially.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from femfit.core.numerics import FloatArray
from femfit.core.sweep_columns import is_flux
from femfit.device.parts import Actuator
from femfit.field.newton import TOLERANCE
from femfit.field.point_rows import between, weakest


@dataclass(frozen=True)
class SolverSettings:
    """How fine the field is solved."""

    order: int = 5  # Polynomial order of the unknown; the error estimate uses ``order - 1`` on the same mesh
    # Element size at the corners of iron and magnets, as a fraction of the part's smallest extent. Fields are
    # singular there, and this sets the accuracy.
    corner_fraction: float = 0.03
    region_fraction: float = 0.45  # Largest element size within a part, as a fraction of its smallest extent
    grading: float = 0.5  # How fast elements grow, Netgen's convention: 0 uniform, 1 fastest
    # Radius of the domain over the largest distance of any part from the origin. The boundary carries the exact
    # condition of a dipole field, so what is left falls with the fifth power of this factor.
    outer_radius_factor: float = 16.0
    stretch_limit: float = 1.8  # Largest ratio of distances that one mesh is stretched over before a new one is made
    newton_tolerance: float = TOLERANCE  # Relative size of the last correction of a saturating part's field
    # Relative accuracy of force and flux linkage; order and element sizes are then chosen to meet it, those above are
    # not used (:mod:`femfit.field.tolerance`)
    tolerance: float | None = None
    # Highest frequency whose skin depth the elements in conducting parts resolve; 0 for static fields alone
    skin_frequency_Hz: float = 0.0


def settings_for(actuator: Actuator) -> SolverSettings:
    """The defaults, with the actuator's own tolerance."""
    return SolverSettings(tolerance=actuator.tolerance)


if TYPE_CHECKING:
    from femfit.field.problem import MeshedActuator

FIRST_ORDER = 4
"""Errors of lower orders scatter so much with distance that three checks do not bound them."""

CORNERS = (0.1, 0.03, 0.008, 0.002, 0.0005)
"""Sizes at the corners, as fractions of the part's smallest extent, from level to level."""

CHECK_SAFETY = 2.0
"""On the difference of two levels: the finer one's own error, and errors between the checked distances."""

OWN_MESH_LIMIT = 3
"""Groups of up to this many distances are not worth checks on the next level."""

MOST_CHECKED = 4  # currents of a nonlinear actuator

SMALL = 0.01
"""A force or flux linkage below this part of the largest at its distance is a passage through zero (conventional)."""

NEWTON_SHARE = 2e-3
"""Of the tolerance, for the last correction of Newton's iteration: it moves force and flux by 0.3 % of the tolerance at
most, and the inductance by 4 % (all points of the push solenoid)."""


@dataclass(frozen=True)
class LevelChoice:
    """The outcome of a search: all that a worker needs to solve the group's distances as the one who searched does.

    The errors of the force at the currents are relative to :func:`scale`, with the safety factor.
    """

    level: int
    currents_A: tuple[tuple[float, ...], ...]  # Of the circuits, a point
    force_errors: tuple[float, ...]


Rows = dict[float, dict[str, list[Any]]]
"""Columns of the sweep table by distance in m."""


def with_errors(columns: dict[str, list[Any]], points: FloatArray, choice: LevelChoice) -> dict[str, list[Any]]:
    """Columns at points (n, circuits) with the force's error: the largest of the checked points round each.

    Round it are those with no other checked one between.
    """
    if "force_N" not in columns:
        return columns
    checked = np.array(choice.currents_A)
    near = [[between(checked, x, place).sum() == 1 for place in checked] for x in points]
    error = np.max(np.where(near, choice.force_errors, 0.0), axis=1) * scale(columns["force_N"], points)
    return columns | {"force_error_N": error.tolist()}


def meet_tolerance(
    build: "Callable[[SolverSettings], MeshedActuator]",
    group: tuple[float, ...],
    swept: FloatArray,
    checked: FloatArray,
    settings: SolverSettings,
    first: FloatArray | None = None,
) -> "MeshedActuator":
    """Refine until ascending distances that share a mesh meet the tolerance at some of the swept points, or to its end.

    The rows say the error that is left, also where the last level does not meet the tolerance. ``first`` are the points
    of the coarsest level, the checked ones among them, of which the largest values say what is small. What was solved
    on the level of a group that shares no checks is kept.
    """
    shared = shares_checks(group)
    distances = (group[0], group[len(group) // 2], group[-1]) if shared else group
    tolerance, levels = float(settings.tolerance or 0.0), refinement_levels(settings)

    def solve(level: int, points: FloatArray) -> tuple["MeshedActuator", FloatArray, Rows]:
        problem = build(levels[level])
        return problem, points, {distance: problem.rows(distance, points) for distance in distances}

    coarsest = above = solve(0, checked if first is None else first)
    for level in range(1, len(levels)):
        below, above = above, solve(level, checked if shared else swept)  # the level above is the one to keep
        coarse, fine = (_at_points(checked, points, rows) for _, points, rows in (below, above))
        force, *linked = (
            CHECK_SAFETY * _difference(name, coarse, fine, coarsest[2], checked)
            for name in ("force_N", *filter(is_flux, coarse[0]))
        )
        if max(errors.max() for errors in (force, *linked)) <= tolerance:
            break
    chosen, (problem, points, rows) = (level - 1, below) if shared else (level, above)
    problem.choice = LevelChoice(chosen, tuple(map(tuple, checked.tolist())), tuple(force.tolist()))
    problem.found = points, {} if shared else rows
    return problem


def shares_checks(group: tuple[float, ...]) -> bool:
    """Whether a group's level is chosen by checks at some of its distances, for all of them."""
    return len(group) > OWN_MESH_LIMIT


def refinement_levels(settings: SolverSettings) -> list[SolverSettings]:
    """The levels, the coarsest first."""
    newton = max(settings.newton_tolerance, NEWTON_SHARE * (settings.tolerance or 0.0))
    return [
        replace(settings, order=FIRST_ORDER + k, corner_fraction=corner, newton_tolerance=newton, tolerance=None)
        for k, corner in enumerate(CORNERS)
    ]


def check_currents(points: FloatArray) -> FloatArray:
    """The points that a nonlinear actuator is checked at: the ends, the weakest, and with one circuit some between."""
    if points.shape[1] == 1:
        spread = np.linspace(0, len(points) - 1, MOST_CHECKED).round().astype(int)
    else:
        ends = (points == points.min(axis=0)) | (points == points.max(axis=0))
        spread = np.flatnonzero(ends.all(axis=1))
    return points[sorted({*spread.tolist(), weakest(points)})]


Columns = Sequence[Mapping[str, FloatArray]]
"""Columns of the sweep table, of one distance after the other."""


def _at_points(checked: FloatArray, points: FloatArray, rows: Rows) -> Columns:
    """Rows of points (n, circuits) at some of them."""
    places = {tuple(point): k for k, point in enumerate(points)}
    chosen = [places[tuple(point)] for point in checked]
    return [{name: np.array(values)[chosen] for name, values in columns.items()} for columns in rows.values()]


def _difference(name: str, first: Columns, second: Columns, coarsest: Rows, checked: FloatArray) -> FloatArray:
    """The largest difference over the distances, relative to the scale, for each checked point; shape (points,)."""
    worst = np.zeros(len(checked))
    for coarse, fine, values in zip(first, second, coarsest.values(), strict=True):
        if name in coarse and name in fine:  # a current that did not converge has NaN, which says nothing of the error
            small = SMALL * float(np.fmax.reduce(np.abs(values[name])))
            change, size = np.abs(coarse[name] - fine[name]), np.fmax(scale(fine[name], checked), small)
            worst = np.fmax(worst, np.divide(change, size, out=np.zeros(len(worst)), where=size > 0.0))
    return worst


def scale(values: Sequence[float] | FloatArray, currents: FloatArray) -> FloatArray:
    """What errors at one distance are relative to: a value, or that at the weakest currents if it is larger.

    Where the coil's force cancels the magnet's, the sum is no measure of what was computed. A force that passes through
    zero, or that vanishes by symmetry, is none either: errors there are relative to :data:`SMALL` of the largest.
    """
    size = np.abs(np.array(values, dtype=np.float64))
    size = np.fmax(size, size[weakest(currents)])
    return np.asarray(np.fmax(size, SMALL * np.fmax.reduce(size)))
