"""Functions as machine code, where the machine has a C compiler.

CasADi writes what is called often as C, a compiler translates it in the background; what runs it today goes on until
that is done, and for good where nothing comes of it. All do the same operations on doubles in the same order (none are
contracted) with the system's library of mathematics: their results agree to the bit, and it does not matter which of
them gave a number.

What was compiled is kept under the hash of its source and command, in the user's cache folder: ``femfit`` in
``XDG_CACHE_HOME`` or ``LOCALAPPDATA``, else in ``~/.cache``. The environment's ``FEMFIT_COMPILER`` names another
compiler than ``cc``, ``gcc`` or ``clang``; where it is empty, nothing is compiled.
"""

import ctypes
import hashlib
import os
import platform
import secrets
import shlex
import shutil
import subprocess
import threading
import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from contextlib import suppress
from functools import cached_property
from pathlib import Path

import casadi as ca
import numpy as np

from femfit.core.numerics import FloatArray

FLAGS = ("-O1", "-ffp-contract=off", "-shared", "-fPIC", "-x", "c", "-", "-lm")
"""Measured: more optimisation takes twice the time and makes nothing quicker."""

OFTEN = 50_000
"""Chosen: points in arrays from which a function is compiled."""

ALONE = 10
"""Measured: as many points in arrays cost what one point alone does."""

LARGEST = 2_000_000
"""Chosen: characters of C up to which a compiler takes tens of seconds at most; beyond, minutes."""

BLOCK = 4096
"""Chosen: points whose inputs are gathered at a time, which a processor keeps at hand."""

KEPT = 200
"""Conventional: compiled functions that stay in the cache; the one not used for longest goes first."""


_POINTS = """
CASADI_SYMBOL_EXPORT int f_points(casadi_int n, const double* x, casadi_int step, double* y, casadi_int row) {{
  static const casadi_int sizes[] = {{ {sizes} }};
  const double* arg[{arg} + 1];
  double *res[{res} + 1], w[{w} + 1], in[{total} + 1], out[{rows} + 1];
  casadi_int iw[{iw} + 1], j, k;
  for (k = 0; k < n; k++) {{
    for (j = 0; j < {total}; j++) in[j] = x[j * step + k];
    arg[0] = in;
    for (j = 1; j < {count}; j++) arg[j] = arg[j - 1] + sizes[j - 1];
    res[0] = out;
    if (f(arg, res, iw, w, 0)) return 1;
    for (j = 0; j < {rows}; j++) y[j * row + k] = out[j];
  }}
  return 0;
}}
"""


class Library:
    """A compiled function of vectors."""

    def __init__(self, path: Path, function: ca.Function) -> None:
        self.function = ca.external("f", str(path))
        self._entries, self._rows = function.nnz_in(), function.nnz_out(0)
        self._points = ctypes.CDLL(str(path)).f_points
        self._points.argtypes = (ctypes.c_longlong, *(ctypes.c_void_p, ctypes.c_longlong) * 2)

    def __call__(self, inputs: Sequence[FloatArray], count: int) -> FloatArray:
        """The output (entries, count) of inputs (entries, count), or (entries, 1) where one holds for all points."""
        block = min(count, BLOCK)
        inputs_of_block, result = np.empty((self._entries, block)), np.empty((self._rows, count))
        for first in range(0, count, BLOCK):
            points, end = min(block, count - first), 0
            for x in inputs:
                start, end = end, end + len(x)
                inputs_of_block[start:end, :points] = x if x.shape[1] == 1 else x[:, first : first + points]
            if self._points(points, inputs_of_block.ctypes.data, block, result[:, first:].ctypes.data, count):
                raise FloatingPointError("A compiled function failed.")  # CasADi's functions of SX never do
        return result


class Compilation:
    """A function on its way to machine code.

    Parameters
    ----------
    make : callable
        Gives the casadi.Function of vectors, with one vector as its output, all dense; its name is f. It is called
        once, where the function is first asked for: most are never called often enough.
    """

    def __init__(self, make: Callable[[], ca.Function]) -> None:
        self._make = make
        self._library: Library | None = None
        self._points, self._over = 0, False
        self._work: Future[Path] | None = None

    @cached_property
    def function(self) -> ca.Function:
        """What is compiled."""
        return self._make()

    def after(self, points: int) -> Library | None:
        """The library, as soon as there is one, after so many more points."""
        if not self._over:
            self._points += points
            if self._points >= OFTEN:
                self._look()
        return self._library

    def _look(self) -> None:
        """Begin where no other function is compiled, or see whether it is done."""
        if self._work is None and _ONE_COMPILER.acquire(blocking=False):
            self._over = True
            try:
                command, source = _compiler(), self._source()
                if command is not None and len(source) <= LARGEST:
                    self._work = Future()
                    threading.Thread(target=_compile, args=(command, source, self._work), daemon=True).start()
                    self._over = False
            finally:
                if self._over:
                    _ONE_COMPILER.release()
        if self._work is not None and self._work.done():
            self._over = True
            try:
                self._library = Library(self._work.result(), self.function)
            except (OSError, RuntimeError, AttributeError) as error:  # no cache, or what lies there is not a library
                _warn(str(error))

    def _source(self) -> str:
        generator, f = ca.CodeGenerator("f.c"), self.function
        generator.add(f)
        sizes = [f.nnz_in(k) for k in range(f.n_in())]
        facts = {"sizes": ", ".join(map(str, sizes)), "count": len(sizes), "total": sum(sizes), "rows": f.nnz_out(0)}
        facts |= {"arg": f.sz_arg(), "res": f.sz_res(), "iw": f.sz_iw(), "w": f.sz_w()}
        return str(generator.dump()) + _POINTS.format(**facts)


_ONE_COMPILER = threading.Semaphore()
"""One function of a process is compiled at a time; a process that was forked meanwhile does without."""


def _compile(command: list[str], source: str, work: "Future[Path]") -> None:
    try:
        work.set_result(_library(command, source))
    except OSError as error:
        work.set_exception(error)
    finally:
        _ONE_COMPILER.release()


def _library(command: list[str], source: str) -> Path:
    """Make the library, or find it in the cache, where all find it whole or not at all."""
    facts = "\n".join([*command, platform.system(), platform.machine(), source])
    target = _folder() / f"{hashlib.sha256(facts.encode()).hexdigest()[:32]}.so"
    if not target.is_file():
        target.parent.mkdir(parents=True, exist_ok=True)
        partial = target.with_suffix(f".{secrets.token_hex(4)}.so")
        made = subprocess.run(  # noqa: S603  the compiler that the user has or names
            [*command, "-o", str(partial)],
            input=source,
            capture_output=True,
            text=True,
            check=False,
            start_new_session=True,  # no Ctrl-C of a terminal
        )
        if made.returncode:
            raise OSError(made.stderr.strip() or f"it ended with code {made.returncode}")
        partial.replace(target)
    with suppress(OSError):  # another process tidies as well, or the folder is another's
        os.utime(target)
        libraries = sorted(target.parent.glob("*.so"), key=lambda path: path.stat().st_mtime)
        for path in libraries[:-KEPT]:  # those that were not used for longest
            path.unlink(missing_ok=True)
    return target


def _compiler() -> list[str] | None:
    """The command, as the environment or the machine has it."""
    asked = os.environ.get("FEMFIT_COMPILER")
    for name, *flags in [["cc"], ["gcc"], ["clang"]] if asked is None else filter(None, [shlex.split(asked)]):
        if compiler := shutil.which(name):
            return [compiler, *flags, *FLAGS]
    if asked and asked.strip():
        _warn(f"{asked} is not found")
    return None


def _warn(cause: str) -> None:
    warnings.warn(
        f"A function is not compiled, and up to ten times slower, as the C compiler must make a library of it in the "
        f"cache folder {_folder()}: {cause[:300]}. Set FEMFIT_COMPILER to another compiler, or to nothing to do "
        "without.",
        RuntimeWarning,
        stacklevel=2,
    )


def _folder() -> Path:
    place = os.environ.get("XDG_CACHE_HOME") or os.environ.get("LOCALAPPDATA")
    return (Path(place) if place else Path.home() / ".cache") / "femfit"
