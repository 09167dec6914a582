"""All currents of a linear actuator from one factorisation a distance.

The field is w = w_m + i w_c (magnets, coil with 1 A), so F = F_0 + F_1 i + F_2 i^2, the flux linkage and the Hall field
are affine in i, and the co-energy is W' = W_0 + flux_0 i + L i^2 / 2. The stress of the moving magnet's own field
integrates to zero, but not on a mesh: it is evaluated on the same mesh with everything else taken away, and subtracted.
"""

from dataclasses import dataclass

import ngsolve as ng
import numpy as np
from ngsolve import H1, InnerProduct, Mesh

from femfit.actuator.parts import Actuator
from femfit.core.arrays import FloatArray
from femfit.fem.drawing import build_mesh
from femfit.fem.layout import Layout, mover_outline, reference_distance
from femfit.fem.motion import stretch
from femfit.fem.settings import SolverSettings
from femfit.fem.stress import LayerForce, weight
from femfit.fem.weak_form import Loads, assemble_loads, flux_density, materials, reluctivity, solve, stiffness


@dataclass(frozen=True)
class DistanceSolution:
    """The coefficients of one distance.

    Parameters
    ----------
    force : array, shape (3,)
        F_0 in N, F_1 in N/A, F_2 in N/A^2.
    force_change : array, shape (3,)
        Its change from one polynomial order lower.
    flux_linkage : array, shape (2,)
        In Wb and H.
    coenergy : float
        W_0 in J.
    hall : array, shape (2,) or None
        In T and T/A.
    self_force : float
        The stress of the moving part's own field, as subtracted, in N.
    """

    force: FloatArray
    force_change: FloatArray
    flux_linkage: FloatArray
    coenergy: float
    hall: FloatArray | None
    self_force: float


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
    """

    def __init__(self, actuator: Actuator, group: tuple[float, ...], layout: Layout, settings: SolverSettings) -> None:
        self.actuator = actuator
        self.layout = layout
        self.reference = reference_distance(group, layout)
        self.mesh = build_mesh(actuator, self.reference, layout, settings)
        g = weight(self.mesh)
        self._orders = tuple(
            _Discretisation(self.mesh, actuator, layout, g, p) for p in (settings.order, settings.order - 1)
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
        self.move_to(distance)
        try:
            fine, coarse = (discretisation.evaluate() for discretisation in self._orders)
        finally:
            self.mesh.UnsetDeformation()
        return DistanceSolution(
            force=fine.force,
            force_change=fine.force - coarse.force,
            flux_linkage=fine.flux_linkage,
            coenergy=fine.coenergy,
            hall=fine.hall,
            self_force=fine.self_force,
        )

    def move_to(self, distance: float) -> None:
        """Stretch the mesh to a distance; ``mesh.UnsetDeformation`` undoes it."""
        r0, z0, r1, z1 = mover_outline(self.actuator).bounds
        bounds = (r0, z0 + self.reference, r1, z1 + self.reference)
        shift = distance - self.reference
        if shift:
            self._displacement = stretch(self.mesh, self.layout, bounds, shift)  # kept alive while in use
            self.mesh.SetDeformation(self._displacement)

    def fields(self, distance: float) -> tuple[ng.GridFunction, ng.GridFunction]:
        """Solutions (w_m, w_c) at a distance, with the mesh left stretched to it, for pictures."""
        self.move_to(distance)
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
        named = materials(actuator)
        own = {name: material for name, material in named.items() if name.startswith("moving:")}
        self.form = stiffness(self.space, reluctivity(mesh, named), layout.outer_radius)
        self.loads: Loads = assemble_loads(self.space, actuator)
        self.layer_force = LayerForce(self.space, g)
        self.own_form = None
        if any(material.remanence_T for material in own.values()):
            self.own_form = stiffness(self.space, reluctivity(mesh, own), layout.outer_radius)

    def solutions(self) -> tuple[ng.GridFunction, ng.GridFunction]:
        magnet, coil = solve(self.form, [self.loads.magnets, self.loads.coil])
        return magnet, coil

    def evaluate(self) -> _Coefficients:
        magnet, coil = self.solutions()
        force = self.layer_force
        self_force = 0.0
        if self.own_form is not None:
            own = solve(self.own_form, [self.loads.own_magnets])[0]
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
