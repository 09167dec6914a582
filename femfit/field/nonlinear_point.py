r"""All points of the currents of an actuator with saturating parts, at a distance.

**Start of the iteration.** Along the currents a state changes much, along the distances little, so states at the
group's reference distance are solved once at a low polynomial order, and a point starts from them
(:mod:`femfit.field.newton`). Each higher order starts in the same way from the one below. Nothing depends on
which distances were solved before, so that a resumed sweep gives the same digits.

**Force.** In a converged state H = nu_0 B - M holds at every point of the mesh with the magnetisation M = B / mu_0 - H
(permanent, induced or both), so the discrete field is exactly u + v: u of the moving part's M, frozen, and of its
coils' currents in free space, v of everything else. The stress of u integrates to zero on every surface round the
moving part, whatever M is; what it integrates to on the mesh is error, and is subtracted. It needs no linear material
and no permanent magnet.

References
----------
F. Henrotte, G. Deliege and K. Hameyer, COMPEL 23 (2004) 496: the stress weighted over a layer.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from ngsolve import GridFunction

from femfit.core.errors import FieldSolverError
from femfit.core.numerics import FloatArray
from femfit.core.sweep_columns import flux_columns, inductance_columns, pickup_column
from femfit.device.drawn_numbers import DrawnNumber
from femfit.field.newton import NewtonResult, States, along_currents
from femfit.field.nonlinear_system import FIRST_ORDER, NonlinearSystem, at_orders
from femfit.field.point_rows import (
    BEYOND_CURVE,
    NO_CONVERGENCE,
    CurrentsLike,
    PointSolution,
    current_points,
    swept_currents,
    table_rows,
)
from femfit.field.problem import MeshedActuator
from femfit.field.tolerance import SolverSettings
from femfit.field.weak_form import LayerForce, function_of, hall_field


class NonlinearActuator(MeshedActuator):
    """An actuator with saturating parts, solved point by point."""

    def _discretise(self, settings: SolverSettings, *, estimate: bool) -> int:
        self._tolerance = settings.newton_tolerance
        below = settings.order - 1
        orders = min(FIRST_ORDER, below), settings.order, *([below] if estimate else [])
        self._systems, self._raise_order = at_orders(self._moving, self._actuator, *orders)
        self.coarse, self.fine = self._systems[-2:]
        g = self._moving.mover_weight
        self._layer = LayerForce(self.fine.space, g)
        self._coarse_layer = LayerForce(self.coarse.space, g) if estimate else None
        self._solved: dict[float, dict[tuple[float, ...], PointSolution]] = {}  # of the distance last solved
        self._references: States = {}
        if len(self._group) > 1:
            self._systems[0].move()
            swept = current_points(swept_currents(self._actuator.sweep), len(self._circuits))
            self._references = _states(dict(along_currents(self._systems[0], swept, {}, self._tolerance)))
        return int(self.fine.space.ndof)

    def rows(self, distance: float, currents: CurrentsLike) -> dict[str, list[Any]]:
        """Columns of the sweep table, one value a point; one without convergence has its ``status`` and no field."""
        points = current_points(currents, len(self._circuits))
        with self._moving.at(distance):
            results, bases, pending = [], self._references, points
            for system, higher in zip(self._systems[:-1], self._raise_order, strict=True):
                system.move()
                results.append(dict(along_currents(system, pending, bases, self._tolerance)))
                bases = {key: higher @ state for key, state in _states(results[-1]).items()}
                pending = np.array([point for point in points if tuple(point) in bases])
            self.fine.move()
            coarse, evaluate = _states(results[-1]), self._evaluation(distance)
            finest, solutions = {}, {}
            for key, result in along_currents(self.fine, pending, bases, self._tolerance):
                finest[key] = result
                if result.converged:
                    solutions[key] = evaluate(np.array(key), result.state, coarse[key])
        self._solved, unsolved = {distance: solutions}, PointSolution({"status": NO_CONVERGENCE}, np.nan, np.empty(0))
        rows, coarse_forces = [], []
        for key in map(tuple, points):  # from the lowest order to the one at which a point ended
            ended = [of_order[key] for of_order in (*results, finest) if key in of_order]
            iterations, solution = sum(order.iterations for order in ended), solutions.get(key, unsolved)
            newton = {"newton_iterations": iterations, "newton_residual": ended[-1].residual}
            rows.append(newton | solution.columns)
            coarse_forces.append(solution.coarse_force)
        return table_rows(rows, np.array(coarse_forces), points)

    def signatures(self, distance: float, currents: CurrentsLike, numbers: Sequence[DrawnNumber]) -> FloatArray:
        """As :meth:`femfit.field.signature_rows.SignatureRows.of_states`; NaN where a point has no solution."""
        points = current_points(currents, len(self._circuits))
        results, slopes = self._solutions(distance, points), self._slopes(numbers, self.fine.space, self.fine.circuits)
        solved = np.array([tuple(point) in results for point in points])
        states = np.array([results[tuple(point)].state for point in points[solved]]).reshape(-1, self.unknowns)
        rows = slopes.of_states(distance, points[solved], states, self.fine.respond)
        result = np.full((len(points), *rows.shape[1:]), np.nan)
        result[solved] = rows
        return result

    def field(self, distance: float, currents: CurrentsLike) -> tuple[GridFunction, float]:
        """The field w and the force in N at a point, with the mesh left stretched to it."""
        points = current_points(currents, len(self._circuits))
        solution = self._solutions(distance, points).get(tuple(points[0]))
        if solution is None:
            amperes = ", ".join(f"{i:g}" for i in points[0])
            raise FieldSolverError(f"No field at {1e3 * distance:g} mm and {amperes} A: {NO_CONVERGENCE}.")
        self._moving.move_to(distance)
        return function_of(self.fine.space, solution.state), solution.columns["force_N"]

    def _solutions(self, distance: float, points: FloatArray) -> Mapping[tuple[float, ...], PointSolution]:
        """The solutions at a distance, with those of points (n, circuits) where their iteration converged."""
        if not all(tuple(point) in self._solved.get(distance, {}) for point in points):
            self.rows(distance, points)
        return self._solved[distance]

    def _evaluation(self, distance: float) -> Callable[[FloatArray, FloatArray, FloatArray], PointSolution]:
        """The evaluation of states at the distance that the mesh is stretched to."""
        linked, hall = self._pickups.at(distance), self._actuator.hall

        def force(system: NonlinearSystem, layer: LayerForce, state: FloatArray, currents: FloatArray) -> float:
            alone = function_of(system.space, system.own_state(state, currents))
            total = function_of(system.space, state)
            return float(layer.of_sum([total]).item() - layer.of_sum([alone]).item())

        def evaluate(currents: FloatArray, fine: FloatArray, coarse: FloatArray) -> PointSolution:
            total, coarse_force = function_of(self.fine.space, fine), np.nan
            if self._coarse_layer is not None:  # the force of a state one order lower is asked for
                coarse_force = force(self.coarse, self._coarse_layer, coarse, currents)
            inductance = self.fine.inductance(fine)
            columns = {
                "status": "ok",
                "force_N": force(self.fine, self._layer, fine, currents),
                **dict(zip(flux_columns(self._circuits), self.fine.flux_linkage(fine).tolist(), strict=True)),
                **{name: float(inductance[place]) for name, place in inductance_columns(self._circuits).items()},
                "coenergy_J": -self.fine.evaluate(fine, currents).energy,
                BEYOND_CURVE: self.fine.points.beyond_curve(self.fine.points.flux_density(fine)),
                **{pickup_column(name): flux_linkage for name, flux_linkage in linked(total).items()},
            }
            if hall is not None:
                columns["hall_T"] = hall_field(hall, self.mesh, total)
            return PointSolution(columns, coarse_force, fine)

        return evaluate


def _states(results: Mapping[tuple[float, ...], NewtonResult]) -> States:
    return {key: result.state for key, result in results.items() if result.converged}
