"""The tasks of the harmonic part of a sweep, as workers solve them: probes of some distances, and forms of each."""

from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from femfit.core.numerics import FloatArray
from femfit.device.drawn_numbers import DrawnNumber
from femfit.device.parts import Actuator
from femfit.field.layout import Layout
from femfit.field.tolerance import SolverSettings

if TYPE_CHECKING:
    from femfit.field.eddy_probe import EddyActuator, PatternFields
    from femfit.field.moving_mesh import MovingMesh


@dataclass(frozen=True)
class EddyMesh:
    """What a mesh with skin layers is made from; picklable."""

    actuator: Actuator
    layout: Layout
    settings: SolverSettings
    distances: tuple[float, ...]  # Distances that share the mesh, m, ascending

    def moving(self) -> "MovingMesh":
        """The mesh, kept while this process's tasks stay in it."""
        return _moving(self)


@dataclass(frozen=True)
class Patterns:
    """Rows (q, points) of :class:`femfit.field.harmonic.ConductorPoints` of a mesh."""

    mesh: EddyMesh
    rows: FloatArray = field(compare=False)
    checksum: int  # Of the rows


@dataclass(frozen=True)
class ProbeTask:
    """Direct solutions at a distance; its result has ``transfers`` and ``braking``.

    Where asked for, ``coarse`` are the transfers one order lower; where it has ``shifts``, ``rows`` are induced
    currents at the reference mesh's points, with their ``weight`` and which ``material`` they flow in; where it has
    ``numbers``, ``slopes`` are what these change of the inductances.
    """

    mesh: EddyMesh
    reference: EddyMesh
    distance: float
    frequencies: tuple[float, ...]
    shifts: tuple[float, ...]
    coarse: bool
    numbers: tuple[DrawnNumber, ...] = ()
    bias: tuple[float, ...] = ()  # In A; where parts saturate

    @property
    def key(self) -> str:
        """Name among the tasks."""
        return f"probe {self.distance!r}"

    def result(self) -> dict[str, Any]:
        """Solve; nothing of it is written to the journal."""
        from femfit.field.eddy_probe import EddyProbe  # noqa: PLC0415  the field solver loads in the workers only

        moving, order = self.mesh.moving(), self.mesh.settings.order
        actuator, frequencies = self.mesh.actuator, np.array(self.frequencies)
        probe = EddyProbe(actuator, moving, self.distance, order, self.bias)
        transfers, fields = probe.transfers(frequencies)
        result: dict[str, Any] = {"transfers": transfers, "braking": probe.braking()}
        if self.coarse:
            coarser = EddyProbe(actuator, moving, self.distance, order - 1, self.bias)
            result["coarse"] = coarser.transfers(frequencies)[0]
        if self.numbers:
            from femfit.field.signature_rows import ImpedanceSignatures  # noqa: PLC0415

            slopes = ImpedanceSignatures(actuator, self.numbers, moving, probe.points.space)
            result["slopes"] = slopes.at(self.distance, frequencies, fields)
        if not self.shifts:
            return result
        places = probe.points if self.reference == self.mesh else _points(self.reference)
        rows = probe.patterns(fields, np.array(self.shifts), places, actuator.eddy_error)
        return result | {"rows": rows, "weight": places.weight, "material": places.material_rows}


@dataclass(frozen=True)
class FormsTask:
    """The forms of all sources at a distance; its result has ``force``, ``flux_linkage`` and ``hall`` as lists."""

    mesh: EddyMesh
    distance: float
    patterns: Patterns
    bias: tuple[float, ...] = ()  # In A; where parts saturate

    @property
    def key(self) -> str:
        """Name in the journal."""
        return f"eddy currents {self.patterns.checksum:08x} {self.distance!r}"

    def result(self) -> dict[str, Any]:
        """Solve on the group's mesh."""
        forms = _actuator(self.mesh, self.patterns).forms(self.distance, self.bias)
        return {
            "force": forms.force.tolist(),
            "flux_linkage": forms.flux_linkage.tolist(),
            "hall": None if forms.hall is None else forms.hall.tolist(),
            "rest": None if forms.rest is None else forms.rest.tolist(),
        }


@lru_cache(maxsize=2)
def _moving(mesh: EddyMesh) -> "MovingMesh":
    from ngsolve import SetNumThreads  # noqa: PLC0415

    from femfit.field.moving_mesh import MovingMesh  # noqa: PLC0415

    SetNumThreads(1)
    return MovingMesh(mesh.actuator, mesh.distances, mesh.layout, mesh.settings)


@lru_cache(maxsize=1)
def _points(mesh: EddyMesh) -> Any:
    from ngsolve import H1  # noqa: PLC0415

    from femfit.field.harmonic import ConductorPoints  # noqa: PLC0415

    moving = mesh.moving()
    return ConductorPoints(H1(moving.mesh, order=mesh.settings.order), mesh.actuator, moving.reference)


@lru_cache(maxsize=1)
def _fields(patterns: Patterns) -> "PatternFields":
    from femfit.field.eddy_probe import PatternFields  # noqa: PLC0415

    mesh = patterns.mesh
    return PatternFields(mesh.actuator, mesh.moving(), mesh.settings.order, patterns.rows)


@lru_cache(maxsize=1)
def _actuator(mesh: EddyMesh, patterns: Patterns) -> "EddyActuator":
    from femfit.field.eddy_probe import EddyActuator  # noqa: PLC0415

    return EddyActuator(mesh.actuator, mesh.moving(), _fields(patterns), mesh.settings.order)


def principal(products: FloatArray, tolerance: float) -> FloatArray:
    """Factors (q, k) of principal components of k rows by their products (k, k), the largest power first.

    What is left out of all rows together has less than the tolerance's square of their power.
    """
    powers, directions = np.linalg.eigh(products)
    retained = np.cumsum(np.maximum(powers, 0.0)) > tolerance**2 * powers.sum()
    return np.asarray(directions[:, retained].T[::-1])
