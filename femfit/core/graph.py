"""Run what is derived from one expression: over arrays in numpy, at a handful of points by CasADi's interpreter.

A piecewise polynomial enters an expression as the row of its cell (:func:`row_of`), which counts as constant in every
derivative. A row is found last, when the expression is run: by numpy over arrays; at single points by comparisons
where the cells are few, else by a look-up. What an inner iteration finds enters alike (:func:`settled`).

References
----------
J. A. E. Andersson et al., CasADi: a software framework for nonlinear optimization and optimal control, Mathematical
Programming Computation 11 (2019) 1.
"""

import os
import threading
from collections.abc import Callable, Hashable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, TypeAlias, TypeVar

import casadi as ca
import numpy as np
from casadi import SX

from femfit.core.compiled import Compilation
from femfit.core.numerics import FloatArray
from femfit.core.results import kept
from femfit.core.tape import Caller, Tape

Made = TypeVar("Made")

Expression: TypeAlias = Any
"""An SX of CasADi, or a number where nothing depends on anything."""

NUMPY_US, CALL_US, INSTRUCTION_US = 0.65, 3.5, 0.004
"""Measured: a call of numpy, one of the interpreter, and an instruction in it, in microseconds."""

WORK, LEAST_BLOCK, LARGEST_BLOCK = 2_000_000, 512, 16_384
"""Measured: numbers that a block of points works on, and its least and largest size."""

FEW_CELLS = 16
"""Measured: up to so many cells comparisons are quicker than a look-up."""

ALIKE = 12
"""Numerical: operations deep to which coordinates are compared; deeper ones count as different."""


@dataclass(frozen=True, eq=False)
class _Row:
    """The row of a table at coordinates, as a symbol."""

    symbol: SX
    coordinates: SX
    inner: tuple[FloatArray, ...]  # Ascending borders between the cells of each axis
    table: FloatArray  # One column a cell, the last axis fastest
    source: FloatArray | None = None  # What it was made of

    def in_numpy(self, coordinates: FloatArray) -> FloatArray:
        """The rows at coordinates (axes, N), of shape (entries, N)."""
        cell: Any = 0
        for x, inner in zip(coordinates, self.inner, strict=True):
            cell = cell * (len(inner) + 1) + inner.searchsorted(x, "right")
        return self.table.take(cell, axis=1) if len(self.table[0]) > 1 else self.table

    def by_comparisons(self, coordinates: SX) -> SX:
        """The row by comparisons, each axis for itself."""
        choices = SX.ones(1)
        for k, inner in enumerate(self.inner):
            x = coordinates[k]
            beyond = [SX(1), *(x >= border for border in inner.tolist()), SX(0)]
            choices = ca.kron(choices, ca.vertcat(*(a - b for a, b in pairwise(beyond))))
        entries = []
        for values in self.table:
            alike = np.all(values == values[0])
            each = zip(ca.vertsplit(choices), values.tolist(), strict=True)
            entries.append(SX(values[0]) if alike else sum(ca.if_else(c, v, 0) for c, v in each))
        return ca.vertcat(*entries)

    def by_lookup(self, coordinates: ca.MX) -> ca.MX:
        """The row by a search of the cell."""
        cell: Any = 0
        for k, inner in enumerate(self.inner):
            borders = ca.DM([-3e38, *inner.tolist(), 3e38])  # in single precision, too
            cell = cell * (len(inner) + 1) + ca.low(borders, coordinates[k], {"lookup_mode": "binary"})
        return ca.MX(ca.DM(self.table))[:, cell]


@dataclass(eq=False)
class _Late:
    """What enters an expression late, in the order in which it was asked for."""

    rows: list[_Row] = field(default_factory=list)
    settled: list[tuple[SX, SX]] = field(default_factory=list)  # Symbols and what they stand for


_LATE: ContextVar[_Late] = ContextVar("_LATE")

_BUILDING = threading.RLock()
"""Held while expressions are made."""


@contextmanager
def building() -> Iterator[None]:
    """Within it expressions are made, differentiated and turned into :class:`GraphFunction`."""
    with _BUILDING:  # CasADi's mode is the process's
        token, mode = _LATE.set(_Late()), ca.GlobalOptions.getNumpyMode()
        ca.GlobalOptions.setNumpyMode(-1)  # numpy's functions of an SX give an SX
        try:
            yield
        finally:
            ca.GlobalOptions.setNumpyMode(mode)
            _LATE.reset(token)


def _after_fork() -> None:
    global _BUILDING  # noqa: PLW0603  a thread that the child does not have may hold it
    _BUILDING = threading.RLock()
    if _LATE.get(None) is None:  # it was not this thread that built
        ca.GlobalOptions.setNumpyMode(0)  # CasADi's own


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)


def is_number(value: Expression, number: float) -> bool:
    """Whether a value is a number and this one, so that what it would multiply may be left out."""
    return not isinstance(value, SX) and bool(np.all(value == number))


def row_of(table: FloatArray, borders: Sequence[FloatArray], coordinates: Sequence[Expression]) -> SX:
    """The row of the cell in which coordinates lie; constant in every derivative.

    Parameters
    ----------
    table : array, shape (cells of the first axis, .., of the last, entries)
        What each cell has.
    borders : sequence of array
        For each axis the ascending borders between its cells: one less than cells.
    """
    entries, place = table.shape[-1], ca.vertcat(*(SX(x) for x in coordinates))
    if (twin := _row_at(table, place)) is not None:  # the same place twice is one row, and worked out once
        return twin.symbol
    symbol = SX.sym("row", entries)
    columns = np.ascontiguousarray(table.reshape(-1, entries).T)
    inner = tuple(np.asarray(b, dtype=np.float64) for b in borders)
    _LATE.get().rows.append(_Row(symbol, place, inner, columns, table))
    return symbol


def _row_at(table: FloatArray, place: SX) -> "_Row | None":
    rows = (row for row in _LATE.get().rows if row.source is table)
    return next((row for row in rows if ca.is_equal(row.coordinates, place, ALIKE)), None)


def settled(value: Expression) -> SX:
    """What an iteration found, constant in every derivative: one more step of it is to be differentiated."""
    value = ca.densify(SX(value))
    symbol = SX.sym("settled", *value.shape)
    _LATE.get().settled.append((symbol, value))
    return symbol


def slope(function: Callable[[SX], Expression], x0: Expression, order: int = 1) -> SX:
    """A derivative of a function of one variable, or its gradient in several, itself to be differentiated."""

    def derivative(x: SX) -> SX:
        value = SX(function(x))
        for _ in range(order):
            value = ca.gradient(value, x)
        return value

    return of_variable(derivative, x0)


def of_variable(function: Callable[[SX], SX], x0: Expression) -> SX:
    """A function that derives by its variable, at an expression."""
    x0, late = SX(x0), _LATE.get()
    x = SX.sym("x", *x0.shape)
    rows, values = len(late.rows), len(late.settled)
    result = ca.substitute(SX(function(x)), x, x0)
    new_rows, new_values = late.rows[rows:], late.settled[values:]
    del late.rows[rows:], late.settled[values:]
    twins: list[tuple[SX, SX]] = []

    def resolved(expression: SX) -> SX:
        expression = ca.substitute(expression, x, x0)
        for symbol, twin in twins:
            expression = ca.substitute(expression, symbol, twin)
        return expression

    for row in new_rows:
        place = resolved(row.coordinates)
        twin = None if row.source is None else _row_at(row.source, place)
        if twin is None:
            late.rows.append(replace(row, coordinates=place))
        else:
            twins.append((row.symbol, twin.symbol))
    late.settled += [(symbol, resolved(value)) for symbol, value in new_values]
    return resolved(result)


def _symbols_in(expression: SX) -> set[int]:
    """What tells the symbols of an expression apart."""
    return {symbol.element_hash() for symbol in ca.symvar(expression)}


def _bound(expressions: Sequence[SX]) -> list[SX]:
    """Expressions with what was settled in the place of its symbols."""
    pairs = [(symbol, value, _symbols_in(symbol)) for symbol, value in _LATE.get().settled]
    bound = list(expressions)
    while present := set().union(*map(_symbols_in, bound)):
        used = [(symbol, value) for symbol, value, names in pairs if names & present]
        if not used:
            break
        bound = ca.substitute(bound, [symbol for symbol, _ in used], [value for _, value in used])
    return bound


def once(owner: Any, key: Hashable, make: Callable[[], Made]) -> Made:
    """What is :func:`kept` with an owner under a key, made within :func:`building`."""
    return kept(owner, key, make, building)


class GraphFunction:
    """A function of vectors, made of expressions within :func:`building`.

    Parameters
    ----------
    inputs : sequence of SX
        Column vectors.
    output : SX
        Column vector.
    """

    def __init__(self, inputs: Sequence[SX], output: SX) -> None:
        rows = _LATE.get().rows
        bound, *places = _bound([ca.densify(SX(output)), *(row.coordinates for row in rows)])
        used: list[_Row] = []
        wanted = _symbols_in(bound)
        for row, place in zip(reversed(rows), reversed(places), strict=True):
            if wanted & _symbols_in(row.symbol):
                used.insert(0, _Row(row.symbol, place, row.inner, row.table))
                wanted |= _symbols_in(place)
        self.inputs, self.output, self.rows = [SX(x) for x in inputs], ca.densify(bound), used
        self._sizes, self._compilation = [x.numel() for x in self.inputs], Compilation(self._of_a_point)

    @cached_property
    def stages(self) -> list[tuple[Tape, list[_Row]]]:
        """Tapes of the rows' coordinates, level by level, and of the output."""
        stages, variables, remaining = [], list(self.inputs), list(self.rows)
        needed = {id(row): _symbols_in(row.coordinates) for row in remaining}
        while remaining:
            waiting = set().union(*(_symbols_in(row.symbol) for row in remaining))
            ready = [row for row in remaining if not needed[id(row)] & waiting]
            stages.append((Tape(variables, ca.vertcat(*(row.coordinates for row in ready))), ready))
            variables = [*variables, *(row.symbol for row in ready)]
            remaining = [row for row in remaining if row not in ready]
        return [*stages, (Tape(variables, self.output), [])]

    def _of_a_point(self, few_cells: int = FEW_CELLS) -> ca.Function:
        """The function of one point: rows are compared for where none has more cells, and looked up else."""
        if all(row.table.shape[1] <= few_cells for row in self.rows):
            output = self.output
            for row in reversed(self.rows):
                output = ca.substitute(output, row.symbol, row.by_comparisons(row.coordinates))
            return ca.Function("f", self.inputs, [ca.cse(output)])
        point = [ca.MX.sym("x", *x.shape) for x in self.inputs]
        values = list(point)
        for tape, ready in self.stages:
            value = tape.function(*values)
            places = iter(ca.vertsplit(value, 1)) if ready else iter(())
            values += [row.by_lookup(ca.vertcat(*(next(places) for _ in row.inner))) for row in ready]
        return ca.Function("f", point, [value])

    def leaves_out(self, symbol: SX) -> bool:
        """Whether the output does not depend on an input, nor does the cell of any row."""
        cells = [row.coordinates[k] for row in self.rows for k, inner in enumerate(row.inner) if len(inner)]
        return not ca.depends_on(ca.vertcat(self.output, *cells), symbol)

    @property
    def at_a_point(self) -> ca.Function:
        """The function of one point, for the interpreter and for C."""
        return self._compilation.function

    @cached_property
    def by_tables(self) -> ca.Function:
        """The function of one point, which looks every row up: the smallest in C."""
        return self._of_a_point(few_cells=0)

    @cached_property
    def _block(self) -> int:
        """Points that are worked out together."""
        rows = max(tape.function.sz_w() + tape.function.nnz_in() + tape.function.nnz_out() for tape, _ in self.stages)
        return int(np.clip(WORK // rows, LEAST_BLOCK, LARGEST_BLOCK))

    @cached_property
    def operations(self) -> int:
        """Instructions of one point, without the rows' own."""
        return sum(tape.function.n_instructions() for tape, _ in self.stages)

    def __call__(self, *inputs: FloatArray) -> FloatArray:
        """The output (entries, N) of inputs (entries, N), or (entries,) where one holds for all points."""
        columns = [x if x.ndim == 2 else x[:, None] for x in inputs]
        counts = {x.shape[1] for x in columns}
        count = max(counts, default=1) if 0 not in counts else 0
        if [x.shape[0] for x in columns] != self._sizes or not counts <= {1, count}:
            raise ValueError(
                f"A function of {self._sizes} numbers must have inputs of as many rows, and of one point or as many as "
                f"the others; instead received {[x.shape for x in inputs]}."
            )
        if (library := self._compilation.after(count)) is not None:
            return library(columns, count)
        result = np.empty((self.output.numel(), count))
        # Up to so many points the interpreter is quicker than numpy, whose calls cost more than the arithmetic
        if count <= NUMPY_US * self.operations / (CALL_US + INSTRUCTION_US * self.operations):
            for k in range(count):
                result[:, k] = self.point(*(x[:, min(k, x.shape[1] - 1)] for x in columns))
            return result
        if count <= (block := self._block):
            return self._in_numpy(columns, count).copy()
        for first in range(0, count, block):
            span = slice(first, min(first + block, count))
            result[:, span] = self._in_numpy([x[:, span] if x.shape[1] > 1 else x for x in columns], span.stop - first)
        return result

    @cached_property
    def point(self) -> Caller:
        """The function of one point: the output (entries,) of inputs (entries,)."""
        return Caller(self.at_a_point, self._compilation)

    def _in_numpy(self, inputs: Sequence[FloatArray], count: int) -> FloatArray:
        values = list(inputs)
        for tape, ready in self.stages:
            value, first = tape(values, count), 0
            for row in ready:
                values.append(row.in_numpy(value[first : first + len(row.inner)]))
                first += len(row.inner)
        return value
