"""What the field does at a distance when currents or the moving part change, and patterns of induced currents.

Induced currents that are worth keeping are those of harmonic fields, of fields at real shifts s (a current that decays
or rises at its own rate), and those that the motion induces, dw/dd at held currents, at rest and at real shifts. The
direct harmonic solutions are also what a reduced model is held against.

Patterns of induced currents serve as further, short-circuited windings, at every distance. A pattern is a distribution
of current that is fixed to the conducting parts; e_k times the k-th one flows. Each is scaled to a resistance of 1 ohm
and is orthogonal to the others in power, so that 0 = e_k + d(flux linkage_k)/dt. The co-energy is a quadratic form in
(1, i_1 .. i_n, e_1 .. e_q) and gives force, flux linkages and Hall field as for wound circuits: Galerkin's method for
the induced currents. Where parts saturate, the form is that of small currents about the bias
(:mod:`femfit.field.source_fields`).

References
----------
A. Ruhe, Linear Algebra Appl. 58 (1984) 391: rational Krylov spaces, whose real shifts keep the projection symmetric.
"""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from ngsolve import H1, SetNumThreads

from femfit.core.numerics import FloatArray
from femfit.device.parts import Actuator
from femfit.field.eddy_sweep import principal
from femfit.field.harmonic import ConductorPoints, HarmonicSystem
from femfit.field.moving_mesh import MovingMesh
from femfit.field.source_fields import SourceFields
from femfit.field.sweep_task import MeshGroup, Patterns
from femfit.field.weak_form import FieldArray, hall_fields
from femfit.tables.eddy_table import Transfers

MOTION_STEP = 0.02
"""Numerical: of the clearance; the moving part's step to either side for the currents that its motion induces."""


class EddyProbe:
    """An actuator on a mesh with the moving part at a distance in m; :meth:`transfers` comes first."""

    def __init__(
        self, actuator: Actuator, moving: MovingMesh, distance: float, order: int, bias: Sequence[float] = ()
    ) -> None:
        self._hall, self._moving, self.distance = actuator.hall, moving, distance
        self._static = SourceFields(moving, actuator, order)
        self._static.bias = np.array(bias)
        self._real, self._harmonic = (
            HarmonicSystem(moving, actuator, self._static.points, real=real) for real in (True, False)
        )
        self._beside = slice(1 if actuator.saturates else None)  # what small currents pull on
        step, states = MOTION_STEP * moving.layout.clearance, []
        for moved in (distance - step, distance + step):
            with moving.at(moved):
                states.append(self._static.state())
        # dw/dd of each source at rest, at places that move with their parts; shape (m, unknowns)
        self._motion = (states[1] - states[0]) / (2.0 * step)
        self.points = ConductorPoints(self._static.space, actuator, moving.reference)

    def transfers(self, frequencies: FloatArray) -> tuple[Transfers, FieldArray]:
        """The direct harmonic solutions at frequencies in Hz, and the fields themselves, (f, circuits, unknowns)."""
        system, solutions, fields = self._static, [], []
        with self._moving.at(self.distance):
            system.solve()
            self._harmonic.move()
            for frequency in frequencies:
                fields.append(self._harmonic.solve(2j * np.pi * frequency, system.loads[1:]))
                solutions.append(self._responses(2j * np.pi * frequency, fields[-1]))
        flux, force, hall = zip(*solutions, strict=True)
        at_hall = None if self._hall is None else np.array(hall)
        return Transfers(frequencies, np.array(flux), np.array(force), at_hall), np.array(fields)

    def patterns(self, fields: FieldArray, shifts: FloatArray, places: ConductorPoints, tolerance: float) -> FloatArray:
        """Rows (k, n) of induced currents at the points of another mesh.

        Principal components of those of harmonic fields, of each source at shifts in 1/s, and of motion, each taken at
        the same power.
        """
        system, motion = self._static, self._motion
        states = [*fields.real.reshape(-1, system.space.ndof), *fields.imag.reshape(-1, system.space.ndof)]
        braked = self.points.loads(self.points.rows(motion))
        with self._moving.at(self.distance):
            self._real.move()
            for shift in (0.0, *shifts):
                solved = self._real.solve(float(shift), np.concatenate([system.loads, braked]))
                states += [*solved[: len(system.loads)], *(motion - shift * solved[len(system.loads) :])]
        rows = self.points.rows(np.array(states))
        power = (self.points.weight * rows**2).sum(axis=1)
        alike = np.array(states)[power > 0.0] / np.sqrt(power[power > 0.0])[:, None]
        basis = principal(self.points.products(self.points.rows(alike)), tolerance) @ alike
        if places.space.mesh is system.mesh:
            return self.points.rows(basis)
        return places.rows_of(basis, system.space, self._moving.reference)

    def braking(self) -> FloatArray:
        """Power of the currents that the motion induces over speed squared, of each pair of sources, in N s/m; (m, m).

        Where a conducting part moves, of the field's change as that part sees it.
        """
        return self.points.products(self.points.rows(self._motion))

    def _responses(self, s: complex, fields: FieldArray) -> tuple[FieldArray, FieldArray, FieldArray | None]:
        """Flux linkages (n, n), forces (m, n) and Hall fields (n,) of harmonic fields at s of 1 A in each circuit."""
        system, beside = self._static, self._beside
        induced = -s * self.points.loads(self.points.rows(fields), moving=True)  # -s M w of the moving part
        alone = system.own_of(fields, system.own_loads[1:] + induced)
        force = np.zeros((len(system.total), len(fields)), dtype=np.complex128)
        pull, own = system.layer_force.between(system.total, fields), system.layer_force.between(system.own, alone)
        force[beside] = 2.0 * (pull - own)[beside]
        hall = None if self._hall is None else hall_fields(self._hall, system.space, fields)
        return system.loads[1:] @ fields.T, force, hall


@lru_cache(maxsize=2)
def moving_mesh(mesh: MeshGroup) -> MovingMesh:
    """The mesh of a group, with skin layers, kept while this process's tasks stay in it."""
    SetNumThreads(1)
    return MovingMesh(mesh.actuator, mesh.distances, mesh.layout, mesh.settings)


@lru_cache(maxsize=1)
def conductor_points(mesh: MeshGroup) -> ConductorPoints:
    """The points of the conducting parts on the mesh of a group."""
    moving = moving_mesh(mesh)
    return ConductorPoints(H1(moving.mesh, order=mesh.settings.order), mesh.actuator, moving.reference)


@lru_cache(maxsize=1)
def _pattern_fields(patterns: Patterns) -> FloatArray:
    """The fields (q, unknowns) of patterns on the mesh that they were found on."""
    return conductor_points(patterns.mesh).fields(patterns.rows)


@lru_cache(maxsize=1)
def system_with_patterns(mesh: MeshGroup, patterns: Patterns) -> SourceFields:
    """The system of fields at rest on the mesh of a group, with the sources 1, i_1 .. i_n, e_1 .. e_q."""
    moving = moving_mesh(mesh)

    def loads(space: H1) -> tuple[FloatArray, FloatArray]:
        points, rows = ConductorPoints(space, mesh.actuator, moving.reference), patterns.rows
        if mesh != patterns.mesh:
            of_patterns = conductor_points(patterns.mesh)
            rows = points.rows_of(_pattern_fields(patterns), of_patterns.space, of_patterns.distance)
        return points.loads(rows), points.loads(rows, moving=True)

    return SourceFields(moving, mesh.actuator, mesh.settings.order, loads)
