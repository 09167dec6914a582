"""Functions as machine code, where the machine has a C compiler.

CasADi writes what is called often as C, a compiler translates it in the background; what runs it today goes on until
that is done, and for good where nothing comes of it. All do the same operations on doubles in the same order (none are
contracted) with the system's library of mathematics: their results agree to the bit, and it does not matter which of
them gave a number.

What was compiled is kept under the hash of its source and command, in the user's cache folder: ``femfit`` in
``XDG_CACHE_HOME`` or ``LOCALAPPDATA``, else in ``~/.cache``. The environment's ``FEMFIT_COMPILER`` names another
compiler than ``cc``, ``gcc`` or ``clang``; where it is empty, nothing is compiled.
"""

import atexit
import ctypes
import hashlib
import os
import platform
import shlex
import shutil
import signal
import subprocess
import threading
import warnings
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from math import inf
from pathlib import Path
from tempfile import mkdtemp

import casadi as ca
import numpy as np

from femfit.core.numerics import FloatArray

FLAGS = ("-O1", "-ffp-contract=off", "-shared", "-fPIC", "-x", "c", "-", "-lm")
"""Measured: more optimisation takes twice the time and makes nothing quicker."""

OFTEN, ASKED = 50_000, 5_000
"""Chosen: points in arrays from which a function is compiled, and between two looks at whether that is done."""

ALONE = 10
"""Measured: as many points in arrays cost what one point alone does."""

LARGEST = 2_000_000
"""Chosen: characters of C up to which a compiler takes tens of seconds at most; beyond, minutes."""

KEPT = 200
"""Conventional: compiled functions that stay in the cache; the one not used for longest goes first."""


_POINTS = """
CASADI_SYMBOL_EXPORT int f_points(casadi_int n, const double** x, const casadi_int* strides, double* y,
    const double** arg, double** res, casadi_int* iw, double* w) {{
  static const casadi_int sizes[] = {{ {sizes} }};
  double in[{total}], out[{rows}];
  casadi_int i, j, k;
  for (k = 0; k < n; k++) {{
    double* to = in;
    for (i = 0; i < {count}; i++) {{
      const double* from = x[i] + k * strides[2 * i + 1];
      arg[i] = to;
      for (j = 0; j < sizes[i]; j++, from += strides[2 * i]) *to++ = *from;
    }}
    res[0] = out;
    if (f(arg, res, iw, w, 0)) return 1;
    for (j = 0; j < {rows}; j++) y[j * n + k] = out[j];
  }}
  return 0;
}}
"""


class Library:
    """A compiled function of vectors."""

    def __init__(self, path: Path, rows: int) -> None:
        self.function = ca.external("f", str(path))
        self._rows, library = rows, ctypes.CDLL(str(path))
        sizes = (ctypes.c_longlong * 4)()
        library.f_work(*(ctypes.byref(sizes, 8 * k) for k in range(4)))
        self._points, self._work = library.f_points, tuple(int(size) + 1 for size in sizes)
        self._points.argtypes = [ctypes.c_longlong, *[ctypes.c_void_p] * 7]

    def __call__(self, inputs: Sequence[FloatArray], count: int) -> FloatArray:
        """The output (entries, count) of inputs (entries, count), or (entries,) where one holds for all points."""
        inputs = [np.asarray(x, dtype=np.float64) for x in inputs]
        inputs = [x if all(step % 8 == 0 for step in x.strides) else np.ascontiguousarray(x) for x in inputs]
        places = np.array([x.ctypes.data for x in inputs], dtype=np.int64)
        strides = [x.strides if x.ndim == 2 and x.shape[1] > 1 else (x.strides[0], 0) for x in inputs]
        steps, result = np.array(strides, dtype=np.int64) // 8, np.empty((self._rows, count))
        work = [np.empty(size) for size in self._work]  # eight bytes each: pointers, integers, doubles
        arrays = [places, steps, result, *work]
        if self._points(count, *(array.ctypes.data for array in arrays)):
            raise FloatingPointError(
                "A compiled function could not be worked out."
            )  # CasADi's functions of SX always can
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
        self._compiler: _Compiler | None = None
        self._lock = threading.Lock()
        self._library: Library | None = None
        self._points, self._next = 0, float(OFTEN)

    @cached_property
    def function(self) -> ca.Function:
        """What is compiled."""
        function = self._make()
        if function.name() != "f":
            raise ValueError(f"A function that is compiled must be named f; instead received {function.name()}.")
        return function

    def after(self, points: int) -> Library | None:
        """The library, as soon as there is one, after so many more points."""
        self._points += points
        if self._points >= self._next and self._lock.acquire(blocking=False):  # else another thread sees to it
            try:
                self._look()
            finally:
                self._lock.release()
        return self._library

    def _look(self) -> None:
        """Begin, or see whether it is done."""
        self._next = inf
        try:
            if self._command is None or len(self._source) > LARGEST:
                return
            if self._compiler is not None and self._compiler.process != os.getpid():
                self._forget()  # that of a process from which this one was forked
            if self._compiler is not None and (code := self._compiler.popen.poll()) is not None:
                self._keep(code)
            if _is_whole(self._target):  # by this process or another
                self._stop()
                self._library = Library(self._target, self.function.nnz_out(0))
            elif self._compiler is None:
                self._begin()
            if self._library is None:
                self._next = self._points + ASKED
            else:
                self.__dict__.pop("_source", None)
                _tidy(self._target)
        except (
            OSError,
            RuntimeError,
            AttributeError,
        ) as error:  # the cache cannot be written, what lies there is not a library
            self._warn(str(error))

    @cached_property
    def _command(self) -> list[str] | None:
        asked = os.environ.get("FEMFIT_COMPILER")
        commands = [[name] for name in ("cc", "gcc", "clang")] if asked is None else [shlex.split(asked)]
        for name, *flags in filter(None, commands):
            if compiler := shutil.which(name):
                return [compiler, *flags, *FLAGS]
        if asked and asked.strip():
            self._warn(f"{asked} is not found", asked)
        return None

    @cached_property
    def _source(self) -> str:
        generator = ca.CodeGenerator("f.c")
        generator.add(self.function)
        f = self.function
        sizes = [f.nnz_in(k) for k in range(f.n_in())]
        facts = {"sizes": ", ".join(map(str, sizes)), "count": len(sizes)}
        facts |= {"total": sum(sizes) + 1, "rows": f.nnz_out(0)}
        return str(generator.dump()) + _POINTS.format(**facts)

    @cached_property
    def _target(self) -> Path:
        command = [*(self._command or ()), platform.system(), platform.machine()]
        name = hashlib.sha256("\n".join([*command, self._source]).encode()).hexdigest()[:32]
        return _folder() / f"{name}.so"

    @cached_property
    def _workplace(self) -> Path:
        return Path(mkdtemp(prefix="compiling-", dir=self._target.parent))

    def _begin(self) -> None:
        """Start the compiler, one in a process at a time."""
        with _ONE_COMPILER:
            if any(compiler.works() for compiler in _COMPILERS):
                return
            self._target.parent.mkdir(parents=True, exist_ok=True)
            place = self._workplace
            (place / "f.c").write_text(self._source, encoding="utf-8")
            with (place / "f.c").open() as source, (place / "said.txt").open("w") as said:
                popen = subprocess.Popen(  # noqa: S603  the compiler that the user has or names
                    [*(self._command or ()), "-o", str(place / "f.so")],
                    stdin=source,
                    stdout=said,
                    stderr=said,
                    text=True,
                    start_new_session=True,
                )
            self._compiler = _Compiler(popen, os.getpid())
            _COMPILERS[:] = [self._compiler]
        atexit.register(self._stop)

    def _keep(self, code: int) -> None:
        """Move what the compiler made to where all find it whole or not at all."""
        place = self._workplace
        said = (place / "said.txt").read_text(encoding="utf-8", errors="replace").strip()
        if code == 0:
            with (place / "f.so").open("r+b") as library:
                library.write(hashlib.sha256(library.read()).digest())
                library.flush()
                os.fsync(library.fileno())
            (place / "f.so").replace(self._target)
        self._stop()
        if code:
            raise OSError(said or f"it ended with code {code}")

    def _warn(self, cause: str, compiler: str = "") -> None:
        compiler = compiler or (self._command or ["?"])[0]
        warnings.warn(
            f"A function is not compiled, and about ten times slower, as the C compiler {compiler} "
            f"must make a library of it in the cache folder: {cause[:300]}. Set FEMFIT_COMPILER to another compiler, "
            "or to nothing to do without.",
            RuntimeWarning,
            stacklevel=2,
        )

    def _stop(self) -> None:
        """Leave neither a compiler at work nor what it wrote; those of another process are that one's."""
        if self._compiler is None or self._compiler.process != os.getpid():
            return
        atexit.unregister(self._stop)
        self._compiler.stop()
        shutil.rmtree(self._workplace, ignore_errors=True)

    def _forget(self) -> None:
        """Begin anew, without what belongs to the process from which this one was forked."""
        self._compiler = None
        self.__dict__.pop("_workplace", None)


@dataclass
class _Compiler:
    """A compiler at work, and the process that started it."""

    popen: subprocess.Popen[str]
    process: int

    def works(self) -> bool:
        """Whether it is this process's, and not done."""
        return self.process == os.getpid() and self.popen.poll() is None

    def stop(self) -> None:
        """End it, and what it started itself."""
        if not self.works():
            return
        if hasattr(os, "killpg"):
            with suppress(ProcessLookupError):
                os.killpg(self.popen.pid, signal.SIGKILL)
        self.popen.kill()
        self.popen.wait()


_COMPILERS: list[_Compiler] = []
_ONE_COMPILER = threading.Lock()
"""The process's last compiler, and who may start the next."""


def _after_fork() -> None:
    global _ONE_COMPILER  # noqa: PLW0603  a thread that the child does not have may hold it
    _ONE_COMPILER = threading.Lock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)


def _is_whole(library: Path) -> bool:
    """Whether a library ends with the digest of what is before: of a part of one the process would die."""
    try:
        content = library.read_bytes()
    except FileNotFoundError:
        return False
    length = hashlib.sha256().digest_size
    return content[-length:] == hashlib.sha256(content[:-length]).digest()


def _tidy(used: Path) -> None:
    """Note that a library was used, and drop those that were not for longest."""
    with suppress(OSError):  # another process tidies as well, or the folder is another's
        os.utime(used)
        libraries = sorted(used.parent.glob("*.so"), key=lambda path: path.stat().st_mtime)
        for path in libraries[:-KEPT]:
            path.unlink(missing_ok=True)


def _folder() -> Path:
    place = os.environ.get("XDG_CACHE_HOME") or os.environ.get("LOCALAPPDATA")
    return (Path(place) if place else Path.home() / ".cache") / "femfit"
