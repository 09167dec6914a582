"""The inverse of a sum of condensed forms.

The air's form changes with the distance, those of parts do not, since parts move as rigid bodies. Inner unknowns are
condensed element by element, so the condensed form of the whole is the sum of the air's, assembled once a distance, and
the parts', assembled once a mesh; the same air serves the field of the moving part alone in free space. From one
distance to the next the elimination order is kept.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from ngsolve import H1, BilinearForm, GridFunction, dx

from femfit.core.arrays import FloatArray, IntArray


class SummedInverse:
    """The inverse of a sum of condensed forms on regions of their own; renewals keep the elimination order.

    Parameters
    ----------
    space : ngsolve.H1
        Of the forms, which must be symmetric and condensed.
    """

    def __init__(self, space: H1) -> None:
        self._space = space
        self._parts: Sequence[BilinearForm] = ()
        w, v = space.TnT()
        whole = BilinearForm(w * v * dx, symmetric=True, condense=True).Assemble()  # cheap, for the sum's pattern
        self._keys = _entry_keys(whole)
        self._places: list[IntArray] = []
        self._matrix = whole.mat
        self._inverse: Any = None
        self._load, self._solution = (GridFunction(self._space).vec for _ in range(2))

    def renew(self, parts: Sequence[BilinearForm]) -> None:
        """Sum and factorise.

        Parameters
        ----------
        parts : sequence of ngsolve.BilinearForm
            Assembled, on disjoint regions; on the same ones, in the same order, at every renewal.
        """
        self._parts = parts
        values = self._matrix.AsVector().FV().NumPy()
        values[:] = 0.0
        if not self._places:
            self._places = [np.searchsorted(self._keys, _entry_keys(part)) for part in parts]
        for part, places in zip(parts, self._places, strict=True):
            values[places] += part.mat.AsVector().FV().NumPy()
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


def _entry_keys(form: BilinearForm) -> IntArray:
    """Row and column of each stored entry as one ascending number."""
    _, columns, starts = (np.array(part).astype(np.int64) for part in form.mat.CSR())
    rows = np.repeat(np.arange(len(starts) - 1), np.diff(starts))
    return np.asarray(rows * form.space.ndof + columns)
