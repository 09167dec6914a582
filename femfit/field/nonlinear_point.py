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

from collections.abc import Mapping, Sequence
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
    COARSE_FORCE,
    NO_CONVERGENCE,
    CurrentsLike,
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
        self._tolerance, below = settings.newton_tolerance, settings.order - 1
        orders = min(FIRST_ORDER, below), settings.order, *([below] if estimate else [])
        self._systems, self._raise_order = at_orders(self._moving, self._actuator, *orders)
        self.fine = self._systems[-1]
        # Of the orders whose force is asked for, the finest first
        judged = self._systems[: -3 if estimate else -2 : -1]
        self._layers = [(system, LayerForce(system.space, self._moving.mover_weight)) for system in judged]
        # The distance last solved, and states and columns of its points
        self._solved: tuple[float, States, dict[tuple[float, ...], dict[str, Any]]] = np.nan, {}, {}
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
            coarse, linked, solutions = _states(results[-1]), self._pickups.at(distance), {}
            results.append({})
            for key, result in along_currents(self.fine, pending, bases, self._tolerance):
                results[-1][key] = result
                if result.converged:
                    total = function_of(self.fine.space, result.state)
                    solutions[key] = self._columns(np.array(key), result.state, coarse[key])
                    solutions[key] |= {pickup_column(name): flux for name, flux in linked(total).items()}
        self._solved, rows = (distance, _states(results[-1]), solutions), []
        for key in map(tuple, points):  # from the lowest order to the one at which a point ended
            ended = [of_order[key] for of_order in results if key in of_order]
            newton = {"newton_iterations": sum(order.iterations for order in ended)}
            newton |= {"newton_residual": ended[-1].residual}
            rows.append(newton | solutions.get(key, {"status": NO_CONVERGENCE}))
        return table_rows(rows, points)

    def signatures(self, distance: float, currents: CurrentsLike, numbers: Sequence[DrawnNumber]) -> FloatArray:
        """As :meth:`femfit.field.signature_rows.SignatureRows.of_states`; NaN where a point has no solution."""
        points = current_points(currents, len(self._circuits))
        states, slopes = self._states(distance, points), self._slopes(numbers, self.fine.space, self.fine.circuits)
        solved = np.array([tuple(point) in states for point in points])
        found = np.array([states[tuple(point)] for point in points[solved]]).reshape(-1, self.unknowns)
        rows = slopes.of_states(distance, points[solved], found, self.fine.respond)
        result = np.full((len(points), *rows.shape[1:]), np.nan)
        result[solved] = rows
        return result

    def field(self, distance: float, currents: CurrentsLike) -> tuple[GridFunction, float]:
        """The field w and the force in N at a point, with the mesh left stretched to it."""
        point = current_points(currents, len(self._circuits))[0]
        state = self._states(distance, point[None]).get(tuple(point))
        if state is None:
            amperes = ", ".join(f"{i:g}" for i in point)
            raise FieldSolverError(f"No field at {1e3 * distance:g} mm and {amperes} A: {NO_CONVERGENCE}.")
        self._moving.move_to(distance)
        return function_of(self.fine.space, state), self._solved[2][tuple(point)]["force_N"]

    def _states(self, distance: float, points: FloatArray) -> States:
        """The states at a distance, with those of points (n, circuits) where their iteration converged."""
        if self._solved[0] != distance or not all(tuple(point) in self._solved[1] for point in points):
            self.rows(distance, points)
        return self._solved[1]

    def _columns(self, currents: FloatArray, fine: FloatArray, coarse: FloatArray) -> dict[str, Any]:
        """What a state is, and one of the order below, at the distance that the mesh is stretched to."""
        hall, inductance = self._actuator.hall, self.fine.inductance(fine)
        columns = {
            "status": "ok",
            "force_N": self._force(*self._layers[0], fine, currents),
            **dict(zip(flux_columns(self._circuits), self.fine.flux_linkage(fine).tolist(), strict=True)),
            **{name: float(inductance[place]) for name, place in inductance_columns(self._circuits).items()},
            "coenergy_J": -self.fine.evaluate(fine, currents).energy,
            BEYOND_CURVE: self.fine.points.beyond_curve(self.fine.points.flux_density(fine)),
        }
        if len(self._layers) > 1:
            columns[COARSE_FORCE] = self._force(*self._layers[1], coarse, currents)
        if hall is not None:
            columns["hall_T"] = hall_field(hall, self.mesh, function_of(self.fine.space, fine))
        return columns

    def _force(self, system: NonlinearSystem, layer: LayerForce, state: FloatArray, currents: FloatArray) -> float:
        """The force of a state in N, without what the moving part's own field has of it on the mesh."""
        total, alone = (function_of(system.space, w) for w in (state, system.own_state(state, currents)))
        return float(layer.of_sum([total]).item() - layer.of_sum([alone]).item())


def _states(results: Mapping[tuple[float, ...], NewtonResult]) -> States:
    return {key: result.state for key, result in results.items() if result.converged}
