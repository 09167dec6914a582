"""Functions of one point as machine code, where the machine has a C compiler.

CasADi writes the function as C, a compiler translates it beside the interpreter, which goes on until that is done and
for good where nothing comes of it. Both do the same operations on doubles in the same order (none are contracted), so
that their results agree to the bit and it does not matter which of them gave a number.

What was compiled is kept under the hash of its source and command, in the user's cache folder: ``femfit`` in
``XDG_CACHE_HOME`` or ``LOCALAPPDATA``, else in ``~/.cache``. The environment's ``FEMFIT_COMPILER`` names another
compiler than ``cc``, ``gcc`` or ``clang``; where it is empty, nothing is compiled.
"""

import atexit
import hashlib
import os
import platform
import shutil
import subprocess
import threading
import warnings
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory

import casadi as ca

FLAGS = ("-O1", "-ffp-contract=off", "-shared", "-fPIC", "-x", "c", "-", "-lm")
"""Measured: more optimisation takes twice the time and makes nothing quicker."""

KEPT = 200
"""Conventional: compiled functions that stay in the cache; the one not used for longest goes first."""


class Compilation:
    """A function on its way to machine code.

    Parameters
    ----------
    function : casadi.Function
    """

    def __init__(self, function: ca.Function) -> None:
        self._function = function
        self._compiler: subprocess.Popen[str] | None = None
        self._lock = threading.Lock()

    def result(self) -> ca.Function | None:
        """The compiled function; the function itself where it stays interpreted; None as long as that is open.

        The first call begins.
        """
        if self._command is None:
            return self._function
        if not self._lock.acquire(blocking=False):  # another thread sees to it
            return None
        try:
            return self._looked_for()
        except (OSError, RuntimeError) as error:  # the cache cannot be written, what lies there is not a library
            return self._failed(str(error))
        finally:
            self._lock.release()

    def _looked_for(self) -> ca.Function | None:
        if self._target.exists():
            self._stop()
            return self._loaded()
        if self._compiler is None:
            self._begin()
        elif self._compiler.poll() is not None:
            return self._kept(self._compiler.returncode)
        return None

    @cached_property
    def _command(self) -> list[str] | None:
        asked = os.environ.get("FEMFIT_COMPILER")
        names = ("cc", "gcc", "clang") if asked is None else (asked,)
        compiler = next((path for name in names if name and (path := shutil.which(name))), None)
        return None if compiler is None else [compiler, *FLAGS]

    @cached_property
    def _source(self) -> str:
        generator = ca.CodeGenerator("f.c")
        generator.add(self._function)
        return generator.dump()

    @cached_property
    def _target(self) -> Path:
        command = [*(self._command or ()), platform.system(), platform.machine()]
        name = hashlib.sha256("\n".join([*command, self._source]).encode()).hexdigest()[:32]
        return _folder() / f"{name}.so"

    @cached_property
    def _workplace(self) -> TemporaryDirectory[str]:
        return TemporaryDirectory(prefix="compiling-", dir=self._target.parent, ignore_cleanup_errors=True)

    def _begin(self) -> None:
        self._target.parent.mkdir(parents=True, exist_ok=True)
        place = Path(self._workplace.name)
        (place / "f.c").write_text(self._source, encoding="utf-8")
        with (place / "f.c").open() as source, (place / "said.txt").open("w") as said:
            self._compiler = subprocess.Popen(  # noqa: S603  the compiler that the user has or names
                [*(self._command or ()), "-o", str(place / "f.so")], stdin=source, stdout=said, stderr=said, text=True
            )
        atexit.register(self._stop)

    def _kept(self, code: int) -> ca.Function:
        """What the compiler made, moved to where all find it whole or not at all."""
        place = Path(self._workplace.name)
        said = (place / "said.txt").read_text(encoding="utf-8", errors="replace").strip()
        if code == 0:
            (place / "f.so").replace(self._target)
        self._stop()
        return self._loaded() if code == 0 else self._failed(said or f"it ended with code {code}")

    def _loaded(self) -> ca.Function:
        function = ca.external(self._function.name(), str(self._target))
        os.utime(self._target)
        used = sorted(self._target.parent.glob("*.so"), key=lambda path: path.stat().st_mtime)
        for path in used[:-KEPT]:
            path.unlink(missing_ok=True)
        return function

    def _failed(self, cause: str) -> ca.Function:
        warnings.warn(
            f"A function stays interpreted, about ten times slower, as the C compiler {(self._command or ['?'])[0]} "
            f"must make a library of it in {self._target.parent}: {cause[:300]}. Set FEMFIT_COMPILER to another "
            "compiler, or to nothing to do without.",
            RuntimeWarning,
            stacklevel=2,
        )
        return self._function

    def _stop(self) -> None:
        """Leave neither a compiler at work nor what it wrote."""
        if self._compiler is None:
            return
        atexit.unregister(self._stop)
        if self._compiler.poll() is None:
            self._compiler.kill()
            self._compiler.wait()
        self._workplace.cleanup()


def _folder() -> Path:
    place = os.environ.get("XDG_CACHE_HOME") or os.environ.get("LOCALAPPDATA")
    return (Path(place) if place else Path.home() / ".cache") / "femfit"
