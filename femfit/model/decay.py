"""How far currents get within a step: the decay L w' = b + c t - R (w - w_0), at any stiffness.

w ends at w_0 + h (f1 L^-1 b + h f2 L^-1 c) and has the mean w_0 + h (f2 L^-1 b + h f3 L^-1 c); its integral's mean is
h (w_0 / 2 + h f3 L^-1 b + ..). All are of M = h L^-1 R, with f1(z) = (1 - exp(-z)) / z, f2(z) = (1 - f1(z)) / z and
f3(z) = (1/2 - f2(z)) / z. Of one winding that is said as it stands. Of several, exp(-z) = sum c_k / (-z - t_k) + .. of
Caratheodory and Fejer gives f_n by c_k / t_k^n with the same poles t_k, so that only the linear systems
(h R + t_k L) y = b are solved, which are regular for every positive R.

References
----------
L. N. Trefethen, J. A. C. Weideman and T. Schmelzer, BIT 46 (2006) 653, section 4: the approximation and its numbers.
T. Schmelzer and L. N. Trefethen, Electronic Transactions on Numerical Analysis 29 (2007) 1: f_n with its poles.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any, TypeAlias

import casadi as ca
import numpy as np
from casadi import SX
from numpy.polynomial.polynomial import polyfit, polyval
from numpy.typing import NDArray

from femfit.core.graph import GraphFunction, building, row_of, settled
from femfit.core.numerics import FloatArray
from femfit.model.bspline import polynomial

ComplexExpressions: TypeAlias = NDArray[Any]
"""An array of :class:`Complex`."""

SERIES_TERMS = 14
"""Derived: of f3 up to z = 1, where further ones are less than 1e-16 of it."""

POLES = {
    4.827494174587326 + 1.1939879377093998j: -11.799390212515666 - 46.41166620881087j,
    4.206124927739715 + 3.5909205906680715j: 18.785993226847545 + 20.2372960743366j,
    2.9178692532263377 + 6.017345628905333j: -8.2382622513838 - 2.796190995628886j,
    0.8517077579997216 + 8.503832410627936j: 1.3194123250131524 - 0.18352420676420697j,
    -2.2359676498900862 + 11.109295737044016j: -0.06857151701061659 + 0.03841913873466452j,
    -6.998687356007474 + 13.995916098133264j: 0.0008184336485926534 - 0.0005813543348441404j,
}
"""Numerical: poles t_k with their residues c_k, one of each conjugate pair; f1 is off by 1.6e-10, f2 by 2.6e-9
and f3 by 1.8e-8, at z = -1 all by 1e-6."""


def eliminated(matrix: SX, right: SX) -> SX:
    """A^-1 B of a small symmetric matrix whose pivots do not vanish, as an expression."""
    solution = _solved(_factored(_rows(matrix)), _rows(SX(right)))
    return ca.vertcat(*(ca.horzcat(*row) for row in solution))


def decayed(inductance: SX, resistances: SX, driving: SX, step: SX) -> tuple[SX, SX, SX]:
    """f1(M) L^-1 b, f2(M) L^-1 b and f3(M) L^-1 b of voltages b (m, k), each of their shape; of a symmetric R (m, m).

    The systems are solved by numbers that count as constant, and by one correction that is differentiated: of first
    derivatives exactly, at a fraction of what those of the elimination cost.
    """
    m, k = driving.shape
    if m == 1:
        rate = driving / inductance
        first, second, third = shares(step * resistances / inductance)
        return first * rate, second * rate, third * rate
    totals, right = [SX.zeros(m, k), SX.zeros(m, k), SX.zeros(m, k)], complex_array(driving)
    for pole, residue in POLES.items():
        matrix = complex_array(step * resistances + pole.real * inductance, pole.imag * inductance)
        factors = _factored(matrix)
        parts = [x for row in (*factors, *_solved(factors, right)) for x in row]
        numbers = settled(ca.vertcat(*(number for x in parts for number in (x.real, x.imag))))
        settled_numbers = iter([Complex(numbers[2 * n], numbers[2 * n + 1]) for n in range(len(parts))])
        factors = [[next(settled_numbers) for _ in row] for row in factors]
        solution = np.array([[next(settled_numbers) for _ in row] for row in right], dtype=object)
        solution = solution + np.array(_solved(factors, right - matrix @ solution), dtype=object)
        real = ca.reshape(ca.vertcat(*(x.real for x in solution.T.flat)), m, k)
        imag = ca.reshape(ca.vertcat(*(x.imag for x in solution.T.flat)), m, k)
        for n in range(3):
            weight = -2.0 * residue / pole ** (n + 1)
            totals[n] += weight.real * real - weight.imag * imag
    return totals[0], totals[1], totals[2]


def shares(z: SX) -> tuple[SX, SX, SX]:
    """f1, f2 and f3 of a number of either sign."""
    near = ca.fabs(z) < 1.0
    series, divisor = SX(1.0), ca.if_else(near, 1.0, z)
    for k in range(SERIES_TERMS + 3, 3, -1):
        series = 1.0 - z / k * series
    first = -ca.expm1(-z) / divisor
    third = ca.if_else(near, series / 6.0, (0.5 - (1.0 - first) / divisor) / divisor)
    second = ca.if_else(near, 0.5 - z * third, (1.0 - first) / divisor)
    return ca.if_else(near, 1.0 - z * second, first), second, third


def _rows(matrix: SX) -> list[list[Any]]:
    return [ca.horzsplit(row) for row in ca.vertsplit(matrix)]


def _factored(matrix: Any) -> list[list[Any]]:
    """U of a symmetric A = U^T D^-1 U with D the diagonal of U: from each row's diagonal on, without exchanges."""
    rows = [list(row[k:]) for k, row in enumerate(matrix)]
    for k, row in enumerate(rows):
        for j in range(1, len(row)):
            factor = row[j] / row[0]
            rows[k + j] = [a - factor * b for a, b in zip(rows[k + j], row[j:], strict=True)]
    return rows


def _solved(factors: list[list[Any]], right: Any) -> list[list[Any]]:
    """A^-1 B from the factors of A."""
    right = [list(row) for row in right]
    for k, row in enumerate(factors):
        for j in range(1, len(row)):
            factor = row[j] / row[0]
            right[k + j] = [a - factor * b for a, b in zip(right[k + j], right[k], strict=True)]
    for k, row in reversed(list(enumerate(factors))):
        for j in range(1, len(row)):
            right[k] = [a - row[j] * b for a, b in zip(right[k], right[k + j], strict=True)]
        right[k] = [a / row[0] for a in right[k]]
    return right


@dataclass(frozen=True, eq=False)
class Complex:
    """A complex number of two expressions; what it meets may be one of one expression, or a number."""

    real: SX
    imag: SX

    @classmethod
    def of(cls, value: Any) -> "Complex":
        """The same number, also out of an array without axes, or a real one."""
        value = value.item() if isinstance(value, np.ndarray) else value
        return value if isinstance(value, cls) else cls(SX(value), SX(0.0))

    def __add__(self, z: Any) -> "Complex":
        z = Complex.of(z)
        return Complex(self.real + z.real, self.imag + z.imag)

    def __sub__(self, z: Any) -> "Complex":
        return self + Complex.of(z) * -1.0

    def __neg__(self) -> "Complex":
        return self * -1.0

    def __mul__(self, z: Any) -> "Complex":
        z = Complex.of(z)
        return Complex(self.real * z.real - self.imag * z.imag, self.real * z.imag + self.imag * z.real)

    def __truediv__(self, z: Any) -> "Complex":
        z = Complex.of(z)
        size = z.real**2 + z.imag**2
        return Complex(
            (self.real * z.real + self.imag * z.imag) / size,
            (self.imag * z.real - self.real * z.imag) / size,
        )

    __radd__, __rmul__ = __add__, __mul__


def complex_array(matrix: SX, imag: SX | None = None) -> ComplexExpressions:
    """A matrix of expressions as an array of complex numbers, with which numpy multiplies matrices."""
    result = np.empty(matrix.shape, dtype=object)
    for place in np.ndindex(*matrix.shape):
        result[place] = Complex(matrix[place], SX(0.0) if imag is None else imag[place])
    return result


def solved(matrix: ComplexExpressions, right: ComplexExpressions) -> ComplexExpressions:
    """A^-1 B of small complex matrices, A symmetric with pivots that do not vanish."""
    return np.array(_solved(_factored(matrix), right), dtype=object)


DEGREE = 8
"""Measured: fewest operations for the error."""

ERROR, MOST_HALVINGS = 1e-11, 14
"""Numerical: largest error of an entry over its largest value, and how often a cell is halved for it."""


BEYOND, PLACES, LEAST_LEFT = 0.5, 101, 0.1
"""Chosen: part of the stroke by which a table reaches beyond the domain where the least eigenvalue of the inductances
keeps a tenth of what it is at the end, and places at which that is looked for."""


class ResponseTable:
    """What a step's voltages make of the currents, as a table over the distance, where iron does not saturate.

    Of w' = r - L^-1 R (w - w_0) a step needs f1(M) L^-1, f2(M) L^-1 and f3(M) L^-1. Where L depends on the distance
    alone, they are smooth symmetric matrices of it: polynomials on cells that are halved until these hold to
    :data:`ERROR`. Beyond the table the matrices at its ends hold.

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
        rows, columns = np.triu_indices(self._count)

        def entries(distance: FloatArray) -> FloatArray:
            matrices = responses(inductance(distance), resistances, step)[..., rows, columns]
            return matrices.reshape(len(distance), -1)

        scale = np.abs(entries(np.linspace(*ends, 9))).max(axis=0)
        waiting, cells = [(*ends, 0)], []
        while waiting:
            low, high, depth = waiting.pop()
            middle, half = 0.5 * (low + high), 0.5 * (high - low)
            places = np.concatenate([nodes, between])
            values = entries(middle + half * places)
            coefficients = polyfit(nodes, values[: DEGREE + 1], DEGREE)
            error = np.abs(polyval(between, coefficients).T - values[DEGREE + 1 :]) / scale
            if error.max() > ERROR and depth < MOST_HALVINGS:
                waiting += [(middle, high, depth + 1), (low, middle, depth + 1)]  # the lower one comes next
            else:
                cells.append((low, np.concatenate([[middle, 1.0 / half], coefficients.T.ravel()])))
        self._borders = np.array([low for low, _ in cells[1:]])
        self._ends, self._table = ends, np.stack([row for _, row in cells])

    def at(self, distance: SX) -> list[SX]:
        """The three matrices at an expression's distance."""
        d = ca.fmin(ca.fmax(distance, self._ends[0]), self._ends[1])
        row = row_of(self._table, [self._borders], [d])
        x, polynomial_of = (d - row[0]) * row[1], polynomial((DEGREE + 1,))
        entries = [polynomial_of(coefficients, x) for coefficients in ca.vertsplit(row[2:], DEGREE + 1)]
        # Column by column, as the entries are row by row
        size, below = len(entries) // 3, ca.Sparsity.lower(self._count)
        parts = (SX(below, ca.vertcat(*entries[first : first + size])) for first in (0, size, 2 * size))
        return [ca.densify(ca.tril2symm(matrix)) for matrix in parts]


def _ends(inductance: Callable[[FloatArray], FloatArray], domain: tuple[float, float]) -> tuple[float, float]:
    """How far the inductances are positive definite, up to a part of the stroke beyond either end."""
    width = BEYOND * (domain[1] - domain[0])
    tables = []
    for end, outward in zip(domain, (-width, width), strict=True):
        places = end + outward * np.linspace(0.0, 1.0, PLACES)
        with np.errstate(all="ignore"):
            matrices = inductance(places)
        finite = np.isfinite(matrices).all(axis=(1, 2))
        least = np.linalg.eigvalsh(np.where(np.reshape(finite, (-1, 1, 1)), matrices, 0.0))[:, 0]
        poor = np.flatnonzero(least <= LEAST_LEFT * least[0])
        tables.append(float(places[max(poor[0] - 1, 0) if len(poor) else -1]))
    return tables[0], tables[1]


@cache
def _shares_of() -> GraphFunction:
    with building():
        z = SX.sym("z")
        return GraphFunction([z], ca.vertcat(*shares(z)))


def responses(inductance: FloatArray, resistances: FloatArray, step: float) -> FloatArray:
    """The three matrices (..., 3, m, m) of inductances (..., m, m) in H and resistances in ohm, for a step in s."""
    root = np.sqrt(resistances)
    times, modes = np.linalg.eigh(inductance / (root[:, None] * root))
    modes, z = modes / root[:, None], step / times
    of_modes = np.moveaxis(_shares_of()(z.reshape(1, -1)).reshape(3, *z.shape), 0, -2) / times[..., None, :]
    return np.asarray((modes[..., None, :, :] * of_modes[..., None, :]) @ np.swapaxes(modes, -1, -2)[..., None, :, :])
