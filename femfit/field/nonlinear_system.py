"""The discrete problem with saturating parts on one mesh and polynomial order: energy, derivatives, own field.

The air, the winding and the open boundary are one linear form, assembled once a distance; the parts enter through their
quadrature points. Inner unknowns are condensed element by element, so the condensed second derivative is the sum of the
air's (kept) and the parts' (assembled anew), and a renewal repeats only the numbers of the factorisation.

Small fields about the static state at one current have a system of their own. It has the sources of
:class:`femfit.field.linear_system.LinearSystem`, of which the first is the state itself, the magnets' and the bias
currents' together, and the others are small currents beside it: their fields dw obey K_d dw = load with the derivative
K_d of the state's equations (the incremental permeability), and each changes the force by the mutual stress of its
field with the state's, F = F_0 + 2 dF. What is of second order in small currents is left out, and zero in the forms.
"""

from dataclasses import replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import ngsolve as ng
import numpy as np
from ngsolve import H1, ConvertOperator

from femfit.core.errors import FieldSolverError
from femfit.core.numerics import MU_0, FloatArray
from femfit.device.parts import Actuator
from femfit.field.layout import AIR
from femfit.field.linear_system import LinearSystem, PatternLoads, SourceFields, SummedInverse
from femfit.field.material_points import MaterialPoints
from femfit.field.moving_mesh import MovingMesh
from femfit.field.newton import Expansion, inner, minimise
from femfit.field.point_rows import Coefficients
from femfit.field.weak_form import FieldArray, LayerForce, csr, inner_products, materials, source_loads, stiffness


class NonlinearSystem:
    """What :func:`femfit.field.newton.minimise` minimises; states are coefficient vectors of w."""

    def __init__(self, moving: MovingMesh, actuator: Actuator, order: int) -> None:
        self.space, self._mover_weight = H1(moving.mesh, order=order), moving.mover_weight
        self.points = MaterialPoints(self.space, materials(actuator))
        self._magnets = self.points.load(self.points.coercive_field)
        # Loads of 1 A in each circuit, and in its moving coils alone; shape (circuits, unknowns)
        self.circuits, self.own_circuits = (
            source_loads(self.space, actuator, moving=moves)[1:] for moves in (False, True)
        )
        nu_0, radius = ng.CF(1.0 / MU_0), moving.layout.outer_radius
        self._air = stiffness(self.space, nu_0, radius, regions=AIR)
        self._air_uncondensed = stiffness(self.space, nu_0, radius, regions=AIR, condense=False)
        self._vacuum = stiffness(self.space, nu_0, None, regions=self.points.regions).Assemble()  # moves with its parts
        self._inverse, self._free_inverse = (SummedInverse(self.space) for _ in range(2))
        self.ready = self._free_ready = False
        self._last_state, self._last_flux_density = np.empty(0), np.empty((2, 0))

    def move(self) -> None:
        """Take the mesh as it is now stretched."""
        self._air.Assemble()
        self._stiffness = csr(self._air_uncondensed.Assemble().mat, self.space.ndof)
        self.ready = self._free_ready = False

    def evaluate(self, state: FloatArray, currents: FloatArray) -> Expansion:
        """Energy without the constant of the magnets, its derivative and the state's square."""
        h, stored = self.points.respond(self._flux_density(state))
        of_air = self._stiffness @ state
        of_all = of_air + self.points.load(h)
        sources = self._magnets + currents @ self.circuits
        return Expansion(
            energy=0.5 * inner(state, of_air) + stored - inner(state, sources),
            gradient=of_all - sources,
            square=inner(state, of_all),
        )

    def renew(self, state: FloatArray) -> None:
        """Factorise the second derivative at a state."""
        self.points.set_tangent(self._flux_density(state))
        self._inverse.renew((self._air, self.points.tangent_form))
        self.ready = True

    def solve(self, load: FloatArray) -> FloatArray:
        """Solve with the second derivative as last factorised."""
        return self._inverse.solve(load)

    def respond(self, state: FloatArray, loads: FloatArray) -> FloatArray:
        """What loads (k, unknowns) change of a state at the distance last moved to, in the same shape."""
        self.renew(state)
        return self._inverse.solve_all(loads)

    def inductance(self, state: FloatArray) -> FloatArray:
        """d(flux linkages)/d(currents) at a converged state, in H, shape (circuits, circuits)."""
        return inner_products(self.respond(state, self.circuits), self.circuits)

    def flux_linkage(self, state: FloatArray) -> FloatArray:
        """Of each circuit, in Wb."""
        return inner_products(self.circuits, state[None])[:, 0]

    def own_state(self, state: FloatArray, currents: FloatArray) -> FloatArray:
        """The field in free space of the moving part's magnetisation, frozen as in a state, and of its currents."""
        magnetisation = self.points.magnetisation(self._flux_density(state)) * self.points.moving
        return self.solve_free((self.points.load(magnetisation) + currents @ self.own_circuits)[None])[0]

    def solve_free(self, loads: FieldArray) -> FieldArray:
        """The fields of loads (k, unknowns) in free space."""
        if not self._free_ready:
            self._free_inverse.renew((self._air, self._vacuum))
            self._free_ready = True
        return self._free_inverse.solve_all(loads)

    def force(self, state: FloatArray, currents: FloatArray) -> float:
        """The force of a state in N, without what the moving part's own field has of it on the mesh."""
        total, alone = (self._layer.of_sum(w[None]).item() for w in (state, self.own_state(state, currents)))
        return float(total - alone)

    @cached_property
    def _layer(self) -> LayerForce:
        return LayerForce(self.space, self._mover_weight)

    def _flux_density(self, state: FloatArray) -> FloatArray:
        """At the parts' points; that of the last state is kept, which is asked for again and again."""
        if state is not self._last_state:
            self._last_state, self._last_flux_density = state, self.points.flux_density(state)
        return self._last_flux_density


FIRST_ORDER = 2
"""Polynomial order at which a state is found first: a tenth of what an iteration costs at order 5."""


def at_orders(moving: MovingMesh, actuator: Actuator, *orders: int) -> tuple[list[NonlinearSystem], list[Any]]:
    """Systems of ascending polynomial orders, and the maps of the states of each but the last to the next one's."""
    systems = [NonlinearSystem(moving, actuator, order) for order in sorted(set(orders))]
    return systems, [csr(ConvertOperator(low.space, high.space), low.space.ndof) for low, high in pairwise(systems)]


def static_system(
    moving: MovingMesh, actuator: Actuator, order: int, patterns: PatternLoads | None = None
) -> SourceFields:
    """The system of an actuator's fields at rest, exact or small about the bias."""
    return (BiasedSystem if actuator.saturates else LinearSystem)(moving, actuator, order, patterns)


class BiasedSystem(SourceFields):
    """The system of the module's head; the force has entries in its first row and column alone."""

    def __init__(
        self, moving: MovingMesh, actuator: Actuator, order: int, patterns: PatternLoads | None = None
    ) -> None:
        self._levels, self._raise_order = at_orders(moving, actuator, FIRST_ORDER, order)
        super().__init__(self._levels[-1].space, actuator, moving.mover_weight, patterns)
        self.points = self._levels[-1].points

    def state(self) -> FloatArray:
        """The state at the bias, shape (m, unknowns)."""
        return np.array([self._state(self.bias), *np.zeros_like(self.loads[1:])])

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

    def solve(self) -> None:
        """Renew ``total`` and ``own`` on the mesh as it is now stretched."""
        state, fine = self._state(self.bias), self._levels[-1]
        self.total = np.concatenate([state[None], fine.respond(state, self.loads[1:])])
        self._tensor = fine.points.tensor(fine.points.flux_density(state))
        alone = fine.own_state(state, self.bias)
        self.own = np.concatenate([alone[None], self.own_of(self.total[1:], self.own_loads[1:])])

    def own_of(self, fields: FieldArray, loads: FieldArray) -> FieldArray:
        """As :meth:`LinearSystem.own_of`, of small fields."""
        fine, (rr, rz, zz), magnetised = self._levels[-1], self._tensor, []
        for field in fields:
            b = fine.points.flux_density(field)
            induced = b / MU_0 - np.stack([rr * b[0] + rz * b[1], rz * b[0] + zz * b[1]])
            magnetised.append(fine.points.load(induced * fine.points.moving))
        return fine.solve_free(np.array(magnetised).reshape(loads.shape) + loads)

    def evaluate(self) -> Coefficients:
        """With the flux linkages at rest, without any current."""
        rest, result = self._state(np.zeros_like(self.bias)), super().evaluate()
        result.force[1:, 1:] = 0.0
        return replace(result, rest=inner_products(self.loads[1:], rest[None])[:, 0])
