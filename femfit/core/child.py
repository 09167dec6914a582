"""A function in a process of its own, for libraries in C that a damaged file makes crash, hang or fill the memory.

Such a library holds the interpreter's lock while it hangs: neither a thread nor a signal's handler could end it from
inside.
"""

import math
import os
import pickle
import resource
import signal
import subprocess
import sys
from collections.abc import Callable
from typing import Any

from femfit.core.errors import FemfitError

_GRACE_S = 2
"""After which an alarm ends a child whose parent was killed and cannot. Chosen."""


class ChildError(Exception):
    """A child that died or took too long, or whose function failed; callers say more than its bare reason."""


def in_child(function: Callable[..., Any], *arguments: Any, timeout: float, memory: float) -> Any:
    """Call a function in a child process of so many bytes, which is killed after ``timeout`` s and by a Ctrl-C here.

    The function is imported there by its name; it, its arguments and its result must be picklable. An error of femfit
    is raised as it is, each other one as ChildError, too little memory as MemoryError.
    """
    limits = [str(math.ceil(timeout) + _GRACE_S), str(math.ceil(memory))]
    command = [sys.executable, "-P", "-m", "femfit.core.child", *limits]
    task = pickle.dumps((function, arguments))
    # Libraries are found as here; a thread of linear algebra for each core would take the memory alone
    settings = {"PYTHONPATH": os.pathsep.join(map(str, sys.path)), "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    try:
        child = subprocess.run(  # noqa: S603 - our own
            command, input=task, capture_output=True, timeout=timeout, check=False, env={**os.environ, **settings}
        )
    except subprocess.TimeoutExpired as error:
        raise ChildError(f"no end within {timeout:.0f} s") from error
    if child.returncode:
        how = f"signal {-child.returncode}" if child.returncode < 0 else f"code {child.returncode}"
        raise ChildError(f"the library that reads it ended with {how}")
    result, failure = pickle.loads(child.stdout)  # noqa: S301 - our own child wrote it
    if failure is not None:
        raise failure if isinstance(failure, FemfitError | MemoryError) else ChildError(failure)
    return result


def _answer() -> None:
    """Call what the parent asks for on standard input, and write its result and its error to standard output."""
    seconds, memory = map(int, sys.argv[1:])
    signal.alarm(seconds)  # the kernel's own end of this process, which no library holds up
    hard = resource.getrlimit(resource.RLIMIT_AS)[1]  # which no process may raise
    memory = memory if hard == resource.RLIM_INFINITY else min(memory, hard)
    resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    with os.fdopen(os.dup(1), "wb") as out:
        os.dup2(2, 1)  # what a library prints is no answer
        function, arguments = pickle.load(sys.stdin.buffer)  # noqa: S301 - our own parent wrote it
        try:
            answer = pickle.dumps((function(*arguments), None))
        except FemfitError as error:
            answer = pickle.dumps((None, error))
        except MemoryError:
            answer = pickle.dumps((None, MemoryError(f"{memory / 1e9:.3g} GB")))
        except Exception as error:  # noqa: BLE001  whatever a library raises; its own classes may not be picklable
            answer = pickle.dumps((None, f"{type(error).__name__}: {error}"))
        out.write(answer)


if __name__ == "__main__":
    _answer()
