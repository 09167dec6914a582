r"""Small fields about the static state at one current, where parts saturate.

The system has the sources of :class:`femfit.field.linear_system.LinearSystem`, of which the first is the state itself,
the magnets' and the bias currents' together, and the others are small currents beside it: their fields dw obey
K_d dw = load with the derivative K_d of the state's equations (the incremental permeability), and each changes the
force by the mutual stress of its field with the state's, F = F_0 + 2 dF. What is of second order in small currents is
left out, and zero in the forms.
"""

from collections.abc import Sequence

import numpy as np
from ngsolve import ConvertOperator, GridFunction, Mesh

from femfit.core.arrays import FloatArray
from femfit.core.constants import MU_0
from femfit.core.errors import FieldSolverError
from femfit.device.parts import Actuator
from femfit.field.force import LayerForce, quadratic
from femfit.field.layout import Layout
from femfit.field.linear_system import Coefficients, LinearSystem, PatternLoads, hall_fields, inner_products, loads_of
from femfit.field.material_points import MaterialPoints, csr
from femfit.field.newton import minimise
from femfit.field.nonlinear_system import NonlinearSystem

FIRST_ORDER = 2
"""Polynomial order at which the state is found first."""


def static_system(
    mesh: Mesh, actuator: Actuator, layout: Layout, g: GridFunction, order: int, patterns: PatternLoads | None = None
) -> "LinearSystem | BiasedSystem":
    """The system of an actuator's fields at rest, exact or small about the bias."""
    kind = BiasedSystem if actuator.saturates else LinearSystem
    return kind(mesh, actuator, layout, g, order, patterns)


class BiasedSystem:
    """The system of the module's head, used like a :class:`LinearSystem`; ``bias`` has the circuits' currents in A."""

    def __init__(
        self,
        mesh: Mesh,
        actuator: Actuator,
        layout: Layout,
        g: GridFunction,
        order: int,
        patterns: PatternLoads | None = None,
    ) -> None:
        self.mesh, self._hall = mesh, actuator.hall
        self.bias = np.zeros(len(actuator.circuits))
        self._levels = [NonlinearSystem(mesh, actuator, layout, one) for one in dict.fromkeys((FIRST_ORDER, order))]
        self._raise_order = csr(
            ConvertOperator(self._levels[0].space, self._levels[-1].space), self._levels[0].space.ndof
        )
        fine = self._levels[-1]
        self.space = fine.space
        self.loads, self.own_loads = loads_of(self.space, actuator, patterns)
        self.total, self.own = (tuple(GridFunction(self.space) for _ in self.loads) for _ in range(2))
        self.layer_force = LayerForce(self.space, g)

    @property
    def points(self) -> MaterialPoints:
        """The material's points, with the incremental permeability of the state that was last solved."""
        return self._levels[-1].points

    def state(self, currents: FloatArray | None = None) -> FloatArray:
        """The unknowns of the static state on the mesh as it is now stretched, at the bias or at other currents."""
        currents = self.bias if currents is None else currents
        start = np.zeros(self._levels[0].space.ndof)
        for level in self._levels:
            level.move()
            result = minimise(level, currents, start)
            if not result.converged:
                amperes = ", ".join(f"{one:g}" for one in currents)
                raise FieldSolverError(
                    f"the state at {amperes} A did not converge: Newton's iteration left a residual of "
                    f"{result.residual:.1e}. Check the B-H curve for kinks, or give another solver.eddy_bias_A"
                )
            start = self._raise_order @ result.state if level is not self._levels[-1] else result.state
        return start

    def changes(self, states: Sequence[FloatArray], step: float) -> FloatArray:
        """The derivative of the sources' fields, from two states a step apart: the first one's, and zeros."""
        result = np.zeros((len(self.loads), self.space.ndof))
        result[0] = (states[1] - states[0]) / step
        return result

    def solve(self) -> None:
        """Overwrite ``total`` and ``own`` by the fields on the mesh as it is now stretched."""
        state = self.state()
        fine = self._levels[-1]
        fine.renew(state)
        self._tensor = fine.points.tensor(fine.points.flux_density(state))
        solutions = [state, *(fine.solve(load) for load in self.loads[1:])]
        for solution, total in zip(solutions, self.total, strict=True):
            total.vec.FV().NumPy()[:] = solution
        self.own[0].vec.FV().NumPy()[:] = fine.own_state(state, self.bias)
        self.find_own(self.total[1:], self.own_loads[1:], self.own[1:])

    def find_own(
        self, totals: Sequence[GridFunction], loads: Sequence[FloatArray] | FloatArray, own: Sequence[GridFunction]
    ) -> None:
        """As :meth:`LinearSystem.find_own`, of small fields."""
        fine, (rr, rz, zz) = self._levels[-1], self._tensor
        for total, load, function in zip(totals, loads, own, strict=True):
            b = fine.points.flux_density(total.vec.FV().NumPy())
            induced = b / MU_0 - np.stack([rr * b[0] + rz * b[1], rz * b[0] + zz * b[1]])
            function.vec.FV().NumPy()[:] = fine.solve_free(fine.points.load(induced * fine.points.moving) + load)

    def evaluate(self) -> Coefficients:
        """As :meth:`LinearSystem.evaluate`; the force has entries in its first row and column alone."""
        rest = self._levels[-1].function(self.state(np.zeros_like(self.bias)))
        self.solve()
        self_force = quadratic(self.layer_force, self.own)
        force = quadratic(self.layer_force, self.total) - self_force
        force[1:, 1:] = 0.0
        hall = hall_fields(self._hall, self.mesh, self.total)
        linked = inner_products(self.loads, self.total)
        return Coefficients(
            force, self_force, linked[1:], 0.5 * linked[0, 0], hall, inner_products(self.loads[1:], [rest])[:, 0]
        )
