"""What a step's voltages make of the currents, as a table over the distance, where iron does not saturate.

Of w' = r - L^-1 R (w - w_0) the step needs f1(M) L^-1, f2(M) L^-1 and f3(M) L^-1, see :mod:`femfit.model.decay`. Where
L depends on the distance alone, they are smooth symmetric matrices of it: polynomials on cells that are halved until
these hold to :data:`ERROR`. Beyond the table the matrices at its ends hold.
"""

from collections.abc import Callable
from functools import cache

import casadi as ca
import numpy as np
from casadi import SX
from numpy.polynomial import chebyshev

from femfit.core.graph import GraphFunction, building, row_of
from femfit.core.numerics import FloatArray
from femfit.model.bspline import polynomial
from femfit.model.decay import shares

DEGREE = 8
"""Measured: fewest operations for the error."""

ERROR, MOST_HALVINGS = 1e-11, 14
"""Numerical: largest error of an entry over its largest value, and how often a cell is halved for it."""


BEYOND, PLACES, LEAST_LEFT = 0.5, 101, 0.1
"""Chosen: part of the stroke by which a table reaches beyond the domain where the least eigenvalue of the inductances
keeps a tenth of what it is at the end, and places at which that is looked for."""


class ResponseTable:
    """f1(M) L^-1, f2(M) L^-1 and f3(M) L^-1 over the distance, for one step.

    Parameters
    ----------
    inductance : callable
        Distances (N,) -> L (N, m, m) in H.
    domain : (float, float)
        Least and largest distance in m of the model; the table reaches beyond it as far as L is positive definite.
    """

    def __init__(
        self,
        inductance: Callable[[FloatArray], FloatArray],
        resistances: FloatArray,
        step: float,
        domain: tuple[float, float],
    ) -> None:
        ends = _ends(inductance, domain)
        self._count = len(resistances)
        nodes = np.cos(np.pi * (np.arange(DEGREE + 1) + 0.5) / (DEGREE + 1))
        between = np.cos(np.pi * np.arange(1, DEGREE + 1) / (DEGREE + 1))
        fit = np.linalg.inv(chebyshev.chebvander(nodes, DEGREE))
        powers = np.array([np.pad(chebyshev.cheb2poly(row), (0, DEGREE))[: DEGREE + 1] for row in np.eye(DEGREE + 1)])
        scale = np.abs(_responses(inductance(np.linspace(*ends, 9)), resistances, step)).max(axis=0)
        waiting, cells = [(*ends, 0)], []
        while waiting:
            low, high, depth = waiting.pop()
            middle, half = 0.5 * (low + high), 0.5 * (high - low)
            at = np.concatenate([nodes, between])
            values = _responses(inductance(middle + half * at), resistances, step)
            coefficients = fit @ values[: DEGREE + 1]
            error = np.abs(chebyshev.chebvander(between, DEGREE) @ coefficients - values[DEGREE + 1 :]) / scale
            if error.max() > ERROR and depth < MOST_HALVINGS:
                waiting += [(middle, high, depth + 1), (low, middle, depth + 1)]  # the lower one comes next
            else:
                cells.append((low, np.concatenate([[middle, 1.0 / half], (powers.T @ coefficients).T.ravel()])))
        self._borders = np.array([low for low, _ in cells[1:]])
        self._ends, self._table = ends, np.stack([row for _, row in cells])

    def at(self, distance: SX) -> list[SX]:
        """The three matrices at an expression's distance."""
        d = ca.fmin(ca.fmax(distance, self._ends[0]), self._ends[1])
        row = row_of(self._table, [self._borders], [d])
        x, polynomial_of = (d - row[0]) * row[1], polynomial((DEGREE + 1,))
        entries = [polynomial_of(coefficients, x) for coefficients in ca.vertsplit(row[2:], DEGREE + 1)]
        size = len(entries) // 3
        matrices = []
        for first in (0, size, 2 * size):
            matrix = SX.zeros(self._count, self._count)
            for value, j, k in zip(entries[first : first + size], *np.triu_indices(self._count), strict=True):
                matrix[int(j), int(k)] = matrix[int(k), int(j)] = value
            matrices.append(matrix)
        return matrices


def _ends(inductance: Callable[[FloatArray], FloatArray], domain: tuple[float, float]) -> tuple[float, float]:
    """How far the inductances are positive definite, up to a part of the stroke beyond either end."""
    width = BEYOND * (domain[1] - domain[0])
    found = []
    for end, outward in zip(domain, (-width, width), strict=True):
        places = end + outward * np.linspace(0.0, 1.0, PLACES)
        with np.errstate(all="ignore"):
            matrices = inductance(places)
        finite = np.isfinite(matrices).all(axis=(1, 2))
        least = np.linalg.eigvalsh(np.where(np.reshape(finite, (-1, 1, 1)), matrices, 0.0))[:, 0]
        poor = np.flatnonzero(least <= LEAST_LEFT * least[0])
        found.append(float(places[max(poor[0] - 1, 0) if len(poor) else -1]))
    return found[0], found[1]


@cache
def _shares_of() -> GraphFunction:
    with building():
        z = SX.sym("z")
        return GraphFunction([z], ca.vertcat(*shares(z)))


def _responses(inductance: FloatArray, resistances: FloatArray, step: float) -> FloatArray:
    """Entries (N, 3 m (m + 1) / 2) of the three matrices, each above its diagonal, row by row."""
    root = np.sqrt(resistances)
    times, modes = np.linalg.eigh(inductance / (root[:, None] * root))
    modes, z = modes / root[:, None], step / times
    of_modes = np.moveaxis(_shares_of()(z.reshape(1, -1)).reshape(3, *z.shape), 0, 1) / times[:, None]
    matrices = (modes[:, None] * of_modes[:, :, None]) @ np.swapaxes(modes, -1, -2)[:, None]
    rows, columns = np.triu_indices(len(resistances))
    return matrices[..., rows, columns].reshape(len(inductance), -1)
