r"""All currents of an actuator with saturating parts at a distance.

**Start of the iteration.** Along the currents a state changes much, along the distances little, so states at the
group's reference distance are solved once, and a point starts from w(d, i_k) = w(d_ref, i_k) + w(d, i_k-1) -
w(d_ref, i_k-1), wrong only in the mixed second difference. The higher polynomial order starts in the same way from the
lower one. Nothing depends on which distances were solved before, so that a resumed sweep gives the same digits.

**Force.** In a converged state H = nu_0 B - M holds at every point of the mesh with the magnetisation M = B / mu_0 - H
(permanent, induced or both), so the discrete field is exactly u + v: u of the moving part's M, frozen, in free space, v
of everything else. The stress of u integrates to zero on every surface round the moving part, whatever M is; what it
integrates to on the mesh is error, and is subtracted. It needs no linear material and no permanent magnet.

References
----------
F. Henrotte, G. Deliege and K. Hameyer, COMPEL 23 (2004) 496: the stress weighted over a layer.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from ngsolve import ConvertOperator

from femfit.core.arrays import FloatArray
from femfit.core.errors import FieldSolverError
from femfit.device.parts import Actuator
from femfit.field.force import AROUND_FIXED, LayerForce, weight
from femfit.field.layout import Layout
from femfit.field.material_points import csr
from femfit.field.moving_mesh import MovingMesh, PointField
from femfit.field.newton import TOLERANCE, NewtonResult, inner, minimise
from femfit.field.nonlinear_system import RESPONSE_LIMIT, NonlinearSystem
from femfit.field.point_rows import NonlinearPoint, PointSolution, table_rows
from femfit.field.settings import SolverSettings
from femfit.field.weak_form import flux_density


class NonlinearActuator:
    """One mesh of an actuator with saturating parts, to be stretched over a group of ascending distances in m."""

    def __init__(self, actuator: Actuator, group: tuple[float, ...], layout: Layout, settings: SolverSettings) -> None:
        self.layout = layout
        self._hall = actuator.hall
        self._currents = actuator.sweep.currents_A
        self._moving = MovingMesh(actuator, group, layout, settings)
        self.mesh = self._moving.mesh
        self.coarse = NonlinearSystem(self.mesh, actuator, layout, settings.order - 1)
        self.fine = NonlinearSystem(self.mesh, actuator, layout, settings.order)
        self._raise_order = csr(ConvertOperator(self.coarse.space, self.fine.space), self.coarse.space.ndof)
        g = weight(self.mesh)
        self._fine_layer, self._coarse_layer = (LayerForce(system.space, g) for system in (self.fine, self.coarse))
        self._references = self._reference_states() if len(group) > 1 else {}

    @property
    def unknowns(self) -> int:
        """Number of unknowns of the finer of the two orders."""
        return int(self.fine.space.ndof)

    def rows(self, distance: float, currents: tuple[float, ...]) -> dict[str, list[Any]]:
        """Columns of the sweep table, one value a current; one without convergence has its ``status`` and no field."""
        return table_rows(self.solve(distance, currents), currents)

    def solve(self, distance: float, currents: tuple[float, ...]) -> list[NonlinearPoint]:
        """Solve all currents at a distance."""
        with self._moving.at(distance):
            self.coarse.move()
            self.fine.move()
            coarse = _along_currents(self.coarse, currents, self._references)
            bases = {i: self._raise_order @ result.state for i, result in coarse.items() if result.converged}
            fine = _along_currents(self.fine, tuple(i for i in currents if i in bases), bases)
            evaluate = self._evaluation()
            start, points = np.zeros(self.fine.space.ndof), []
            for i in currents:
                last = fine.get(i, coarse[i])
                status, solution = _status(last), None
                if i in fine and last.converged:
                    response, found = self.fine.response(last.state, start)
                    if found:
                        start, solution = response, evaluate(i, last.state, coarse[i].state, response)
                    else:
                        status = _NO_INDUCTANCE
                iterations = last.iterations + (coarse[i].iterations if i in fine else 0)
                points.append(NonlinearPoint(iterations, last.residual, status, solution))
        return points

    def field(self, distance: float, current: float) -> PointField:
        """The field at a point, with the mesh left stretched to it."""
        (point,) = self.solve(distance, (current,))
        if point.solution is None:
            raise FieldSolverError(f"No field at {1e3 * distance:g} mm and {current:g} A: {point.status}.")
        self._moving.move_to(distance)
        solution = point.solution
        return PointField(self.fine.function(solution.state), solution.force, solution.self_force)

    def _reference_states(self) -> dict[float, FloatArray]:
        self.coarse.move()
        results = _along_currents(self.coarse, self._currents, {})
        return {i: result.state for i, result in results.items() if result.converged}

    def _evaluation(self) -> Callable[[float, FloatArray, FloatArray, FloatArray], PointSolution]:
        """The evaluation of states at the distance that the mesh is stretched to."""
        weights = self._moving.reaction_weight, self._moving.work_weight
        reaction, work = (LayerForce(self.fine.space, g, AROUND_FIXED) for g in weights)
        place = None if self._hall is None else self.mesh(self._hall.radius_m, self._hall.height_m)

        def evaluate(current: float, fine: FloatArray, coarse: FloatArray, response: FloatArray) -> PointSolution:
            total, own = self.fine.function(fine), self.fine.function(self.fine.own_state(fine))
            others = self.fine.function(fine - own.vec.FV().NumPy())
            lower, lower_own = self.coarse.function(coarse), self.coarse.function(self.coarse.own_state(coarse))
            layer, lower_layer = self._fine_layer, self._coarse_layer
            self_force = layer.between(own, own)
            return PointSolution(
                force=layer.between(total, total) - self_force,
                reaction=2.0 * reaction.between(own, others),
                work=2.0 * work.between(own, others),
                coarse_force=lower_layer.between(lower, lower) - lower_layer.between(lower_own, lower_own),
                self_force=self_force,
                flux_linkage=inner(self.fine.coil, fine),
                inductance=self.fine.inductance(fine, response),
                coenergy=-self.fine.evaluate(fine, current).energy,
                hall=None if place is None else float(flux_density(total)[1](place)),
                beyond_curve=self.fine.points.beyond_curve(self.fine.points.flux_density(fine)),
                state=fine,
            )

        return evaluate


def _along_currents(
    system: NonlinearSystem, currents: tuple[float, ...], bases: dict[float, FloatArray]
) -> dict[float, NewtonResult]:
    """Solve from the weakest current outwards, each state predicted from its neighbour and from the bases."""
    results: dict[float, NewtonResult] = {}
    states: dict[float, FloatArray] = {}
    for current, before in _outwards(currents):
        start = _predicted(current, [i for i in before if i in states], states, bases)
        results[current] = minimise(system, current, np.zeros(system.space.ndof) if start is None else start)
        if results[current].converged:
            states[current] = results[current].state
    return results


def _predicted(
    current: float, before: list[float], states: dict[float, FloatArray], bases: dict[float, FloatArray]
) -> FloatArray | None:
    """The start at a current from the states before it, the last one first: with bases, or else on a straight line."""
    if current in bases:
        known = [i for i in before if i in bases]
        return bases[current] + states[known[0]] - bases[known[0]] if known else bases[current]
    if len(before) < 2:
        return states[before[0]] if before else None
    share = (current - before[0]) / (before[0] - before[1])
    return states[before[0]] + share * (states[before[0]] - states[before[1]])


def _outwards(currents: tuple[float, ...]) -> list[tuple[float, list[float]]]:
    """Each current from the weakest outwards, with those between it and the weakest, the nearest first."""
    if not currents:
        return []
    middle = int(np.argmin(np.abs(currents)))
    up = [(i, list(currents[middle:k][::-1])) for k, i in enumerate(currents) if k > middle]
    down = [(i, list(currents[k + 1 : middle + 1])) for k, i in enumerate(currents) if k < middle]
    return [(currents[middle], []), *up, *down[::-1]]


_NO_INDUCTANCE = (
    f"failed: the inductance did not converge in {RESPONSE_LIMIT} iterations. Check the B-H curve for kinks, or sweep "
    "the current in smaller steps"
)


def _status(result: NewtonResult) -> str:
    if result.converged:
        return "ok"
    return (
        f"failed: Newton's iteration left a residual of {result.residual:.1e} after {result.iterations} iterations; "
        f"{TOLERANCE:.0e} is needed. Check the B-H curve for kinks, or sweep the current in smaller steps"
    )
