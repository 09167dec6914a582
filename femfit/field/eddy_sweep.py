"""The harmonic part of a sweep: patterns of induced currents, and what they do at every distance.

Some distances are probed first; the patterns that they have in common serve the whole stroke. Direct harmonic solutions
there, and at distances between, say how far the patterns are off.
"""

import math
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from femfit.core.errors import FieldSolverError, TableError
from femfit.core.files import read_arrays, write_arrays
from femfit.core.journal import Journal
from femfit.core.numerics import ComplexArray, FloatArray, evenly_spread
from femfit.device.drawn_numbers import DrawnNumber
from femfit.device.parts import Actuator
from femfit.field.sweep_task import AGAIN, FormsTask, MeshGroup, Patterns, ProbeTask, Solve, mesh_groups
from femfit.field.tolerance import SolverSettings
from femfit.tables.eddy_table import EddyTable, Transfers
from femfit.tables.signatures import ImpedanceSlopes

ORDER = 4
"""Numerical: polynomial order; the elements' layers resolve the skin with it (:mod:`femfit.field.harmonic`)."""

PROBES, CHECKS = 5, 2
"""Numerical: distances whose induced currents the patterns are made of, and such between them where these are held
against the direct solution; on a pot over a tenfold gap the patterns of five are 0.05 % off at all others."""

PER_DECADE, MOST_FREQUENCIES, MOST_SHIFTS = 2, 9, 4
"""Numerical: of direct solutions over the range of frequencies, at most so many; and of real shifts beside them."""

SHIFTS_BEYOND = 3.0  # of the lowest and the highest frequency, to either side

LOWEST_HZ = 1e-3  # of frequencies that are solved for

PATTERNS_NAME = "eddy_patterns.npz"


def eddy_sweep(
    actuator: Actuator,
    journal: Journal,
    file: Path,
    key: str,
    solve: Solve,
    numbers: tuple[DrawnNumber, ...] = (),
    biases: Mapping[float, tuple[float, ...]] | None = None,
) -> tuple[EddyTable, ImpedanceSlopes | None]:
    """Solve what the journal does not have of the induced currents of an actuator that has any.

    With numbers of the drawing, what they change of the inductances comes from the probes' fields.

    A distance that cannot be meshed or solved is left out.

    Parameters
    ----------
    file : Path
        Where the patterns are kept for a sweep that goes on later, with a key that is theirs.
    biases : mapping, or None
        The currents in A, by distance, about which the fields of saturating parts are small.

    Raises
    ------
    FieldSolverError
        If no distance can be solved.
    """
    biases, numbers, distances = biases or {}, () if actuator.saturates else numbers, actuator.sweep.distances_m
    highest = max(actuator.frequencies_Hz[-1], LOWEST_HZ)
    meshes = mesh_groups(actuator, SolverSettings(order=ORDER, skin_frequency_Hz=highest))
    probes = [distances[k] for k in evenly_spread(len(distances), PROBES)]
    reference = meshes[probes[len(probes) // 2]]
    probed = _read(file, key)
    if probed is None:
        probed = _probe(meshes, probes, reference, solve, numbers, biases)
        write_arrays(vars(probed) | {"key": key}, file)
    patterns = Patterns(reference, probed.rows, zlib.crc32(probed.rows.tobytes()))
    tasks = [FormsTask(meshes[d], d, patterns, biases.get(d, ())) for d in distances]
    unsolved = [task for task in tasks if journal.finished.get(task.key, {AGAIN: True}).get(AGAIN)]
    solve(unsolved, lambda task, result: journal.record(task.key, result))
    results = {task.distance: journal.finished[task.key] for task in tasks}
    solved = {distance: result for distance, result in results.items() if result["status"] == "ok"}
    if not solved:
        raise FieldSolverError(_reason(next(iter(results.values()))))
    columns: dict[str, Any] = {}
    for name in ("force", "flux_linkage", "hall", "rest"):
        column = [result[name] for result in solved.values()]
        columns[name] = None if column[0] is None else np.array(column)
    conductivities = {  # in the order of the points' materials
        region.material.name: region.material.conductivity_S_per_m
        for region in actuator.regions
        if region.material.conductivity_S_per_m
    }
    table = EddyTable(
        circuits=tuple(circuit.name for circuit in actuator.circuits),
        distances_m=np.array(list(solved)),
        frequencies_Hz=np.array(actuator.frequencies_Hz),
        checked_Hz=probed.frequencies,
        errors=probed.discretisation,
        braking_error=np.nan,
        materials=tuple(conductivities),
        conductivities_S_per_m=np.array([*conductivities.values()]),
        resistances=probed.resistances,
        asked_error=actuator.eddy_error,
        bias_A=np.array([biases[d] for d in solved]) if actuator.saturates else None,
        **columns,
    )
    errors, braking_error = probed.errors(table)
    facts = tuple(number.facts for number in numbers)
    slopes = ImpedanceSlopes(facts, probed.distances, table.checked_Hz, probed.slopes) if facts else None
    return replace(table, errors=errors, braking_error=braking_error), slopes


def induces(actuator: Actuator) -> bool:
    """Whether frequencies are asked for, and a part conducts."""
    conducts = any(region.material.conductivity_S_per_m for region in actuator.regions)
    return bool(actuator.frequencies_Hz) and conducts


@dataclass(frozen=True, eq=False)
class _Probed:
    """The patterns, and P direct solutions to hold them against."""

    rows: FloatArray  # Of :class:`Patterns`
    resistances: FloatArray  # What each conducting material adds to the patterns' resistances, shape (materials, q, q)
    distances: FloatArray  # Shape (P,)
    frequencies: FloatArray  # Shape (f,)
    flux_linkage: ComplexArray  # Of :class:`Transfers`, as the next two; shape (P, f, n, n)
    force: ComplexArray
    hall: ComplexArray | None
    discretisation: FloatArray  # Relative change from one order lower, shape (f, 3): the largest of all
    braking: FloatArray  # Shape (P, m, m)
    slopes: ComplexArray  # Of :class:`ImpedanceSlopes`, shape (numbers, P, f, n, n)

    def errors(self, table: EddyTable) -> tuple[FloatArray, float]:
        """The table's ``errors`` and ``braking_error``."""
        departures, braked = [np.zeros_like(self.discretisation)], [np.nan]
        n = 1 + len(table.circuits)
        for k, (distance, braking) in enumerate(zip(self.distances, self.braking, strict=True)):
            hall = None if self.hall is None else self.hall[k]
            exact = Transfers(self.frequencies, self.flux_linkage[k], self.force[k], hall)
            for place in np.flatnonzero(table.distances_m == distance):
                departures.append(table.transfers(int(place), self.frequencies).departures(exact))
                pull = table.force[place, :n, n:]
                braked.append(np.abs(4.0 * pull @ pull.T - braking).max() / np.abs(braking).max())
        return self.discretisation + np.max(departures, axis=0), float(np.fmax.reduce(braked))


def _probe(
    meshes: Mapping[float, MeshGroup],
    probes: Sequence[float],
    reference: MeshGroup,
    solve: Solve,
    numbers: tuple[DrawnNumber, ...],
    biases: Mapping[float, tuple[float, ...]],
) -> _Probed:
    """Solve the probes, and some between them to check by, and find the patterns that the probes have in common."""
    low, high = (max(reference.actuator.frequencies_Hz[end], LOWEST_HZ) for end in (0, -1))
    between = [d for d in meshes if d not in probes]
    checks = [between[k] for k in evenly_spread(len(between), CHECKS)]
    beyond = _decades(low / SHIFTS_BEYOND, high * SHIFTS_BEYOND, MOST_SHIFTS)
    shifts = tuple(2.0 * math.pi * frequency for frequency in beyond)
    frequencies, tasks, results = _decades(low, high, MOST_FREQUENCIES), [], dict[float, dict[str, Any]]()
    for d in (*probes, *checks):
        coarse, own_shifts = d == probes[0] or d in checks, shifts if d in probes else ()
        tasks.append(ProbeTask(meshes[d], reference, d, frequencies, own_shifts, coarse, numbers, biases.get(d, ())))
    solve(tasks, lambda task, result: results.update({task.distance: result}))
    solved = {task.distance: results[task.distance] for task in tasks if results[task.distance]["status"] == "ok"}
    made = [result for result in solved.values() if "rows" in result]
    if not made:
        raise FieldSolverError(_reason(results[probes[0]]))
    weight, rows = made[0]["weight"], np.concatenate([result["rows"] for result in made])
    basis = principal((weight * rows) @ rows.T, reference.actuator.eddy_error) @ rows
    discretisation = [np.zeros((len(frequencies), 3))]
    discretisation += [r["coarse"].departures(r["transfers"]) for r in solved.values() if "coarse" in r]
    rows = basis / np.sqrt((weight * basis**2).sum(axis=1))[:, None]
    inside = np.arange(made[0]["material"].max() + 1)[:, None] == made[0]["material"]
    exact = [result["transfers"] for result in solved.values()]
    return _Probed(
        rows,
        np.array([(weights * weight * rows) @ rows.T for weights in inside]),
        np.array(list(solved)),
        exact[0].frequencies_Hz,
        np.array([transfer.flux_linkage for transfer in exact]),
        np.array([transfer.force for transfer in exact]),
        None if exact[0].hall is None else np.array([transfer.hall for transfer in exact]),
        np.max(discretisation, axis=0),
        np.array([result["braking"] for result in solved.values()]),
        np.array([result.get("slopes", ()) for result in solved.values()]).swapaxes(0, 1),
    )


def _decades(low: float, high: float, most: int) -> tuple[float, ...]:
    """Frequencies from low to high, equally spaced in their logarithm."""
    count = min(most, 1 + math.ceil(PER_DECADE * math.log10(high / low)))
    return tuple(np.geomspace(low, high, count).tolist())


def _reason(result: dict[str, Any]) -> str:
    return f"The field of induced currents could not be solved: {result['status'].removeprefix('failed: ')}"


def _read(file: Path, key: str) -> _Probed | None:
    """What was kept under this key; None where there is nothing that is whole."""

    def made(held: dict[str, Any]) -> _Probed | None:
        return _Probed(**{"hall": None, **held}) if str(held.pop("key")) == key else None

    try:
        return read_arrays(file, made, "")
    except TableError:
        return None


def principal(products: FloatArray, tolerance: float) -> FloatArray:
    """Factors (q, k) of principal components of k rows by their products (k, k), the largest power first.

    What is left out of all rows together has less than the tolerance's square of their power.
    """
    powers, directions = np.linalg.eigh(products)
    retained = np.cumsum(np.maximum(powers, 0.0)) > tolerance**2 * powers.sum()
    return np.asarray(directions[:, retained].T[::-1])
