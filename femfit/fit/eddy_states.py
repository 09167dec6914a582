r"""Which combinations of a sweep's patterns of induced currents a model keeps.

The patterns of a sweep are many, so as to hold the field to a fraction of the error that is asked for. A model keeps r
orthonormal combinations of them, T, the same at all distances: N -> T^T N T stays symmetric positive definite, and the
resistances stay one, so that the model stays passive. T is found by least squares of what the model is for: impedance,
force and Hall field of an ampere over the frequencies, and the force of motion, each at some distances. The
number r is the smallest that meets the error at all of them.

What the combinations add to the Hall field is a reading, which no energy depends on. It need not be T^T of what the
patterns add, and follows by linear least squares of the responses at each distance: so 8 states do on a solid pot
magnet where 9 would not.

References
----------
S. Gugercin, A. C. Antoulas and C. Beattie, SIAM J. Matrix Anal. Appl. 30 (2008) 609: optimal reduced models as
projections.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from femfit.core.numerics import ComplexArray, FloatArray, evenly_spread
from femfit.fit.constants import EDDY_DISTANCES, EDDY_FEWER, EDDY_LOOSER, EDDY_POWERS, EDDY_SINGULAR, EDDY_STEPS
from femfit.tables.eddy_table import EddyTable


@dataclass(frozen=True, eq=False)
class _Place:
    """One distance: what the patterns do there, and what all of them together do at the frequencies."""

    s: ComplexArray  # 2 pi j f, and zero before, shape (f,)
    among: FloatArray  # N, shape (q, q)
    outputs: FloatArray  # What each pattern gives to flux linkages, forces and Hall field, shape (q, k)
    driven: FloatArray  # What drives each pattern: flux linkages with the circuits and, by motion, the pull; (q, l)
    size: FloatArray  # Of each response at each frequency, shape (f, k, l)
    target: ComplexArray  # The responses; shape (f, k, l)
    has_hall: bool  # Whether the last of k, the Hall field, does not follow from the energy

    def departures(self, combinations: FloatArray) -> ComplexArray:
        """Of the responses by combinations, over their sizes, shape (f, k, l)."""
        turned = np.linalg.qr(combinations)[0]
        responses = np.einsum("rk,frl->fkl", turned.T @ self.outputs, self._driven(turned))
        return np.asarray((responses - self.target) / self.size)

    def slopes(self, combinations: FloatArray) -> ComplexArray:
        """Of the departures along each entry of combinations T, shape (f, k, l, q, r).

        With the response S^T T A^-1 T^T D, A = T^T B T and B = 1 + s N, the change by dT is
        (S - B T Y)^T dT X + Y^T dT^T (D - B T X) with X = A^-1 T^T D and Y = A^-1 T^T S.
        """
        bent = combinations + self.s[:, None, None] * (self.among @ combinations)  # B T, (f, q, r)
        inner = combinations.T @ bent
        x, y = (np.linalg.solve(inner, (combinations.T @ side)[None]) for side in (self.driven, self.outputs))
        residual_outputs, residual_drive = self.outputs - bent @ y, self.driven - bent @ x
        slopes = np.einsum("fqk,frl->fklqr", residual_outputs, x) + np.einsum("frk,fql->fklqr", y, residual_drive)
        return np.asarray(slopes / self.size[..., None, None])

    def read(self, combinations: FloatArray) -> "_Place":
        """The same with the Hall field that fits best what orthonormal combinations (q, r) add to it."""
        if not self.has_hall:
            return self
        target, size = self.target[:, -1], self.size[:, -1]  # (f, l)
        moved = np.abs(target).max(axis=0, keepdims=True)  # of what motion drives
        size = np.where(np.isfinite(size), size, np.where(moved > 0.0, EDDY_LOOSER * moved, np.inf))
        rows = (self._driven(combinations).swapaxes(1, 2) / size[..., None]).reshape(-1, combinations.shape[1])
        outputs = combinations.T @ self.outputs[:, -1]
        off = (target / size).ravel() - rows @ outputs
        real = np.concatenate([rows.real, rows.imag]), np.concatenate([off.real, off.imag])
        outputs += np.linalg.lstsq(*real, rcond=EDDY_SINGULAR)[0]
        return replace(self, outputs=np.column_stack([self.outputs[:, :-1], combinations @ outputs]))

    def _driven(self, turned: FloatArray) -> ComplexArray:
        """(1 + s T^T N T)^-1 T^T D, shape (f, r, l)."""
        rates, vectors = np.linalg.eigh(turned.T @ self.among @ turned)
        gain = 1.0 / (1.0 + self.s[:, None] * rates)
        return np.asarray(vectors @ (gain[..., None] * (vectors.T @ turned.T @ self.driven)))


class StateChoice:
    """The problem of the module's head."""

    def __init__(self, table: EddyTable, frequencies: FloatArray) -> None:
        self._table, self._s = table, 2j * np.pi * np.concatenate([[0.0], frequencies])
        self._places = [self._place(k) for k in range(len(table.distances_m))]

    def table(self, error: float) -> EddyTable:
        """Of the fewest combinations that meet a relative error; of all patterns where none does."""
        combinations = self._combinations(error)
        table = self._table.combined(combinations)
        if table.hall is None:
            return table
        hall = [place.read(combinations).outputs[:, -1] @ combinations for place in self._places]
        return replace(table, hall=np.concatenate([table.hall[:, : -combinations.shape[1]], hall], axis=1))

    def error(self, combinations: FloatArray) -> float:
        """The largest relative departure at any distance and frequency, of orthonormal combinations."""
        departures = (place.read(combinations).departures(combinations) for place in self._places)
        return float(max(np.abs(place).max(initial=0.0) for place in departures))

    def _combinations(self, error: float) -> FloatArray:
        """T, shape (q, r)."""
        unit = np.eye(self._table.patterns)
        if len(unit) == 1:
            return unit
        plain = (count for count in range(1, len(unit)) if self.error(unit[:, :count]) <= error)
        most = next(plain, len(unit))
        count = max(1, round(EDDY_FEWER * most))
        optimal = map(self._optimal, range(count, max(most, count + 1)))
        best = next((combinations for combinations in optimal if self.error(combinations) <= error), unit[:, :most])
        fewest = best.shape[1]
        while 1 < fewest <= count and self.error(fewer := self._optimal(fewest - 1)) <= error:
            best, fewest = fewer, fewest - 1
        return best

    def _optimal(self, count: int) -> FloatArray:
        """So many combinations with the least squares of the departures, then of their third powers."""
        chosen = [self._places[k] for k in evenly_spread(len(self._places), EDDY_DISTANCES)]
        frame = np.eye(self._table.patterns)
        for power in EDDY_POWERS:
            basis, complement = frame[:, :count], frame[:, count:]
            read = [place.read(basis) for place in chosen]
            frame = np.linalg.qr(basis + complement @ self._better(read, basis, complement, power), mode="complete")[0]
        return frame[:, :count]

    def _better(self, places: Sequence[_Place], basis: FloatArray, complement: FloatArray, power: int) -> FloatArray:
        """X, of combinations basis + complement X with the least squares of the departures' power."""
        shape = complement.shape[1], basis.shape[1]

        def both(values: Sequence[ComplexArray]) -> FloatArray:
            flat = np.concatenate([place.reshape(-1, *place.shape[3:]) for place in values])
            return np.concatenate([flat.real, flat.imag])

        def departures(x: FloatArray) -> FloatArray:
            return both([place.departures(basis + complement @ x.reshape(shape)) for place in places]) / scale

        def residuals(x: FloatArray) -> FloatArray:
            off = departures(x)
            return np.asarray(off * np.abs(off) ** (power - 1))

        def jacobian(x: FloatArray) -> FloatArray:
            slopes = (
                both([complement.T @ place.slopes(basis + complement @ x.reshape(shape)) for place in places]) / scale
            )
            return np.asarray(power * np.abs(departures(x))[:, None] ** (power - 1) * slopes.reshape(len(slopes), -1))

        x, scale = np.zeros(shape).ravel(), 1.0
        scale = float(np.abs(departures(x)).max()) or 1.0
        return np.asarray(least_squares(residuals, x, jacobian, max_nfev=EDDY_STEPS).x.reshape(shape))

    def _place(self, k: int) -> _Place:
        table, n = self._table, 1 + len(self._table.circuits)
        flux, pull = table.flux_linkage[k], 2.0 * table.force[k, :n, n:].T
        hall = np.zeros((table.patterns, 0)) if table.hall is None else table.hall[k, n:, None]
        linked = flux[: n - 1, n:].T
        outputs, driven = np.concatenate([linked, pull, hall], axis=1), np.concatenate([linked, pull], axis=1)
        among = flux[n - 1 :, n:]
        rates, vectors = np.linalg.eigh(0.5 * (among + among.T))
        gain = 1.0 / (1.0 + self._s[:, None] * rates)
        target = np.einsum("rk,fr,rl->fkl", vectors.T @ outputs, gain, vectors.T @ driven)
        return _Place(self._s, among, outputs, driven, self._sizes(k, target), target, table.hall is not None)

    def _sizes(self, k: int, target: FloatArray) -> FloatArray:
        """What departures are relative to: the whole response to a current, and that to motion when it is slow."""
        table, n = self._table, 1 + len(self._table.circuits)
        size = np.full(target.shape, np.inf)
        whole = table.transfers(k, self._s.imag / (2.0 * np.pi))
        responses = [whole.flux_linkage, whole.force, *([] if whole.hall is None else [whole.hall[:, None]])]
        factor = np.abs(self._s)[:, None, None]
        for response, first in zip(responses, (0, n - 1, 2 * n - 1), strict=False):
            largest = np.abs(response).max(axis=(1, 2), initial=0.0, keepdims=True)
            kind = slice(first, first + response.shape[1])
            size[:, kind, : n - 1] = np.divide(largest, factor, out=np.full_like(largest, np.inf), where=factor > 0.0)
        slow = np.abs(target[0, n - 1 : 2 * n - 1, n - 1 :]).max(initial=0.0)
        if slow > 0.0:
            size[:, n - 1 : 2 * n - 1, n - 1 :] = slow
        size[size == 0.0] = np.inf
        return size
