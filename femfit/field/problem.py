r"""The field problem of an actuator: all currents of a linear actuator from one factorisation a distance.

The field is a sum over the sources s = (1, i_1 .. i_n) of the magnets' and of each circuit's with 1 A, so the force is
a quadratic form in s, flux linkages and the Hall field are linear in it, and the co-energy is a quadratic form again.
The stress of the moving part's own field integrates to zero, but not on a mesh: it is evaluated on the same mesh with
everything else taken away, and subtracted (:mod:`femfit.field.linear_system`).

The flux linkage of windings without current is a quadrature of the solved field over their sections. A winding of N
turns that fill a section of area A links (N / A) integral 2 pi r A_phi = (N / A) integral 2 pi r^2 w. Without a current
it changes nothing, so the mesh knows nothing of it, and it may share its section with a coil. The section is cut at the
heights of its corners; in each strip the nodes of Gauss lie along z, and along r between edges.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, Any, TypeAlias

import ngsolve as ng
import numpy as np
from ngsolve import GridFunction

from femfit.core.errors import FieldSolverError
from femfit.core.numerics import FloatArray
from femfit.device.drawn_numbers import DrawnNumber
from femfit.device.electrics import PickupCoil
from femfit.device.parts import Actuator
from femfit.field.layout import Layout
from femfit.field.linear_system import LinearSystem
from femfit.field.moving_mesh import MovingMesh
from femfit.field.point_rows import (
    Coefficients,
    CurrentsLike,
    current_points,
    sources,
    superpose,
    swept_currents,
    weakest,
)
from femfit.field.signature_rows import SignatureRows
from femfit.field.tolerance import (
    LevelChoice,
    SolverSettings,
    ToleranceProblem,
    check_currents,
    meet_tolerance,
    refinement_levels,
)

NODES = 6
"""Numerical: of Gauss along each side of a strip, exact for polynomials of degree 11; fields have degree 5 or so."""

INSIDE = 0.9
"""Numerical: of the radius up to which the field is solved; the mesh's outer edges are chords of that circle."""

STRIPS = 4
"""Numerical: a section is cut into at least as many strips, and each of them into as many cells."""


class PickupCoils:
    """The pickup coils of an actuator on a mesh; none where the drawing has none."""

    def __init__(self, actuator: Actuator, moving: MovingMesh) -> None:
        self._moving = moving
        coils = [sensor for sensor in actuator.sensors if isinstance(sensor, PickupCoil)]
        for coil in coils:
            farthest = max(float(np.hypot(r, z)) for r, z in coil.vertices_m)
            if farthest > INSIDE * moving.layout.outer_radius:
                raise FieldSolverError(
                    f"Pickup coil {coil.name!r} must lie near the actuator; it reaches {1e3 * farthest:.4g} mm from "
                    f"the origin, and the field ends at {1e3 * moving.layout.outer_radius:.4g} mm. Draw it nearer."
                )
        self._coils = [(coil, *section_nodes(coil.vertices_m)) for coil in coils]

    def at(self, distance: float) -> Callable[[GridFunction], dict[str, float]]:
        """What a solution gives each coil's flux linkage in Wb, with the moving part at a distance in m."""
        placed = {}
        for coil, points, weights in self._coils:
            physical = points + np.array([0.0, distance if coil.moves else 0.0])
            fields = self._moving.unstretched(physical, distance)
            density = coil.turns / weights.sum() * 2.0 * np.pi * points[:, 0] ** 2
            placed[coil.name] = self._moving.mesh(fields[:, 0], fields[:, 1]), density * weights
        return lambda w: {name: float(weights @ w(places)[:, 0]) for name, (places, weights) in placed.items()}


def section_nodes(corners: tuple[tuple[float, float], ...]) -> tuple[FloatArray, FloatArray]:
    """Nodes (n, 2) and weights (n,) for integrals over the inside of a polygon; the weights sum to its area."""
    starts = np.array(corners)
    stops, heights = np.roll(starts, -1, axis=0), np.unique(starts[:, 1])
    points: list[FloatArray] = []
    weights: list[FloatArray] = []
    for low, high in pairwise(heights):
        strips = max(1, int(np.ceil(STRIPS * (high - low) / np.ptp(heights))))
        for z, along in zip(*_in_cells(low, high, strips), strict=True):
            crosses = (starts[:, 1] > z) != (stops[:, 1] > z)
            a, b = starts[crosses], stops[crosses]
            edges = np.sort(a[:, 0] + (z - a[:, 1]) / (b[:, 1] - a[:, 1]) * (b[:, 0] - a[:, 0]))
            for near, far in zip(edges[::2], edges[1::2], strict=True):
                r, across = _in_cells(near, far, STRIPS)
                points.append(np.column_stack([r, np.full_like(r, z)]))
                weights.append(along * across)
    return np.concatenate(points), np.concatenate(weights)


def _in_cells(low: float, high: float, cells: int) -> tuple[FloatArray, FloatArray]:
    """Nodes of Gauss and their weights between two ends, in cells of equal width."""
    x, w = np.polynomial.legendre.leggauss(NODES)
    ends = np.linspace(low, high, cells + 1)
    half = 0.5 * np.diff(ends)[:, None]
    return (0.5 * (ends[1:] + ends[:-1])[:, None] + half * x).ravel(), (half * w).ravel()


class MeshedActuator(ABC):
    """One mesh of an actuator, to be stretched over a group of distances.

    The group's distances are in m, ascending; with ``estimate`` the force is also solved one order lower, for its
    error.
    """

    def __init__(
        self,
        actuator: Actuator,
        group: tuple[float, ...],
        layout: Layout,
        settings: SolverSettings,
        *,
        estimate: bool = True,
    ) -> None:
        self._actuator, self._group = actuator, group
        self._circuits = tuple(circuit.name for circuit in actuator.circuits)
        self._moving = MovingMesh(actuator, group, layout, settings)
        self.mesh = self._moving.mesh
        self._pickups = PickupCoils(actuator, self._moving)
        self._signatures: SignatureRows | None = None
        self.unknowns = self._discretise(settings, estimate=estimate)

    @abstractmethod
    def _discretise(self, settings: SolverSettings, *, estimate: bool) -> int:
        """Make the systems on the mesh; the number of unknowns of the finest one."""

    def _slopes(self, numbers: Sequence[DrawnNumber], space: ng.H1, loads: FloatArray) -> SignatureRows:
        """The signatures of numbers, made when they are first asked for."""
        if self._signatures is None:
            self._signatures = SignatureRows(self._actuator, numbers, self._moving, space, loads)
        return self._signatures


class LinearActuator(MeshedActuator):
    """An actuator with linear materials, of which a distance is solved for all currents at once."""

    def _discretise(self, settings: SolverSettings, *, estimate: bool) -> int:
        self._system = LinearSystem(self._moving, self._actuator, settings.order)
        self._lower = LinearSystem(self._moving, self._actuator, settings.order - 1) if estimate else None
        self._solved: float | None = None  # distance that the fields are of
        return int(self._system.space.ndof)

    def solve(self, distance: float) -> Coefficients:
        """Solve at a distance."""
        with self._moving.at(distance):
            fine = self._system.evaluate()
            linked = [*map(self._pickups.at(distance), self._system.total)]
            lower = None if self._lower is None else self._lower.evaluate()
        self._solved = distance
        change = None if lower is None else fine.force - lower.force
        pickup = {name: np.array([links[name] for links in linked]) for name in linked[0]}
        return replace(fine, force_change=change, pickup=pickup)

    def rows(self, distance: float, currents: CurrentsLike) -> dict[str, list[Any]]:
        """Columns of the sweep table at a distance, one value a point of the currents."""
        solution = self.solve(distance)
        if not np.all(np.isfinite(solution.force)):
            raise FieldSolverError(
                "the solution is not finite. Look for extreme dimensions or materials in the actuator file."
            )
        columns = superpose(sources(currents, self._circuits), solution, self._circuits)
        return {name: values.tolist() for name, values in columns.items()}

    def signatures(self, distance: float, currents: CurrentsLike, numbers: Sequence[DrawnNumber]) -> FloatArray:
        """As :meth:`femfit.field.signature_rows.SignatureRows.of_states`, at points of the currents."""
        if self._solved != distance:
            self.solve(distance)
        system = self._system
        totals = np.stack([total.vec.FV().NumPy() for total in system.total])
        points = current_points(currents, len(self._circuits))
        slopes = self._slopes(numbers, system.space, system.loads[1:])
        return slopes.of_sources(distance, points, totals, system.respond)

    def field(self, distance: float, currents: CurrentsLike) -> tuple[GridFunction, float]:
        """The field w and the force in N at a point, with the mesh left stretched to it."""
        solution = self.solve(distance)
        self._moving.move_to(distance)
        (factors,) = sources(currents, self._circuits)
        field = ng.GridFunction(self._system.space)
        for factor, total in zip(factors, self._system.total, strict=True):  # as solved
            field.vec.data += factor * total.vec
        return field, float(factors @ solution.force @ factors)


if TYPE_CHECKING:
    from femfit.field.tolerance import LevelProblem

    FieldProblem: TypeAlias = LevelProblem | ToleranceProblem


def prepare(
    actuator: Actuator,
    group: tuple[float, ...],
    layout: Layout,
    settings: SolverSettings,
    choice: LevelChoice | None = None,
    currents: CurrentsLike | None = None,
) -> "FieldProblem":
    """Mesh an actuator for a group of ascending distances in m that share the mesh.

    Parameters
    ----------
    currents : array
        Those that alone are wanted, and at which the tolerance is met; all that are swept where None. Materials that do
        not saturate are solved for all of them at once.
    """
    saturates = actuator.saturates
    kind: Callable[..., LevelProblem] = LinearActuator
    if saturates:
        from femfit.field.nonlinear_point import NonlinearActuator  # noqa: PLC0415  loads interpolation and sparse matrices

        kind = NonlinearActuator
    if settings.tolerance is None:
        return kind(actuator, group, layout, settings)
    level = partial(kind, actuator, group, layout, estimate=False)
    if choice is not None:
        chosen = refinement_levels(settings)[choice.level]
        return ToleranceProblem(level(chosen), chosen, choice)
    circuits = len(actuator.circuits)
    swept = current_points(swept_currents(actuator.sweep), circuits)
    ends = check_currents(swept) if saturates else swept
    if currents is None or not saturates:
        return meet_tolerance(level, group, swept, ends, settings)
    wanted = np.unique([*current_points(currents, circuits), swept[weakest(swept)]], axis=0)
    return meet_tolerance(level, group, wanted, wanted, settings, np.unique([*wanted, *ends], axis=0))
