"""The fields of all sources on one mesh and polynomial order: the magnets, 1 A in each circuit, patterns of currents.

In a solution w, H = nu_0 B - M holds with the moving part's magnetisation M = (nu_0 - nu) B + nu B_rem, so that w is
exactly u + v: u of M, frozen, and of the moving coils' currents in free space, v of everything else (as in
:mod:`femfit.field.problem`). All are linear in the sources (1, i_1 .. i_n). A field is the array of its coefficients.

Where parts saturate, the first source is the static state at a bias, the magnets' and the bias currents' together, and
the others are small currents beside it: their fields dw obey K_d dw = load with the derivative K_d of the state's
equations (the incremental permeability), and each changes the force by the mutual stress of its field with the state's,
F = F_0 + 2 dF. What is of second order in small currents is left out, and zero in the forms.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from ngsolve import H1

from femfit.core.errors import FieldSolverError
from femfit.core.numerics import MU_0, FloatArray
from femfit.device.parts import Actuator
from femfit.field.moving_mesh import MovingMesh
from femfit.field.newton import minimise
from femfit.field.nonlinear_system import FIRST_ORDER, at_orders
from femfit.field.point_rows import Coefficients
from femfit.field.weak_form import FieldArray, hall_fields, inner_products

PatternLoads = Callable[[H1], tuple[FloatArray, FloatArray]]
"""Right-hand sides of patterns of induced currents, and of what of them moves; shape (patterns, unknowns) each."""


class SourceFields:
    """Right-hand sides and fields of all sources on one space.

    ``loads`` and ``own_loads``, of what of them moves, and the fields ``total`` and ``own`` have the shape
    (m, unknowns). Where parts saturate, ``bias`` has the circuits' currents in A about which the fields are small.
    ``points`` are the material's, with the permeability of the state that was last solved.
    """

    def __init__(
        self, moving: MovingMesh, actuator: Actuator, order: int, patterns: PatternLoads | None = None
    ) -> None:
        self.saturates, self._hall = actuator.saturates, actuator.hall
        orders = (FIRST_ORDER, order) if self.saturates else (order,)
        self._levels, self._raise_order = at_orders(moving, actuator, *orders)
        fine = self._levels[-1]
        self.mesh, self.space, self.points, self.layer_force = moving.mesh, fine.space, fine.points, fine.layer
        self.bias = np.zeros(len(actuator.circuits))
        own_magnets = fine.points.load(fine.points.coercive_field * fine.points.moving)
        self.loads = np.concatenate([fine.magnets[None], fine.circuits])
        self.own_loads = np.concatenate([own_magnets[None], fine.own_circuits])
        if patterns is not None:
            induced, induced_moving = patterns(self.space)
            self.loads = np.concatenate([self.loads, induced])
            self.own_loads = np.concatenate([self.own_loads, induced_moving])
        self.total = self.own = np.zeros_like(self.loads)

    def state(self) -> FloatArray:
        """Fields of all sources at rest on the mesh as it is now stretched, shape (m, unknowns); small ones as 0."""
        if self.saturates:
            return np.array([self._state(self.bias), *np.zeros_like(self.loads[1:])])
        self._levels[-1].move()
        return self.respond(self.loads[0], self.loads)

    def _state(self, currents: FloatArray) -> FloatArray:
        """The unknowns of the static state on the mesh as it is now stretched, at currents in A."""
        state = np.zeros(self._levels[0].space.ndof)
        for k, level in enumerate(self._levels):
            level.move()
            result = minimise(level, currents, self._raise_order[k - 1] @ state if k else state)
            if not result.converged:
                amperes = ", ".join(f"{current:g}" for current in currents)
                raise FieldSolverError(
                    f"the state at {amperes} A did not converge: Newton's iteration left a residual of "
                    f"{result.residual:.1e}. Check the B-H curve for kinks, or give another solver.eddy_bias_A"
                )
            state = result.state
        return state

    def respond(self, state: FloatArray, loads: FloatArray) -> FloatArray:
        """What loads (k, unknowns) change of a state on the mesh as it was last solved, in the same shape."""
        return self._levels[-1].respond(state, loads)

    def solve(self) -> None:
        """Renew ``total`` and ``own`` on the mesh as it is now stretched."""
        fine, self.total = self._levels[-1], self.state()
        if self.saturates:
            self.total[1:] = self.respond(self.total[0], self.loads[1:])
        self._tensor = self.points.tensor(self.points.flux_density(self.total[0]))
        self.own = self.own_of(self.total, self.own_loads)
        if self.saturates:
            self.own[0] = fine.own_state(self.total[0], self.bias)

    def own_of(self, fields: FieldArray, loads: FieldArray) -> FieldArray:
        """Fields (k, unknowns) of the moving part alone, of its currents' loads and of what fields magnetise."""
        (rr, rz, zz), magnetised = self._tensor, []
        for field in fields:
            b = self.points.flux_density(field)
            induced = b / MU_0 - np.stack([rr * b[0] + rz * b[1], rz * b[0] + zz * b[1]])
            magnetised.append(self.points.load(induced * self.points.moving))
        return self._levels[-1].solve_free(np.array(magnetised).reshape(loads.shape) + loads)

    def evaluate(self) -> Coefficients:
        """Solve on the mesh as it is now stretched: force, flux linkage, co-energy and Hall field.

        Where parts saturate, with the flux linkages at rest, without any current.
        """
        at_rest = self._state(np.zeros_like(self.bias)) if self.saturates else None
        self.solve()
        linked = inner_products(self.loads, self.total)
        result = Coefficients(
            force=self.layer_force.of_sum(self.total) - self.layer_force.of_sum(self.own),
            flux_linkage=linked[1:],
            coenergy=0.5 * float(linked[0, 0]),
            hall=None if self._hall is None else hall_fields(self._hall, self.space, self.total),
        )
        if at_rest is None:
            return result
        result.force[1:, 1:] = 0.0
        return replace(result, rest=inner_products(self.loads[1:], at_rest[None])[:, 0])
