"""Run a function of CasADi: its instructions one after the other over arrays, or at one point by the interpreter.

Both give the same bits: sums and products of numpy are IEEE's, and what is not exact there comes from the interpreter,
whose library of mathematics is that of compiled code, too.
"""

import threading
from collections.abc import Callable, Sequence
from typing import Any

import casadi as ca
import numpy as np
from casadi import SX

from femfit.core.compiled import ALONE, Compilation, Library
from femfit.core.numerics import FloatArray

PIECES = 512, 32
"""Chosen: lengths in which arrays are given to libm's functions."""


class _Elementary:
    """A function of libm over arrays, in pieces of a fixed length.

    Parameters
    ----------
    function : callable
        Of CasADi, of one or two numbers.
    """

    def __init__(self, function: Callable[..., SX], operands: int = 1) -> None:
        self._function, self._operands = function, operands
        self._callers: dict[int, Caller] = {}

    def __call__(self, *operands: Any, out: FloatArray) -> None:
        count, first = len(out), 0
        arrays = [np.broadcast_to(x, count) for x in operands]
        while first < count:
            length = PIECES[0] if count - first >= PIECES[0] else PIECES[1]
            end = min(first + length, count)
            pieces = [x[first:end] for x in arrays]
            if end - first < length:
                pieces = [np.pad(piece, (0, length - len(piece)), mode="edge") for piece in pieces]
            if length not in self._callers:
                x = [SX.sym("x", length) for _ in range(self._operands)]
                self._callers[length] = Caller(ca.Function("f", x, [self._function(*x)]))
            out[first:end] = self._callers[length](*pieces)[: end - first]
            first = end


_UFUNCS: dict[str, Callable[..., Any]] = {
    "ADD": np.add, "SUB": np.subtract, "MUL": np.multiply, "DIV": np.divide, "NEG": np.negative, "SQ": np.square,
    "SQRT": np.sqrt, "FLOOR": np.floor, "FABS": np.abs, "FMAX": np.fmax, "FMIN": np.fmin, "SIGN": np.sign,
    "LE": np.less_equal, "LT": np.less, "EQ": np.equal, "NE": np.not_equal, "NOT": np.logical_not,
    "AND": np.logical_and, "OR": np.logical_or, "INV": np.reciprocal, "COPYSIGN": np.copysign,
    "ASSIGN": np.positive, "TWICE": lambda x, out: np.add(x, x, out=out),
    "IF_ELSE_ZERO": lambda condition, x, out: np.copyto(out, np.where(condition, x, 0.0)),
}  # fmt: skip
_ELEMENTARY: dict[str, Callable[..., SX]] = {
    "EXP": ca.exp, "EXPM1": ca.expm1, "LOG": ca.log, "LOG1P": ca.log1p, "TANH": ca.tanh, "SIN": ca.sin, "COS": ca.cos,
    "TAN": ca.tan, "ATAN": ca.atan, "SINH": ca.sinh, "COSH": ca.cosh, "ASINH": ca.asinh,
}  # fmt: skip
_OF_TWO: dict[str, Callable[..., SX]] = {"ATAN2": ca.atan2, "POW": ca.power, "CONSTPOW": ca.power}
_OPERATIONS = {
    getattr(ca, f"OP_{name}"): function
    for name, function in (
        *_UFUNCS.items(),
        *((name, _Elementary(function)) for name, function in _ELEMENTARY.items()),
        *((name, _Elementary(function, operands=2)) for name, function in _OF_TWO.items()),
    )
}


class Caller:
    """A call of a function of vectors at one point, without allocation, on arrays of its own for each thread.

    Parameters
    ----------
    compilation : Compilation or None
        Of the function, where it is compiled once it was called often.
    """

    def __init__(self, function: ca.Function, compilation: Compilation | None = None) -> None:
        self._function = function
        self._buffers: dict[int, Any] = {}
        self._compilation = compilation
        self._library: Library | None = None

    def __call__(self, *inputs: Any) -> FloatArray:
        """The output (entries,) of inputs (entries,)."""
        library = None if self._compilation is None else self._compilation.after(ALONE)
        if library is not None and library is not self._library:
            self._library, self._function, self._buffers = library, library.function, {}
        known = self._buffers.get(threading.get_ident())
        if known is None:
            known = self._buffers[threading.get_ident()] = self._bind()
        _, run, given, value = known
        for own, x in zip(given, inputs, strict=True):
            own[:] = x
        run()
        return value.copy()

    def _bind(self) -> Any:
        function = self._function
        buffer, run = function.buffer()
        given, value = [np.zeros(function.nnz_in(k)) for k in range(function.n_in())], np.zeros(function.nnz_out(0))
        for k, x in enumerate(given):
            if len(x):
                buffer.set_arg(k, memoryview(x))  # type: ignore[arg-type, call-arg]
        buffer.set_res(0, memoryview(value))  # type: ignore[arg-type, call-arg]
        return buffer, run, given, value


class Tape:
    """The instructions of an expression, each at once for many points."""

    def __init__(self, inputs: Sequence[SX], output: SX) -> None:
        self.function = ca.Function("f", inputs, [ca.cse(output)])
        self._local = threading.local()

    def __call__(self, inputs: Sequence[FloatArray], count: int) -> FloatArray:
        """The output (entries, count), overwritten by the next call, of inputs (entries, count) or (entries,)."""
        bound: dict[int, Any] = self._local.__dict__.setdefault("bound", {})  # of this thread alone
        if count not in bound:
            while len(bound) > 1:
                bound.pop(next(iter(bound)))
            bound[count] = self._bind(count)
        given, instructions, result = bound[count]
        for row, x in zip(given, inputs, strict=True):
            np.copyto(row, x if x.ndim == 2 else x[:, None])
        with np.errstate(all="ignore"):
            for do, operands, out in instructions:
                do(*operands, out=out)
        return result

    def _bind(self, count: int) -> tuple[list[FloatArray], list[Any], FloatArray]:
        """The instructions with the arrays that they read and write."""
        f = self.function
        given = [np.zeros((f.size1_in(k), count)) for k in range(f.n_in())]
        work, result = np.zeros((f.sz_w(), count)), np.zeros((f.size1_out(0), count))
        held: dict[int, Any] = {}
        instructions: list[Any] = []
        for k in range(f.n_instructions()):
            operation, to, of = f.instruction_id(k), f.instruction_output(k), f.instruction_input(k)
            if operation == ca.OP_CONST:
                held[to[0]] = f.instruction_constant(k)
            elif operation == ca.OP_INPUT:
                held[to[0]] = given[of[0]][of[1]]
            elif operation == ca.OP_OUTPUT:
                instructions.append((np.positive, (held[of[0]],), result[to[1]]))
            else:
                instructions.append((_OPERATIONS[operation], tuple(held[j] for j in of), work[to[0]]))
                held[to[0]] = work[to[0]]
        return given, instructions, result
