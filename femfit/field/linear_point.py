"""All currents of a linear actuator from one factorisation a distance.

The field is a sum over the sources s = (1, i_1 .. i_n) of the magnets' and of each circuit's with 1 A, so the force is
a quadratic form in s, flux linkages and the Hall field are linear in it, and the co-energy is a quadratic form again.
The stress of the moving part's own field integrates to zero, but not on a mesh: it is evaluated on the same mesh with
everything else taken away, and subtracted (:mod:`femfit.field.linear_system`).
"""

from collections.abc import Sequence
from typing import Any

import ngsolve as ng
import numpy as np

from femfit.core.arrays import FloatArray
from femfit.core.errors import FieldSolverError
from femfit.device.drawn_numbers import DrawnNumber
from femfit.device.parts import Actuator
from femfit.field.currents import CurrentsLike, current_points, sources
from femfit.field.force import OtherForces, weight
from femfit.field.layout import Layout
from femfit.field.linear_system import LinearSystem
from femfit.field.moving_mesh import MovingMesh, PointField
from femfit.field.pickup import PickupCoils
from femfit.field.point_rows import DistanceSolution, superpose
from femfit.field.settings import SolverSettings
from femfit.field.signature_rows import SignatureRows


class LinearActuator:
    """One mesh of an actuator with linear materials, to be stretched over a group of distances.

    The group's distances are in m, ascending; with ``estimate`` each is also solved one order lower, for the force's
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
        self.actuator = actuator
        self._circuits = tuple(circuit.name for circuit in actuator.circuits)
        self.layout = layout
        self._moving = MovingMesh(actuator, group, layout, settings)
        self.mesh = self._moving.mesh
        self._pickups = PickupCoils(actuator, self._moving)
        g = weight(self.mesh)
        self._system = LinearSystem(self.mesh, actuator, layout, g, settings.order)
        self._lower = LinearSystem(self.mesh, actuator, layout, g, settings.order - 1) if estimate else None
        self._signatures: SignatureRows | None = None
        self._solved: float | None = None  # distance that the fields are of
        self._others = OtherForces(
            self._system.total, self._system.own, self._moving.reaction_weight, self._moving.work_weight
        )

    @property
    def unknowns(self) -> int:
        """Number of unknowns of the finer of the two orders."""
        return int(self._system.space.ndof)

    def solve(self, distance: float) -> DistanceSolution:
        """Solve at a distance."""
        with self._moving.at(distance):
            fine = self._system.evaluate()
            reaction, work = self._others.evaluate()
            coils = self._pickups.at(distance)
            linked = [coils.linked(total) for total in self._system.total]
            lower = None if self._lower is None else self._lower.evaluate()
        self._solved = distance
        return DistanceSolution(
            force=fine.force,
            force_change=None if lower is None else fine.force - lower.force,
            reaction=reaction,
            work=work,
            flux_linkage=fine.flux_linkage,
            coenergy=fine.coenergy,
            hall=fine.hall,
            self_force=fine.self_force,
            pickup={name: np.array([one[name] for one in linked]) for name in linked[0]},
        )

    def rows(self, distance: float, currents: CurrentsLike) -> dict[str, list[Any]]:
        """Columns of the sweep table at a distance, one value a point of the currents."""
        solution = self.solve(distance)
        if not np.all(np.isfinite(solution.force)):
            raise FieldSolverError(
                "the solution is not finite. Look for extreme dimensions or materials in the actuator file."
            )
        columns = superpose(sources(currents, self._circuits), solution, self._circuits)
        return {name: values.tolist() for name, values in columns.items()}

    def signatures(self, distance: float, currents: CurrentsLike, numbers: Sequence[DrawnNumber]) -> FloatArray:
        """As :meth:`femfit.field.signature_rows.SignatureRows.of_states`, at points of the currents."""
        if self._solved != distance:
            self.solve(distance)
        system = self._system
        if self._signatures is None:
            self._signatures = SignatureRows(self.actuator, numbers, self._moving, system.space, system.loads[1:])
        totals = np.stack([total.vec.FV().NumPy() for total in system.total])
        points = current_points(currents, len(self._circuits))
        return self._signatures.of_sources(distance, points, totals, system.respond)

    def field(self, distance: float, currents: CurrentsLike) -> PointField:
        """The field at a point, with the mesh left stretched to it."""
        solution = self.solve(distance)
        self._moving.move_to(distance)
        (factors,) = sources(currents, self._circuits)
        field = ng.GridFunction(self._system.space)
        for factor, total in zip(factors, self._system.total, strict=True):  # as solved
            field.vec.data += factor * total.vec
        return PointField(field, _form(solution.force, factors), _form(solution.self_force, factors))


def _form(matrix: FloatArray, factors: FloatArray) -> float:
    return float(factors @ matrix @ factors)
