"""What the field says of induced currents: their patterns as windings at each distance, as ``eddy.npz``.

Every pattern is a short-circuited winding of 1 ohm, orthogonal to the others in power. At each distance force, flux
linkages and Hall field are forms in the sources s = (1, i_1 .. i_n, e_1 .. e_q), F = s . force s among them.
At rest and j omega, 0 = (1 + j omega N) e + j omega m i with the inductances N among the patterns and m with circuits.

``impedance.csv`` says what an ampere does at each distance, bias and frequency, with an error in each row. Windings'
impedances are R + j omega L; the force and the Hall element's field of a small current about the bias are complex, as
real part and imaginary part. Errors are relative, of the largest of all circuits: estimates of what the patterns of
induced current leave out and of the discretisation.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from femfit.core.files import read_arrays, replacing
from femfit.core.numerics import LARGEST, ComplexArray, FloatArray, IntArray
from femfit.core.sweep_columns import current_columns, inductance_columns, resistance_column
from femfit.core.text import amount, counted

if TYPE_CHECKING:
    import pandas as pd

NAME = "eddy.npz"


@dataclass(frozen=True, eq=False)
class Transfers:
    """What 1 A at each frequency does at a held distance; m = 1 + n sources, the magnets and the circuits.

    Parameters
    ----------
    frequencies_Hz : array, shape (f,)
    flux_linkage : array, shape (f, n, n)
        In H: of circuit j by 1 A in circuit k.
    force : array, shape (f, m, n)
        In N/A: what 1 A in circuit k adds to the force beside the magnets, or 1 A, of each source at rest.
    hall : array, shape (f, n), or None
        In T/A.
    """

    frequencies_Hz: FloatArray
    flux_linkage: ComplexArray
    force: ComplexArray
    hall: ComplexArray | None

    def departures(self, exact: "Transfers") -> FloatArray:
        """Of impedance, force and Hall field (0 without one) at each frequency, relative to exact ones; (f, 3).

        Each relative to the largest of all pairs of circuits, and to what the force by each source alone would be.
        """
        pairs = [(self.flux_linkage, exact.flux_linkage), (self.force, exact.force)]
        if self.hall is not None and exact.hall is not None:
            pairs.append((self.hall, exact.hall))
        result = np.zeros((len(self.frequencies_Hz), 3))
        for k, (response, reference) in enumerate(pairs):
            size = np.abs(reference).reshape(len(reference), -1).max(axis=1, initial=0.0)
            off = np.abs(response - reference).reshape(len(reference), -1).max(axis=1, initial=0.0)
            result[:, k] = np.divide(off, size, out=np.zeros_like(off), where=size > 0.0)
        return result


@dataclass(frozen=True, eq=False)
class EddyTable:
    """The patterns over a sweep; M = 1 + n + q.

    Parameters
    ----------
    circuits : tuple of str
    distances_m : array, shape (D,)
    frequencies_Hz : array
        Those that the drawing asks for.
    force : array, shape (D, M, M)
        Symmetric F in N: the force is s . F s.
    flux_linkage : array, shape (D, M - 1, M)
        Of circuits and patterns by a unit of each source, in Wb.
    hall : array, shape (D, M), or None
        Field at the Hall element by a unit of each source, in T.
    checked_Hz : array, shape (c,)
        Where the direct harmonic solutions were found at some distances.
    errors : array, shape (c, 3)
        Largest relative departures from them of impedance, force and Hall field, with the discretisation's.
    braking_error : float
        The same of the power that slow motion loses; NaN where none of these distances is in the table.
    materials : tuple of str
        Names of those that conduct.
    conductivities_S_per_m : array, shape (materials,)
    resistances : array, shape (materials, q, q)
        What each material adds to the patterns' resistances in ohm; they sum to one.
    asked_error : float
        Relative error that the drawing asks of its model.
    bias_A : array, shape (D, n), or None
        Where parts saturate: the circuits' currents about which all others are small. The source 1 is then the state at
        these currents, and of the force only the first row and column are known.
    rest : array, shape (D, M - 1), or None
        There: the flux linkages without any current, in Wb.
    """

    circuits: tuple[str, ...]
    distances_m: FloatArray
    frequencies_Hz: FloatArray
    force: FloatArray
    flux_linkage: FloatArray
    hall: FloatArray | None
    checked_Hz: FloatArray
    errors: FloatArray
    braking_error: float
    materials: tuple[str, ...]
    conductivities_S_per_m: FloatArray
    resistances: FloatArray
    asked_error: float
    bias_A: FloatArray | None = None
    rest: FloatArray | None = None

    @property
    def patterns(self) -> int:
        """Number of patterns q."""
        return int(self.force.shape[1]) - 1 - len(self.circuits)

    def __str__(self) -> str:
        low, high = (amount(float(value), "Hz") for value in self.checked_Hz[[0, -1]])
        within = amount(float(self.errors.max(initial=0.0)), "")
        patterns = counted(self.patterns, "pattern")
        text = f"eddy currents: {patterns}, within {within} of direct solutions from {low} to {high}"
        if self.bias_A is None or not self.bias_A.size:
            return text
        least, most = (amount(float(value), "A") for value in (self.bias_A.min(), self.bias_A.max()))
        return f"{text}, of small currents about {least if least == most else f'{least} to {most}'}"

    def induced(self, k: int, frequencies: FloatArray) -> ComplexArray:
        """Currents of the patterns for 1 A in each circuit at the k-th distance: -(1 + s N)^-1 s m, shape (f, q, n)."""
        c, flux = len(self.circuits), self.flux_linkage[k]
        s = 2j * np.pi * np.asarray(frequencies)[:, None, None]
        return np.asarray(-np.linalg.solve(np.eye(self.patterns) + s * flux[c:, 1 + c :], s * flux[c:, 1 : 1 + c]))

    def transfers(self, k: int, frequencies: FloatArray) -> Transfers:
        """What 1 A does at the k-th distance, with all patterns."""
        n, induced = 1 + len(self.circuits), self.induced(k, frequencies)
        force, flux = self.force[k], self.flux_linkage[k]
        return Transfers(
            np.asarray(frequencies),
            np.asarray(flux[: n - 1, 1:n] + flux[n - 1 :, 1:n].T @ induced),
            np.asarray(2.0 * (force[:n, 1:n] + force[:n, n:] @ induced)),
            None if self.hall is None else np.asarray(self.hall[k, 1:n] + self.hall[k, n:] @ induced),
        )

    def at(self, places: IntArray) -> "EddyTable":
        """The table at some of its distances."""
        over_distances = ("distances_m", "force", "flux_linkage", "hall", "bias_A", "rest")
        arrays = {name: getattr(self, name) for name in over_distances}
        return replace(self, **{name: array[places] for name, array in arrays.items() if array is not None})

    def combined(self, combinations: FloatArray) -> "EddyTable":
        """The table of orthonormal combinations (q, r) of the patterns."""
        n = 1 + len(self.circuits)
        turn = np.zeros((n + len(combinations), n + combinations.shape[1]))
        turn[:n, :n], turn[n:, n:] = np.eye(n), combinations
        return replace(
            self,
            force=turn.T @ self.force @ turn,
            flux_linkage=turn[1:, 1:].T @ self.flux_linkage @ turn,
            hall=None if self.hall is None else self.hall @ turn,
            rest=None if self.rest is None else self.rest @ turn[1:, 1:],
            resistances=combinations.T @ self.resistances @ combinations,
        )

    def conductivity_changes(self, material: int, k: int, frequencies: FloatArray) -> tuple[ComplexArray, ComplexArray]:
        """dZ/d(ln sigma) of a material at the k-th distance and d^2Z/d(ln sigma)^2 in ohm, shape (f, n, n) each.

        A larger sigma takes its share R_m off R in (R + s N) e = -s m i, so that dZ = -e^T R_m e with e of 1 A; with
        v = R_m e the second is e^T v - 2 v^T (R + s N)^-1 v.
        """
        e, c = self.induced(k, frequencies), len(self.circuits)
        s, v = 2j * np.pi * np.asarray(frequencies)[:, None, None], self.resistances[material] @ e
        moved = np.linalg.solve(np.eye(self.patterns) + s * self.flux_linkage[k][c:, 1 + c :], v)
        lost = e.swapaxes(1, 2) @ v
        return -lost, lost - 2.0 * v.swapaxes(1, 2) @ moved

    def error_at(self, frequencies: FloatArray) -> FloatArray:
        """Relative errors of impedance, force and Hall field at frequencies, shape (f, 3)."""
        logarithm = np.log(np.maximum(frequencies, self.checked_Hz[0]))
        return np.column_stack([np.interp(logarithm, np.log(self.checked_Hz), error) for error in self.errors.T])


def read_eddy(directory: Path) -> EddyTable | None:
    """Read ``eddy.npz``; None where there is nothing.

    Raises
    ------
    TableError
        If the file is damaged.
    """
    return read_arrays(directory / NAME, _of_arrays, "Sweep again.")


def _of_arrays(arrays: dict[str, Any]) -> EddyTable:
    names = {name: tuple(map(str, arrays[name])) for name in ("circuits", "materials")}
    numbers = {name: float(arrays[name]) for name in ("braking_error", "asked_error")}
    held: dict[str, Any] = {name: np.asarray(array, np.float64) for name, array in arrays.items() if name not in names}
    if damaged := [name for name, array in held.items() if not np.all(np.abs(array) < LARGEST)]:
        raise ValueError(f"{', '.join(damaged)} must hold finite numbers")
    table = EddyTable(**{"hall": None, **held, **names, **numbers})
    table.transfers(len(table.distances_m) - 1, table.checked_Hz)  # which arrays of other shapes do not have
    return table


IMPEDANCES = "impedance.csv"


def impedance_rows(
    table: EddyTable, currents: FloatArray, resistances_ohm: Sequence[float], series_H: Sequence[float]
) -> "pd.DataFrame":
    """Rows by distance, bias and frequency.

    Parameters
    ----------
    currents : array, shape (points, circuits)
        Bias currents in A; of a saturating actuator the table's own are taken.
    resistances_ohm, series_H : sequence of float
        Of each circuit: its resistance, and what is in series with it outside of the field.
    """
    import pandas as pd  # noqa: PLC0415  loads while the workers solve

    frames, circuits, frequencies = [], table.circuits, table.frequencies_Hz
    omega, errors = 2.0 * np.pi * frequencies, table.error_at(frequencies)
    named = [f"_{name}" if len(circuits) > 1 else "" for name in circuits]
    for k, distance in enumerate(table.distances_m):
        transfers = table.transfers(k, frequencies)
        impedances: dict[str, FloatArray] = {}
        for name, (row, column) in inductance_columns(circuits).items():
            inductance, diagonal = transfers.flux_linkage[:, row, column], row == column
            impedances[resistance_column(name)] = diagonal * resistances_ohm[row] - omega * inductance.imag
            impedances[name] = inductance.real + diagonal * series_H[row]
        for bias in currents if table.bias_A is None else table.bias_A[k, None]:
            about = bias if table.bias_A is None else np.zeros_like(bias)
            force = np.einsum("m,fmn->fn", np.concatenate([[1.0], about]), transfers.force)
            columns = {
                "distance_m": np.full(len(frequencies), distance),
                **dict(zip(current_columns(circuits), bias, strict=True)),
                "frequency_Hz": frequencies,
                **impedances,
            }
            for kind, unit, values in (("force", "N_per_A", force), ("hall", "T_per_A", transfers.hall)):
                for name, value in zip(named, () if values is None else values.T, strict=values is not None):
                    columns |= {f"{kind}{name}_real_{unit}": value.real, f"{kind}{name}_imag_{unit}": value.imag}
            columns |= {"impedance_error": errors[:, 0], "force_error": errors[:, 1]}
            columns |= {} if transfers.hall is None else {"hall_error": errors[:, 2]}
            frames.append(pd.DataFrame(columns))
    return pd.concat(frames, ignore_index=True)


def write_impedance(rows: "pd.DataFrame | None", directory: Path) -> None:
    """Write ``impedance.csv``, or remove that of an earlier sweep where there are no rows."""
    if rows is None or rows.empty:
        (directory / IMPEDANCES).unlink(missing_ok=True)
        return
    with replacing(directory / IMPEDANCES) as partial:
        rows.to_csv(partial, index=False)
