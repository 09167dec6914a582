r"""The field problem of an actuator: all points of the currents at a distance, on one mesh of several distances.

**Linear materials.** The field is a sum over the sources s = (1, i_1 .. i_n) of the magnets' and of each circuit's with
1 A, so one factorisation a distance gives all: the force is a quadratic form in s, flux linkages and the Hall field are
linear in it, and the co-energy is a quadratic form again. The stress of the moving part's own field integrates to zero,
but not on a mesh: it is evaluated on the same mesh with everything else taken away, and subtracted
(:mod:`femfit.field.source_fields`).

**Saturating parts.** Along the currents a state changes much, along the distances little, so states at the group's
reference distance are solved once at a low polynomial order, and a point starts from them
(:mod:`femfit.field.newton`). Each higher order starts in the same way from the one below. Nothing depends on
which distances were solved before, so that a resumed sweep gives the same digits.

In a converged state H = nu_0 B - M holds at every point of the mesh with the magnetisation M = B / mu_0 - H
(permanent, induced or both), so the discrete field is exactly u + v: u of the moving part's M, frozen, and of its
coils' currents in free space, v of everything else. The stress of u integrates to zero on every surface round the
moving part, whatever M is; what it integrates to on the mesh is error, and is subtracted. It needs no linear material
and no permanent magnet.

References
----------
F. Henrotte, G. Deliege and K. Hameyer, COMPEL 23 (2004) 496: the stress weighted over a layer.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import ngsolve as ng
import numpy as np
from ngsolve import GridFunction

from femfit.core.errors import FieldSolverError
from femfit.core.numerics import FloatArray
from femfit.core.sweep_columns import flux_columns, inductance_columns
from femfit.device.drawn_numbers import DrawnNumber
from femfit.device.parts import Actuator
from femfit.field.layout import Layout
from femfit.field.moving_mesh import MovingMesh
from femfit.field.newton import NewtonResult, States, along_currents
from femfit.field.nonlinear_system import FIRST_ORDER, at_orders
from femfit.field.pickup_coils import pickups_at
from femfit.field.point_rows import (
    BEYOND_CURVE,
    COARSE_FORCE,
    NO_CONVERGENCE,
    NOT_FINITE,
    Coefficients,
    CurrentsLike,
    current_points,
    superpose,
    swept_currents,
    table_rows,
    weakest,
)
from femfit.field.signature_rows import SignatureRows
from femfit.field.source_fields import SourceFields
from femfit.field.tolerance import (
    LevelChoice,
    Rows,
    SolverSettings,
    check_currents,
    meet_tolerance,
    refinement_levels,
    with_errors,
)
from femfit.field.weak_form import function_of, hall_fields


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
        self._actuator, self._group, self.settings, self._estimate = actuator, group, settings, estimate
        # Where this is the level that meets a tolerance: its search's outcome, and rows that it has found at points
        self.choice: LevelChoice | None = None
        self.found: tuple[FloatArray, Rows] = np.zeros((0, 0)), {}
        self._circuits = tuple(circuit.name for circuit in actuator.circuits)
        self._moving = MovingMesh(actuator, group, layout, settings)
        self.mesh = self._moving.mesh
        self._signatures: SignatureRows | None = None
        self.unknowns = self._discretise()

    @abstractmethod
    def _discretise(self) -> int:
        """Make the systems on the mesh at its reference; the number of unknowns of the finest one."""

    def _slide(self, distance: float) -> None:
        """Take a distance as the mesh's reference where a body slides."""
        if self._moving.slides and distance != self._moving.reference:
            self._moving.slide_to(distance)
            self._signatures = None
            self.unknowns = self._discretise()

    @abstractmethod
    def solved_rows(self, distance: float, points: FloatArray) -> dict[str, list[Any]]:
        """What is solved at a distance for points (n, circuits)."""

    @abstractmethod
    def signatures(self, distance: float, currents: CurrentsLike, numbers: Sequence[DrawnNumber]) -> FloatArray:
        """As :meth:`femfit.field.signature_rows.SignatureRows.of_states`; NaN where a point has no solution."""

    @abstractmethod
    def field(self, distance: float, currents: CurrentsLike) -> tuple[GridFunction, float]:
        """The field w, on the mesh at its reference, and the force in N at a point."""

    def rows(self, distance: float, currents: CurrentsLike) -> dict[str, list[Any]]:
        """Columns of the sweep table at a distance, one value a point of the currents."""
        points, (solved, rows) = current_points(currents, len(self._circuits)), self.found
        reusable = distance in rows and np.array_equal(points, solved)
        columns = rows[distance] if reusable else self.solved_rows(distance, points)
        return columns if self.choice is None else with_errors(columns, points, self.choice)

    def _slopes(self, numbers: Sequence[DrawnNumber], space: ng.H1, loads: FloatArray) -> SignatureRows:
        """The signatures of numbers, made when they are first asked for."""
        if self._signatures is None:
            self._signatures = SignatureRows(self._actuator, numbers, self._moving, space, loads)
        return self._signatures


class LinearActuator(MeshedActuator):
    """An actuator with linear materials, of which a distance is solved for all currents at once."""

    def _discretise(self) -> int:
        order = self.settings.order
        self._system = SourceFields(self._moving, self._actuator, order)
        self._lower = SourceFields(self._moving, self._actuator, order - 1) if self._estimate else None
        self._solved: float | None = None  # distance that the fields are of
        return int(self._system.space.ndof)

    def solve(self, distance: float) -> Coefficients:
        """Solve at a distance."""
        self._slide(distance)
        with self._moving.at(distance):
            fine = self._system.evaluate()
            totals = [function_of(self._system.space, total) for total in self._system.total]
            linked = [*map(pickups_at(self._actuator, self._moving, distance), totals)]
            lower = None if self._lower is None else self._lower.evaluate()
        self._solved = distance
        change = None if lower is None else fine.force - lower.force
        pickup = {name: np.array([links[name] for links in linked]) for name in linked[0]}
        return replace(fine, force_change=change, pickup=pickup)

    def solved_rows(self, distance: float, points: FloatArray) -> dict[str, list[Any]]:
        """What is solved at a distance for points (n, circuits)."""
        solution = self.solve(distance)
        if not np.all(np.isfinite(solution.force)):
            raise FieldSolverError(NOT_FINITE)
        columns = superpose(points, solution, self._circuits)
        return {name: values.tolist() for name, values in columns.items()}

    def signatures(self, distance: float, currents: CurrentsLike, numbers: Sequence[DrawnNumber]) -> FloatArray:
        """Of any points, from the fields of the sources."""
        if self._solved != distance:
            self.solve(distance)
        system, points = self._system, current_points(currents, len(self._circuits))
        slopes = self._slopes(numbers, system.space, system.loads[1:])
        return slopes.of_sources(distance, points, system.total, system.respond)

    def field(self, distance: float, currents: CurrentsLike) -> tuple[GridFunction, float]:
        """The sum of the sources' fields."""
        solution = self.solve(distance)
        factors = np.insert(current_points(currents, len(self._circuits))[0], 0, 1.0)
        return function_of(self._system.space, factors @ self._system.total), float(factors @ solution.force @ factors)


class NonlinearActuator(MeshedActuator):
    """An actuator with saturating parts, solved point by point."""

    _references: States | None = None  # Of the lowest order, where the mesh was made

    def _discretise(self) -> int:
        self._tolerance, below = self.settings.newton_tolerance, self.settings.order - 1
        orders = min(FIRST_ORDER, below), self.settings.order, *([below] if self._estimate else [])
        self._systems, self._raise_order = at_orders(self._moving, self._actuator, *orders)
        self.fine, self._lower = self._systems[-1], self._systems[-2] if self._estimate else None
        # The distance last solved, and states and columns of its points
        self._solved: tuple[float, States, dict[tuple[float, ...], dict[str, Any]]] = np.nan, {}, {}
        if self._references is None and len(self._group) > 1:
            self._systems[0].move()
            swept = current_points(swept_currents(self._actuator.sweep), len(self._circuits))
            self._references = _states(dict(along_currents(self._systems[0], swept, {}, self._tolerance)))
        return int(self.fine.space.ndof)

    def solved_rows(self, distance: float, points: FloatArray) -> dict[str, list[Any]]:
        """The same; a point without convergence has its ``status`` and no field."""
        self._slide(distance)
        with self._moving.at(distance):
            results, bases, pending = [], self._references or {}, points
            for system, higher in zip(self._systems[:-1], self._raise_order, strict=True):
                system.move()
                results.append(dict(along_currents(system, pending, bases, self._tolerance)))
                bases = {key: higher @ state for key, state in _states(results[-1]).items()}
                pending = np.array([point for point in points if tuple(point) in bases])
            self.fine.move()
            coarse, linked, solutions = _states(results[-1]), pickups_at(self._actuator, self._moving, distance), {}
            results.append({})
            for key, result in along_currents(self.fine, pending, bases, self._tolerance):
                results[-1][key] = result
                if result.converged:
                    solutions[key] = self._columns(np.array(key), result.state, coarse[key])
                    solutions[key] |= linked(function_of(self.fine.space, result.state))
        self._solved, rows = (distance, _states(results[-1]), solutions), []
        for key in map(tuple, points):  # from the lowest order to the one at which a point ended
            ended = [of_order[key] for of_order in results if key in of_order]
            iterations = sum(order.iterations for order in ended)
            newton = {"newton_iterations": iterations, "newton_residual": ended[-1].residual}
            rows.append(newton | solutions.get(key, {"status": ended[-1].failure}))
        return table_rows(rows, points)

    def signatures(self, distance: float, currents: CurrentsLike, numbers: Sequence[DrawnNumber]) -> FloatArray:
        """From the state of each point."""
        points = current_points(currents, len(self._circuits))
        states, slopes = self._states_at(distance, points), self._slopes(numbers, self.fine.space, self.fine.circuits)
        solved = np.array([tuple(point) in states for point in points])
        fields = np.array([states[tuple(point)] for point in points[solved]]).reshape(-1, self.unknowns)
        rows = slopes.of_states(distance, points[solved], fields, self.fine.respond)
        result = np.full((len(points), *rows.shape[1:]), np.nan)
        result[solved] = rows
        return result

    def field(self, distance: float, currents: CurrentsLike) -> tuple[GridFunction, float]:
        """The state of the point."""
        point = current_points(currents, len(self._circuits))[0]
        state = self._states_at(distance, point[None]).get(tuple(point))
        if state is None:
            amperes = ", ".join(f"{i:g}" for i in point)
            raise FieldSolverError(f"No field at {1e3 * distance:g} mm and {amperes} A: {NO_CONVERGENCE}.")
        return function_of(self.fine.space, state), self._solved[2][tuple(point)]["force_N"]

    def _states_at(self, distance: float, points: FloatArray) -> States:
        """The states at a distance, with those of points (n, circuits) where their iteration converged."""
        if self._solved[0] != distance or not all(tuple(point) in self._solved[1] for point in points):
            self.solved_rows(distance, points)
        return self._solved[1]

    def _columns(self, currents: FloatArray, fine: FloatArray, coarse: FloatArray) -> dict[str, Any]:
        """What a state is, and one of the order below, at the distance that the mesh is stretched to."""
        hall, inductance = self._actuator.hall, self.fine.inductance(fine)
        columns: dict[str, Any] = {
            "status": "ok",
            "force_N": self.fine.force(fine, currents),
            **dict(zip(flux_columns(self._circuits), self.fine.flux_linkage(fine).tolist(), strict=True)),
            **{name: float(inductance[place]) for name, place in inductance_columns(self._circuits).items()},
            "coenergy_J": -self.fine.evaluate(fine, currents).energy,
            BEYOND_CURVE: self.fine.points.beyond_curve(self.fine.points.flux_density(fine)),
        }
        if self._lower is not None:
            columns[COARSE_FORCE] = self._lower.force(coarse, currents)
        if hall is not None:
            columns["hall_T"] = float(hall_fields(hall, self.fine.space, fine[None])[0])
        return columns


def _states(results: Mapping[tuple[float, ...], NewtonResult]) -> States:
    return {key: result.state for key, result in results.items() if result.converged}


def prepare(
    actuator: Actuator,
    group: tuple[float, ...],
    layout: Layout,
    settings: SolverSettings,
    choice: LevelChoice | None = None,
    currents: CurrentsLike | None = None,
) -> MeshedActuator:
    """Mesh an actuator for a group of ascending distances in m that share the mesh.

    Parameters
    ----------
    currents : array
        Those that alone are wanted, and at which the tolerance is met; all that are swept where None. Materials that do
        not saturate are solved for all of them at once.
    """
    kind = NonlinearActuator if actuator.saturates else LinearActuator
    if settings.tolerance is None:
        return kind(actuator, group, layout, settings)
    level = partial(kind, actuator, group, layout, estimate=False)
    if choice is not None:
        problem = level(refinement_levels(settings)[choice.level])
        problem.choice = choice
        return problem
    circuits = len(actuator.circuits)
    swept = current_points(swept_currents(actuator.sweep), circuits)
    ends = check_currents(swept) if actuator.saturates else swept
    if currents is None or not actuator.saturates:
        return meet_tolerance(level, group, swept, ends, settings)
    wanted = np.unique([*current_points(currents, circuits), swept[weakest(swept)]], axis=0)
    return meet_tolerance(level, group, wanted, wanted, settings, np.unique([*wanted, *ends], axis=0))
