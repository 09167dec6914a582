"""The discrete linear problem on one mesh and polynomial order: the fields of magnets and of 1 A, and the mover's own.

In a solution w, H = nu_0 B - M holds with the moving part's magnetisation M = (nu_0 - nu) B + nu B_rem, so that w is
exactly u + v: u of M, frozen, and of the moving coils' currents in free space, v of everything else (as in
:mod:`femfit.field.problem`). All are linear in the sources (1, i_1 .. i_n). A field is the array of its coefficients.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import ngsolve as ng
import numpy as np
from ngsolve import H1, BilinearForm, GridFunction, dx

from femfit.core.numerics import MU_0, FloatArray, IntArray
from femfit.device.parts import Actuator
from femfit.field.layout import AIR
from femfit.field.material_points import MaterialPoints
from femfit.field.point_rows import Coefficients
from femfit.field.weak_form import (
    FieldArray,
    LayerForce,
    csr,
    hall_fields,
    inner_products,
    linear_materials,
    reluctivity,
    source_loads,
    stiffness,
)

if TYPE_CHECKING:
    from femfit.field.moving_mesh import MovingMesh

PatternLoads = Callable[[H1], tuple[FloatArray, FloatArray]]
"""Right-hand sides of patterns of induced currents, and of what of them moves; shape (patterns, unknowns) each."""


class SourceFields(ABC):
    """Right-hand sides and fields of all sources on one space: the magnets, 1 A in each circuit, and patterns.

    ``loads`` and ``own_loads``, of what of them moves, and the fields ``total`` and ``own`` have the shape
    (m, unknowns). Where parts saturate, ``bias`` has the circuits' currents in A about which the fields are small,
    and ``points`` the material's points, with the incremental permeability of the state that was last solved.
    """

    points: MaterialPoints | None = None

    def __init__(self, space: H1, actuator: Actuator, g: GridFunction, patterns: PatternLoads | None) -> None:
        self.mesh, self.space, self._hall = space.mesh, space, actuator.hall
        self.bias = np.zeros(len(actuator.circuits))
        self.loads, self.own_loads = (source_loads(space, actuator, moving=moving) for moving in (False, True))
        if patterns is not None:
            induced, induced_moving = patterns(space)
            self.loads = np.concatenate([self.loads, induced])
            self.own_loads = np.concatenate([self.own_loads, induced_moving])
        self.total = self.own = np.zeros_like(self.loads)
        self.layer_force = LayerForce(space, g)

    @abstractmethod
    def state(self) -> FloatArray:
        """Fields of all sources at rest on the mesh as it is now stretched, shape (m, unknowns); small ones as 0."""

    @abstractmethod
    def solve(self) -> None:
        """Renew ``total`` and ``own`` on the mesh as it is now stretched."""

    @abstractmethod
    def own_of(self, fields: FieldArray, loads: FieldArray) -> FieldArray:
        """Fields (k, unknowns) of the moving part alone, of its currents' loads and of what fields magnetise."""

    def evaluate(self) -> Coefficients:
        """Solve on the mesh as it is now stretched: force, flux linkage, co-energy and Hall field."""
        self.solve()
        linked = inner_products(self.loads, self.total)
        return Coefficients(
            force=self.layer_force.of_sum(self.total) - self.layer_force.of_sum(self.own),
            flux_linkage=linked[1:],
            coenergy=0.5 * float(linked[0, 0]),
            hall=None if self._hall is None else hall_fields(self._hall, self.space, self.total),
        )


class LinearSystem(SourceFields):
    """Forms, loads and force matrix; from one distance to the next only the air's form changes."""

    def __init__(
        self, moving: "MovingMesh", actuator: Actuator, order: int, patterns: PatternLoads | None = None
    ) -> None:
        super().__init__(H1(moving.mesh, order=order), actuator, moving.mover_weight, patterns)
        named = linear_materials(actuator)
        parts, nu_0, nu = "|".join(named), ng.CF(1.0 / MU_0), reluctivity(self.mesh, named)
        self._air = stiffness(self.space, nu_0, moving.layout.outer_radius, regions=AIR)
        self._solid, self._vacuum = (
            [stiffness(self.space, reluctivity, None, regions=parts).Assemble()] if named else []
            for reluctivity in (nu, nu_0)
        )
        self._inverse, self._free_inverse = (SummedInverse(self.space) for _ in range(2))
        induced = stiffness(self.space, nu_0 - nu, None, regions="moving:.*", condense=False)
        self._induced = csr(induced.Assemble().mat, self.space.ndof)

    def solve(self) -> None:
        """Renew ``total`` and ``own`` on the mesh as it is now stretched."""
        self.total = self.state()
        self._free_inverse.renew((self._air, *self._vacuum))
        self.own = self.own_of(self.total, self.own_loads)

    def own_of(self, fields: FieldArray, loads: FieldArray) -> FieldArray:
        """Fields (k, unknowns) of the moving part alone, of its currents' loads and of what fields magnetise."""
        return self._free_inverse.solve_all((self._induced @ fields.T).T + loads)

    def state(self) -> FloatArray:
        """As of all sources, shape (m, unknowns)."""
        self._air.Assemble()
        self._inverse.renew((self._air, *self._solid))
        return self._inverse.solve_all(self.loads)

    def respond(self, state: FloatArray, loads: FloatArray) -> FloatArray:  # noqa: ARG002  nothing depends on it
        """What loads (k, unknowns) change of any state of the mesh as it was last solved, in the same shape."""
        return self._inverse.solve_all(loads)


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
