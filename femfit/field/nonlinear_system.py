"""The discrete problem on one mesh and polynomial order: energy, its derivatives, and the moving part's own field.

The air, the winding and the open boundary are one linear form, assembled once a distance; the parts enter through their
quadrature points. Inner unknowns are condensed element by element, so the condensed second derivative is the sum of the
air's (kept) and the parts' (assembled anew), and a renewal repeats only the numbers of the factorisation.
"""

from collections.abc import Sequence
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import ngsolve as ng
import numpy as np
from ngsolve import H1, BilinearForm, ConvertOperator, GridFunction, dx

from femfit.core.numerics import MU_0, FloatArray, IntArray
from femfit.device.parts import Actuator
from femfit.field.layout import AIR
from femfit.field.material_points import MaterialPoints
from femfit.field.newton import Expansion, inner
from femfit.field.weak_form import FieldArray, LayerForce, csr, inner_products, materials, source_loads, stiffness

if TYPE_CHECKING:
    from femfit.field.moving_mesh import MovingMesh


class NonlinearSystem:
    """What :func:`femfit.field.newton.minimise` minimises; states are coefficient vectors of w."""

    def __init__(self, moving: "MovingMesh", actuator: Actuator, order: int) -> None:
        self.space, self._mover_weight = H1(moving.mesh, order=order), moving.mover_weight
        self.points = MaterialPoints(self.space, materials(actuator))
        self.magnets = self.points.load(self.points.coercive_field)
        # Loads of 1 A in each circuit, and in its moving coils alone; shape (circuits, unknowns)
        self.circuits, self.own_circuits = (source_loads(self.space, actuator, moving=moves) for moves in (False, True))
        nu_0, radius = ng.CF(1.0 / MU_0), moving.layout.outer_radius
        self._air = stiffness(self.space, nu_0, radius, regions=AIR)
        self._air_uncondensed = stiffness(self.space, nu_0, radius, regions=AIR, condense=False)
        self._vacuum = stiffness(self.space, nu_0, None, regions=self.points.regions).Assemble()  # moves with its parts
        self._inverse, self._free_inverse = (SummedInverse(self.space) for _ in range(2))
        self._stiffness: Any = None
        self.ready = self._free_ready = False
        self._last_state, self._last_flux_density = np.empty(0), np.empty((2, 0))

    def move(self) -> None:
        """Take the mesh as it is now stretched."""
        self._air.Assemble()
        self._stiffness = None
        self.ready = self._free_ready = False

    def evaluate(self, state: FloatArray, currents: FloatArray) -> Expansion:
        """Energy without the constant of the magnets, its derivative and the state's square."""
        if self._stiffness is None:
            self._stiffness = csr(self._air_uncondensed.Assemble().mat, self.space.ndof)
        h, stored = self.points.respond(self._flux_density(state))
        of_air = self._stiffness @ state
        of_all = of_air + self.points.load(h)
        sources = self.magnets + currents @ self.circuits
        return Expansion(
            energy=0.5 * inner(state, of_air) + stored - inner(state, sources),
            gradient=of_all - sources,
            square=inner(state, of_all),
        )

    def renew(self, state: FloatArray) -> None:
        """Factorise the second derivative at a state, the same at all states where nothing saturates."""
        if self.points.saturates:
            self.points.set_tangent(self._flux_density(state))
        elif self.ready:
            return
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
        total, alone = (self.layer.of_sum(w[None]).item() for w in (state, self.own_state(state, currents)))
        return float(total - alone)

    @cached_property
    def layer(self) -> LayerForce:
        """The stress in the layer around the moving part."""
        return LayerForce(self.space, self._mover_weight)

    def _flux_density(self, state: FloatArray) -> FloatArray:
        """At the parts' points; that of the last state is kept, which is asked for again and again."""
        if state is not self._last_state:
            self._last_state, self._last_flux_density = state, self.points.flux_density(state)
        return self._last_flux_density


FIRST_ORDER = 2
"""Polynomial order at which a state is found first: a tenth of what an iteration costs at order 5."""


def at_orders(moving: "MovingMesh", actuator: Actuator, *orders: int) -> tuple[list[NonlinearSystem], list[Any]]:
    """Systems of ascending polynomial orders, and the maps of the states of each but the last to the next one's."""
    systems = [NonlinearSystem(moving, actuator, order) for order in sorted(set(orders))]
    return systems, [csr(ConvertOperator(low.space, high.space), low.space.ndof) for low, high in pairwise(systems)]


class SummedInverse:
    """The inverse of a sum of condensed forms on regions of their own.

    The air's form changes with the distance, those of parts do not, since they move as rigid bodies. Inner unknowns are
    condensed element by element, so the condensed form of the whole is the sum of the air's, assembled once a distance,
    and the parts', assembled once a mesh; the same air serves the field of the moving part alone in free space.
    Renewals keep the elimination order. The forms must be symmetric and condensed.
    """

    def __init__(self, space: H1) -> None:
        self._space = space
        self._parts: Sequence[BilinearForm] = ()
        w, v = space.TnT()
        matrix = BilinearForm(w * v * dx, symmetric=True, condense=True).Assemble()  # cheap, for the sum's pattern
        self._keys = _entry_keys(matrix)
        self._places: list[IntArray] = []
        self._matrix = matrix.mat
        self._inverse: Any = None
        self._load, self._solution = (GridFunction(self._space).vec for _ in range(2))

    def renew(self, parts: Sequence[BilinearForm]) -> None:
        """Sum and factorise forms that are assembled on disjoint regions, the same in the same order every time."""
        self._parts = parts
        values = self._matrix.AsVector().FV().NumPy()
        values[:] = 0.0
        if not self._places:
            self._places = [np.searchsorted(self._keys, _entry_keys(matrix)) for matrix in parts]
        for entries, places in zip(parts, self._places, strict=True):
            values[places] += entries.mat.AsVector().FV().NumPy()
        if self._inverse is None:
            free = self._space.FreeDofs(coupling=True)
            self._inverse = self._matrix.Inverse(free, inverse="sparsecholesky")
        else:
            self._inverse.Update()

    def solve(self, load: FloatArray) -> FloatArray:
        """Solve with the sum as last renewed for a right-hand side of shape (unknowns,)."""
        rhs, solution = self._load, self._solution
        rhs.FV().NumPy()[:] = load
        for form in self._parts:
            rhs.data += form.harmonic_extension_trans * rhs
        solution.data = self._inverse * rhs
        for form in self._parts:
            solution.data += form.harmonic_extension * solution
        for form in self._parts:
            solution.data += form.inner_solve * rhs
        return np.array(solution.FV().NumPy())

    def solve_all(self, loads: FieldArray) -> FieldArray:
        """The same for several right-hand sides (k, unknowns), complex ones of real forms too."""
        if np.iscomplexobj(loads) and not self._space.is_complex:
            return self.solve_all(loads.real) + 1j * self.solve_all(loads.imag)
        solved = [self.solve(load) if load.any() else np.zeros_like(load) for load in loads]
        return np.array(solved).reshape(loads.shape)


def _entry_keys(form: BilinearForm) -> IntArray:
    """Row and column of each stored entry as one ascending number."""
    _, indices, offsets = form.mat.CSR()
    columns, starts = (np.array(array).astype(np.int64) for array in (indices, offsets))
    rows = np.repeat(np.arange(len(starts) - 1), np.diff(starts))
    return np.asarray(rows * form.space.ndof + columns)
