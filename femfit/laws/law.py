"""What a force law is: data and pure functions.

A law is a dictionary of columns phi_k(d; shape). With polynomial coefficient functions c_k(i) the force is
F(d, i) = sum_k c_k(i) phi_k(d), which belongs to the co-energy W'(d, i) = sum_k c_k(i) Phi_k(d) with
Phi_k(d) = integral of phi_k from d to infinity, so that F = -dW'/dd; of columns that do not decay, from d to zero. A
law therefore gives flux linkage, motional constant and inductance as well, and cannot contradict reciprocity. A law
declares Phi_k alone; phi_k is its derivative.

References
----------
W. Squire and G. Trapp, SIAM Review 40 (1998) 110: derivatives by a complex step.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from femfit.core.numerics import FloatArray


@dataclass(frozen=True)
class ShapeParameter:
    """A length of a law's columns that does not enter linearly, in m; at most :data:`LONGEST_M`."""

    name: str
    lower: float
    start: float
    description: str


Columns = Callable[[Any, Mapping[str, Any]], tuple[Any, ...]]
"""(d, shape parameters) -> a value of each column, of arrays and of expressions."""

LONGEST_M = 0.3
"""Conventional: no shape parameter of a law is longer."""

STEP = 1e-30
"""Numerical: of a complex distance, whose imaginary part carries the derivative of Phi to rounding."""

Powers = tuple[tuple[int, str], ...]
"""Columns (d + shift)^-k, each as k and the name of its shift; empty for none."""


def law_of_powers(powers: Powers, **declared: Any) -> "ForceLaw":
    """A law of inverse powers, declared as a :class:`ForceLaw` is."""
    return ForceLaw(potentials=partial(_potential_of_powers, powers), **declared)


def _potential_of_powers(powers: Powers, distance: Any, shape: Mapping[str, Any]) -> tuple[Any, ...]:
    """The integrals of inverse powers; as of :attr:`ForceLaw.potentials`."""
    shifted = [(float(k), distance + shape[name] if name else distance) for k, name in powers]
    return tuple(s ** (1.0 - k) / (k - 1.0) for k, s in shifted)


@dataclass(frozen=True)
class ForceLaw:
    """A force law."""

    name: str
    formula: str
    basis: tuple[str, ...]  # Name of each column, for example ``d^-4``
    # Unit of each column's coefficient at current power zero; each power of current divides by A
    coefficient_units: tuple[str, ...]
    potentials: Columns  # Phi(d), the integral of phi from d to infinity or zero
    # Floating-point operations of the columns at one distance, written out: each addition, multiplication, division and
    # square root counts one (division and square root take the same time on common microcontrollers), exp counts 20
    column_operations: int
    reference: str
    shape: tuple[ShapeParameter, ...] = ()  # Parameters that enter nonlinearly; empty for most laws
    nonnegative: tuple[bool, ...] = field(default=())  # Which coefficients are bounded below by zero at each current
    passes_face: bool = False  # Whether the columns are finite at all distances, zero and below included

    def columns(self, distance: FloatArray, shape: Mapping[str, float]) -> FloatArray:
        """The columns phi at distances (n,) in m, of shape (n, k)."""
        return np.stack([-potential.imag / STEP for potential in self.potentials(distance + 1j * STEP, shape)], axis=-1)

    def potential_columns(self, distance: FloatArray, shape: Mapping[str, float]) -> FloatArray:
        """Their integrals Phi at distances (n,) in m, of shape (n, k)."""
        return np.stack(self.potentials(distance, shape), axis=-1)

    def operations_with(self, powers: Sequence[Sequence[int]]) -> int:
        """Floating-point operations of F(d, i) with given coefficient functions, by Horner's rule.

        Parameters
        ----------
        powers : sequence of sequence of int
            Powers of the current in each column's coefficient: ``(0,)``, ``(1,)``, ``(0, 1)`` or ``(0, 1, 2)``.

        Returns
        -------
        int
            Columns, coefficient functions (a multiplication a power, an addition a term after the first) and the sum of
            products.
        """
        functions = sum(max(p) + len(p) - 1 for p in powers)
        return self.column_operations + functions + 2 * len(self.basis) - 1
