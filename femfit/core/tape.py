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


_WRITTEN: dict[str, tuple[Callable[..., Any], str]] = {
    "ADD": (np.add, "{} + {}"), "SUB": (np.subtract, "{} - {}"), "MUL": (np.multiply, "{} * {}"),
    "DIV": (np.divide, "{} / {}"), "NEG": (np.negative, "-{}"), "SQ": (np.square, "{0} * {0}"),
    "TWICE": (lambda x, out: np.add(x, x, out=out), "2.0 * {}"), "INV": (np.reciprocal, "1.0 / {}"),
    "ASSIGN": (np.positive, "{}"), "SQRT": (np.sqrt, "sqrt({})"), "FLOOR": (np.floor, "floor({})"),
    "CEIL": (np.ceil, "ceil({})"), "FABS": (np.abs, "abs({})"), "SIGN": (np.sign, "sign({})"),
    "COPYSIGN": (np.copysign, "copysign({}, {})"), "FMAX": (np.fmax, "fmax({}, {})"),
    "FMIN": (np.fmin, "fmin({}, {})"), "LE": (np.less_equal, "({} <= {})"), "LT": (np.less, "({} < {})"),
    "EQ": (np.equal, "({} == {})"), "NE": (np.not_equal, "({} != {})"), "NOT": (np.logical_not, "not_({})"),
    "AND": (np.logical_and, "and_({}, {})"), "OR": (np.logical_or, "or_({}, {})"),
    "IF_ELSE_ZERO": (lambda condition, x, out: np.copyto(out, np.where(condition, x, 0.0)), "where({}, {})"),
    "CONSTPOW": (_Elementary(ca.power, 2), "power({}, {})"), "POW": (_Elementary(ca.power, 2), "power({}, {})"),
}  # fmt: skip
_CIRCULAR = tuple(inverse + name for inverse in ("", "a") for name in ("sin", "cos", "tan", "sinh", "cosh", "tanh"))
_OF_ONE = ("exp", "expm1", "log", "log1p", "erf", *_CIRCULAR)
_CALLED = {name: (_Elementary(getattr(ca, name)), f"{name}({{}})") for name in _OF_ONE}
_CALLED |= {name: (_Elementary(getattr(ca, name), 2), f"{name}({{}}, {{}})") for name in ("atan2", "hypot", "fmod")}
_OPERATIONS = _WRITTEN | {name.upper(): both for name, both in _CALLED.items()}
_NAMES = {getattr(ca, name): name.removeprefix("OP_") for name in dir(ca) if name.startswith("OP_")}


def operation(number: int) -> tuple[Callable[..., Any], str]:
    """An operation by its number in CasADi: over arrays, and in the text of a Python file."""
    name = _NAMES[number]
    if name not in _OPERATIONS:
        raise NotImplementedError(f"Expressions must be made of {', '.join(_OPERATIONS)}; instead received {name}.")
    return _OPERATIONS[name]


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
        buffers = self._buffers.get(threading.get_ident())
        if buffers is None:
            buffers = self._buffers[threading.get_ident()] = self._bind()
        _, run, arguments, value = buffers
        for buffer, x in zip(arguments, inputs, strict=True):
            buffer[:] = x
        run()
        return value.copy()

    def _bind(self) -> Any:
        function = self._function
        buffer, run = function.buffer()
        arguments, value = [np.zeros(function.nnz_in(k)) for k in range(function.n_in())], np.zeros(function.nnz_out(0))
        for k, x in enumerate(arguments):
            if len(x):
                buffer.set_arg(k, memoryview(x))  # type: ignore[arg-type, call-arg]
        buffer.set_res(0, memoryview(value))  # type: ignore[arg-type, call-arg]
        return buffer, run, arguments, value


class Tape:
    """The instructions of an expression, each at once for many points."""

    def __init__(self, inputs: Sequence[SX], output: SX) -> None:
        self.function = ca.Function("f", inputs, [ca.cse(output)])
        self._local = threading.local()

    def __call__(self, inputs: Sequence[FloatArray], count: int) -> FloatArray:
        """The output (entries, count), overwritten by the next call, of inputs (entries, count) or (entries, 1)."""
        bound: dict[int, Any] = self._local.__dict__.setdefault("bound", {})  # of this thread alone
        if count not in bound:
            while len(bound) > 1:
                bound.pop(next(iter(bound)))
            bound[count] = self._bind(count)
        arguments, instructions, result = bound[count]
        for row, x in zip(arguments, inputs, strict=True):
            np.copyto(row, x)
        with np.errstate(all="ignore"):
            for do, operands, out in instructions:
                do(*operands, out=out)
        return result

    def _bind(self, count: int) -> tuple[list[FloatArray], list[Any], FloatArray]:
        """The instructions with the arrays that they read and write."""
        f = self.function
        arguments = [np.zeros((f.size1_in(k), count)) for k in range(f.n_in())]
        work, result = np.zeros((f.sz_w(), count)), np.zeros((f.size1_out(0), count))
        held: dict[int, Any] = {}
        instructions: list[Any] = []
        for k in range(f.n_instructions()):
            number, to, of = f.instruction_id(k), f.instruction_output(k), f.instruction_input(k)
            if number == ca.OP_CONST:
                held[to[0]] = f.instruction_constant(k)
            elif number == ca.OP_INPUT:
                held[to[0]] = arguments[of[0]][of[1]]
            elif number == ca.OP_OUTPUT:
                instructions.append((np.positive, (held[of[0]],), result[to[1]]))
            else:
                instructions.append((operation(number)[0], tuple(held[j] for j in of), work[to[0]]))
                held[to[0]] = work[to[0]]
        return arguments, instructions, result
