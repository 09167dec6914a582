"""The tasks of the harmonic part of a sweep, as workers solve them: probes of some distances, and forms of each."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from femfit.core.numerics import FloatArray
from femfit.device.drawn_numbers import DrawnNumber
from femfit.field.sweep_task import MeshGroup


@dataclass(frozen=True)
class Patterns:
    """Rows (q, points) of :class:`femfit.field.harmonic.ConductorPoints` of a mesh."""

    mesh: MeshGroup
    rows: FloatArray = field(compare=False)
    checksum: int  # Of the rows


@dataclass(frozen=True)
class ProbeTask:
    """Direct solutions at a distance; its result has ``transfers`` and ``braking``.

    Where asked for, ``coarse`` are the transfers one order lower; where it has ``shifts``, ``rows`` are induced
    currents at the reference mesh's points, with their ``weight`` and which ``material`` they flow in; where it has
    ``numbers``, ``slopes`` are what these change of the inductances.
    """

    mesh: MeshGroup
    reference: MeshGroup
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
        from femfit.field import eddy_probe  # noqa: PLC0415  the field solver loads in the workers only

        moving, order = eddy_probe.moving_mesh(self.mesh), self.mesh.settings.order
        actuator, frequencies = self.mesh.actuator, np.array(self.frequencies)
        probe = eddy_probe.EddyProbe(actuator, moving, self.distance, order, self.bias)
        transfers, fields = probe.transfers(frequencies)
        result: dict[str, Any] = {"transfers": transfers, "braking": probe.braking()}
        if self.coarse:
            coarser = eddy_probe.EddyProbe(actuator, moving, self.distance, order - 1, self.bias)
            result["coarse"] = coarser.transfers(frequencies)[0]
        if self.numbers:
            result["slopes"] = probe.slopes(self.numbers, frequencies, fields)
        if not self.shifts:
            return result
        places = probe.points if self.reference == self.mesh else eddy_probe.conductor_points(self.reference)
        rows = probe.patterns(fields, np.array(self.shifts), places, actuator.eddy_error)
        return result | {"rows": rows, "weight": places.weight, "material": places.material_rows}


@dataclass(frozen=True)
class FormsTask:
    """The forms of all sources at a distance; its result has ``force``, ``flux_linkage`` and ``hall`` as lists."""

    mesh: MeshGroup
    distance: float
    patterns: Patterns
    bias: tuple[float, ...] = ()  # In A; where parts saturate

    @property
    def key(self) -> str:
        """Name in the journal."""
        return f"eddy currents {self.patterns.checksum:08x} {self.distance!r}"

    def result(self) -> dict[str, Any]:
        """Solve on the group's mesh."""
        from femfit.field import eddy_probe  # noqa: PLC0415  the field solver loads in the workers only

        forms = eddy_probe.eddy_actuator(self.mesh, self.patterns).forms(self.distance, self.bias)
        arrays = {name: getattr(forms, name) for name in ("force", "flux_linkage", "hall", "rest")}
        return {name: None if array is None else array.tolist() for name, array in arrays.items()}


def principal(products: FloatArray, tolerance: float) -> FloatArray:
    """Factors (q, k) of principal components of k rows by their products (k, k), the largest power first.

    What is left out of all rows together has less than the tolerance's square of their power.
    """
    powers, directions = np.linalg.eigh(products)
    retained = np.cumsum(np.maximum(powers, 0.0)) > tolerance**2 * powers.sum()
    return np.asarray(directions[:, retained].T[::-1])
