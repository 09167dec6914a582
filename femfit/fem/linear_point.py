"""All currents of a linear actuator from one factorisation a distance.

The field is w = w_m + i w_c (magnets, coil with 1 A), so F = F_0 + F_1 i + F_2 i^2, the flux linkage and the Hall field
are affine in i, and the co-energy is W' = W_0 + flux_0 i + L i^2 / 2. The stress of the moving magnet's own field
integrates to zero, but not on a mesh: it is evaluated on the same mesh with everything else taken away, and subtracted.
"""

from dataclasses import dataclass
from typing import Any

import ngsolve as ng
import numpy as np
from ngsolve import H1, InnerProduct, Mesh

from femfit.actuator.parts import Actuator
from femfit.core.arrays import FloatArray
from femfit.core.errors import FieldSolverError
from femfit.fem.layout import Layout
from femfit.fem.moving_mesh import MovingMesh
from femfit.fem.point_field import PointField
from femfit.fem.settings import SolverSettings
from femfit.fem.stress import LayerForce, weight
from femfit.fem.superposition import DistanceSolution, superpose
from femfit.fem.weak_form import (
    Factorisation,
    Loads,
    assemble_loads,
    flux_density,
    linear_materials,
    reluctivity,
    stiffness,
)


class LinearActuator:
    """One mesh of an actuator with linear materials, to be stretched over a group of distances.

    Parameters
    ----------
    actuator : Actuator
        Checked.
    group : tuple of float
        Distances that share the mesh, in m, ascending.
    layout : Layout
        Of the whole sweep.
    settings : SolverSettings
        Order and element sizes.
    estimate : bool
        Whether every distance is also solved one order lower, for the force's error.
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
        self.layout = layout
        self._moving = MovingMesh(actuator, group, layout, settings)
        self.mesh = self._moving.mesh
        g = weight(self.mesh)
        self._orders = tuple(
            _Discretisation(self.mesh, actuator, layout, g, settings.order - lower) for lower in range(1 + estimate)
        )

    @property
    def unknowns(self) -> int:
        """Number of unknowns of the finer of the two orders."""
        return int(self._orders[0].space.ndof)

    def solve(self, distance: float) -> DistanceSolution:
        """Solve at a distance.

        Parameters
        ----------
        distance : float
            In m; within the group that the mesh was made for.

        Returns
        -------
        DistanceSolution
            Coefficients of force, flux linkage, co-energy and Hall field.
        """
        with self._moving.at(distance):
            fine, *coarse = (discretisation.evaluate() for discretisation in self._orders)
        return DistanceSolution(
            force=fine.force,
            force_change=fine.force - coarse[0].force if coarse else None,
            flux_linkage=fine.flux_linkage,
            coenergy=fine.coenergy,
            hall=fine.hall,
            self_force=fine.self_force,
        )

    def rows(self, distance: float, currents: tuple[float, ...]) -> dict[str, list[Any]]:
        """Columns of the sweep table at a distance.

        Parameters
        ----------
        distance : float
            In m; within the group.
        currents : tuple of float
            In A.

        Returns
        -------
        dict of list
            By column name, one value a current.
        """
        solution = self.solve(distance)
        if not np.all(np.isfinite(solution.force)):
            raise FieldSolverError(
                "the solution is not finite. Look for extreme dimensions or materials in the actuator file."
            )
        columns = superpose(np.array(currents), solution)
        return {name: values.tolist() for name, values in columns.items()}

    def field(self, distance: float, current: float) -> PointField:
        """The field at a point, with the mesh left stretched to it.

        Parameters
        ----------
        distance, current : float
            In m and A.

        Returns
        -------
        PointField
            Of the finer order.
        """
        solution = self.solve(distance)
        magnet, coil = self.fields(distance)
        magnet.vec.data += current * coil.vec
        force = float(np.polynomial.polynomial.polyval(current, solution.force))
        return PointField(magnet, force, solution.self_force)

    def fields(self, distance: float) -> tuple[ng.GridFunction, ng.GridFunction]:
        """Solutions (w_m, w_c) at a distance, with the mesh left stretched to it, for pictures."""
        self._moving.move_to(distance)
        return self._orders[0].solutions()


@dataclass(frozen=True)
class _Coefficients:
    force: FloatArray
    flux_linkage: FloatArray
    coenergy: float
    hall: FloatArray | None
    self_force: float


class _Discretisation:
    """Forms, loads and force matrix of one polynomial order; only the stiffness depends on the distance."""

    def __init__(self, mesh: Mesh, actuator: Actuator, layout: Layout, g: ng.GridFunction, order: int) -> None:
        self.mesh = mesh
        self.space = H1(mesh, order=order)
        self.hall = actuator.hall
        named = linear_materials(actuator)
        own = {name: material for name, material in named.items() if name.startswith("moving:")}
        self._whole = Factorisation(stiffness(self.space, reluctivity(mesh, named), layout.outer_radius))
        self.loads: Loads = assemble_loads(self.space, actuator)
        self.layer_force = LayerForce(self.space, g)
        self._own: Factorisation | None = None
        if any(material.remanence_T for material in own.values()):
            self._own = Factorisation(stiffness(self.space, reluctivity(mesh, own), layout.outer_radius))

    def solutions(self) -> tuple[ng.GridFunction, ng.GridFunction]:
        magnet, coil = self._whole.solve([self.loads.magnets, self.loads.coil])
        return magnet, coil

    def evaluate(self) -> _Coefficients:
        magnet, coil = self.solutions()
        force = self.layer_force
        self_force = 0.0
        if self._own is not None:
            (own,) = self._own.solve([self.loads.own_magnets])
            self_force = force.between(own, own)
        return _Coefficients(
            force=np.array(
                [
                    force.between(magnet, magnet) - self_force,
                    2.0 * force.between(magnet, coil),
                    force.between(coil, coil),
                ]
            ),
            flux_linkage=np.array(
                [InnerProduct(self.loads.coil.vec, magnet.vec), InnerProduct(self.loads.coil.vec, coil.vec)]
            ),
            coenergy=0.5 * InnerProduct(self.loads.magnets.vec, magnet.vec),
            hall=self._hall_field(magnet, coil),
            self_force=self_force,
        )

    def _hall_field(self, magnet: ng.GridFunction, coil: ng.GridFunction) -> FloatArray | None:
        if self.hall is None:
            return None
        point = self.mesh(self.hall.radius_m, self.hall.height_m)
        return np.array([flux_density(solution)[1](point) for solution in (magnet, coil)])
