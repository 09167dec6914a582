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
from itertools import pairwise
from typing import Any

import numpy as np
from ngsolve import ConvertOperator, GridFunction

from femfit.core.errors import FieldSolverError
from femfit.core.numerics import FloatArray
from femfit.device.drawn_numbers import DrawnNumber
from femfit.device.parts import Actuator
from femfit.field.layout import Layout
from femfit.field.material_points import csr
from femfit.field.moving_mesh import MovingMesh
from femfit.field.newton import NewtonResult, States, along_currents
from femfit.field.nonlinear_system import NonlinearSystem
from femfit.field.point_rows import (
    NO_CONVERGENCE,
    CurrentsLike,
    NonlinearPoint,
    PointSolution,
    current_points,
    swept_currents,
    table_rows,
)
from femfit.field.problem import PickupCoils
from femfit.field.signature_rows import SignatureRows
from femfit.field.tolerance import SolverSettings
from femfit.field.weak_form import LayerForce, hall_field

FIRST_ORDER = 2
"""Polynomial order at which the way along the currents is found: a tenth of what an iteration costs at order 5."""


class NonlinearActuator:
    """One mesh of an actuator with saturating parts, to be stretched over a group of distances.

    The group's distances are in m, ascending; with ``estimate`` each point is also solved one order lower, for the
    force's error.
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
        self.actuator, self.layout = actuator, layout
        self._tolerance = settings.newton_tolerance
        self._hall = actuator.hall
        self._circuits = tuple(circuit.name for circuit in actuator.circuits)
        self._moving = MovingMesh(actuator, group, layout, settings)
        self.mesh = self._moving.mesh
        self._pickups = PickupCoils(actuator, self._moving)
        below = settings.order - 1
        orders = sorted({min(FIRST_ORDER, below), below} if estimate else {min(FIRST_ORDER, below)})
        self._systems = [NonlinearSystem(self._moving, actuator, order) for order in (*orders, settings.order)]
        self.coarse, self.fine = self._systems[-2:]
        self.unknowns = int(self.fine.space.ndof)  # of the finer of the two orders
        self._raise_order = [
            csr(ConvertOperator(low.space, high.space), low.space.ndof) for low, high in pairwise(self._systems)
        ]
        g = self._moving.mover_weight
        self._layer = LayerForce(self.fine.space, g)
        self._coarse_layer = LayerForce(self.coarse.space, g) if estimate else None
        self._total, self._own = GridFunction(self.fine.space), GridFunction(self.fine.space)
        self._signatures: SignatureRows | None = None
        self._solved: dict[float, dict[tuple[float, ...], PointSolution]] = {}  # of the distance last solved
        self._references: States = {}
        if len(group) > 1:
            self._systems[0].move()
            swept = current_points(swept_currents(actuator.sweep), len(self._circuits))
            self._references = _states(dict(along_currents(self._systems[0], swept, {}, self._tolerance)))

    def rows(self, distance: float, currents: CurrentsLike) -> dict[str, list[Any]]:
        """Columns of the sweep table, one value a point; one without convergence has its ``status`` and no field."""
        points = current_points(currents, len(self._circuits))
        return table_rows(self.solve(distance, points), points, self._circuits)

    def solve(self, distance: float, currents: CurrentsLike) -> list[NonlinearPoint]:
        """Solve all points of the currents at a distance."""
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
        self._solved = {distance: solutions}
        solved = []
        for key in map(tuple, points):  # from the lowest order to the one at which a point ended
            ended = [of_order[key] for of_order in (*results, finest) if key in of_order]
            iterations, status = sum(order.iterations for order in ended), "ok" if key in solutions else NO_CONVERGENCE
            solved.append(NonlinearPoint(iterations, ended[-1].residual, status, solutions.get(key)))
        return solved

    def signatures(self, distance: float, currents: CurrentsLike, numbers: Sequence[DrawnNumber]) -> FloatArray:
        """As :meth:`femfit.field.signature_rows.SignatureRows.of_states`; NaN where a point has no solution."""
        points = current_points(currents, len(self._circuits))
        results = self._solved.get(distance, {})
        if not all(tuple(point) in results for point in points):
            self.solve(distance, points)
            results = self._solved[distance]
        if self._signatures is None:
            self._signatures = SignatureRows(self.actuator, numbers, self._moving, self.fine.space, self.fine.circuits)
        solved = np.array([tuple(point) in results for point in points])
        states = np.array([results[tuple(point)].state for point in points[solved]]).reshape(-1, self.unknowns)
        rows = self._signatures.of_states(distance, points[solved], states, self.fine.respond)
        result = np.full((len(points), *rows.shape[1:]), np.nan)
        result[solved] = rows
        return result

    def field(self, distance: float, currents: CurrentsLike) -> tuple[GridFunction, float]:
        """The field w and the force in N at a point, with the mesh left stretched to it."""
        (point,) = current_points(currents, len(self._circuits))
        solution = self._solved.get(distance, {}).get(tuple(point))
        if solution is None:
            (solved,) = self.solve(distance, currents)
            solution = solved.solution
            if solution is None:
                amperes = ", ".join(f"{i:g}" for i in point)
                raise FieldSolverError(f"No field at {1e3 * distance:g} mm and {amperes} A: {solved.status}.")
        self._moving.move_to(distance)
        return self.fine.function(solution.state), solution.force

    def _evaluation(self, distance: float) -> Callable[[FloatArray, FloatArray, FloatArray], PointSolution]:
        """The evaluation of states at the distance that the mesh is stretched to."""
        linked = self._pickups.at(distance)

        def evaluate(currents: FloatArray, fine: FloatArray, coarse: FloatArray) -> PointSolution:
            total, own = self._total, self._own
            total.vec.FV().NumPy()[:], own.vec.FV().NumPy()[:] = fine, self.fine.own_state(fine, currents)
            coarse_force = None
            if self._coarse_layer is not None:  # the force of a state one order lower is asked for
                vectors = coarse, self.coarse.own_state(coarse, currents)
                of_all, of_mover = (self._coarse_layer.between(w, w) for w in map(self.coarse.function, vectors))
                coarse_force = of_all - of_mover
            return PointSolution(
                force=self._layer.between(total, total) - self._layer.between(own, own),
                coarse_force=coarse_force,
                flux_linkage=self.fine.flux_linkage(fine),
                inductance=self.fine.inductance(fine),
                coenergy=-self.fine.evaluate(fine, currents).energy,
                hall=None if self._hall is None else hall_field(self._hall, self.mesh, total),
                beyond_curve=self.fine.beyond_curve(fine),
                state=fine,
                pickup=linked(total),
            )

        return evaluate


def _states(results: Mapping[tuple[float, ...], NewtonResult]) -> States:
    return {key: result.state for key, result in results.items() if result.converged}
