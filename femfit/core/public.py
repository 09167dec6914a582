"""Around every public function: wrong arguments are named, linear algebra has one thread, seeds make generators."""

import functools
import inspect
import os
import sys
import threading
from collections.abc import Callable, Collection, Iterable
from difflib import get_close_matches
from typing import Any

import numpy as np
from threadpoolctl import ThreadpoolController, threadpool_limits

from femfit.core.errors import ArgumentError, DomainError, UsageError
from femfit.core.text import quoted


def public(function: Callable[..., Any], module: str, name: str) -> Callable[..., Any]:
    """Wrap a function under the public name by which it is called, and found again by pickle.

    ArgumentError says which argument is not the function's, and which ones are.
    """
    signature = inspect.signature(function)
    bare = [parameter.replace(annotation=inspect.Parameter.empty) for parameter in signature.parameters.values()]

    @functools.wraps(function)
    def called(*arguments: Any, **keywords: Any) -> Any:
        try:
            signature.bind(*arguments, **keywords)
        except TypeError as error:
            raise ArgumentError(f"{name}(): {error}. It is {name}{inspect.Signature(bare)}.") from None
        with _ONE_BLAS_THREAD:
            return function(*arguments, **keywords)

    called.__module__, called.__qualname__, called.__name__ = module, name, name
    return called


class _OneBlasThread:
    """Lets BLAS work with one thread from the first call that enters until the last one leaves.

    femfit's matrices are small. Threads that wait for each other on cores with other work cost up to twenty times the
    time. The limit is the process's: it holds for the caller's own threads, too.
    """

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.calls = 0
        self.limit: threadpool_limits | None = None

    def __enter__(self) -> None:
        with self.lock:
            self.calls += 1
            if self.limit is None:
                libraries = _libraries(len(sys.modules))
                self.limit = libraries.limit(limits=None, user_api="blas")  # the caller's, noted before it is changed
                libraries.limit(limits=1, user_api="blas")

    def __exit__(self, *error: object) -> None:
        with self.lock:
            self.calls = max(self.calls - 1, 0)  # a child that was forked within a call begins at none
            if self.calls <= 0 and self.limit is not None:
                self.limit.restore_original_limits()
                self.limit = None


@functools.lru_cache(1)
def _libraries(modules: int) -> ThreadpoolController:  # noqa: ARG001  by which one is known to have come
    """The loaded libraries with threads of their own; to search for them takes milliseconds."""
    return ThreadpoolController()


_ONE_BLAS_THREAD = _OneBlasThread()
"""One for the process, as the limit is."""

os.register_at_fork(after_in_child=lambda: _OneBlasThread.__init__(_ONE_BLAS_THREAD))  # calls of threads that are gone


def require_known(what: str, names: Iterable[str], known: Collection[str]) -> None:
    """Refuse names that are none of those that are known, with the one that may be meant.

    Examples
    --------
    >>> require_known("Filter", ["ufk"], ["ukf", "ekf"])
    Traceback (most recent call last):
    femfit.core.errors.UsageError: Did you mean ukf? Filter must be one of ukf, ekf; instead received 'ufk'.
    """
    for name in names:
        if name not in known:
            near = "".join(f"Did you mean {close}? " for close in get_close_matches(name[:200], known, n=1))
            raise UsageError(f"{near}{what} must be one of {', '.join(known)}; instead received {quoted(name)!r}.")


def random_generator(rng: int | np.random.Generator | None) -> np.random.Generator:
    """Make a generator from a seed; a generator is returned as it is, and None stands for the seed 0.

    Raises
    ------
    DomainError
        If it is neither a generator nor a whole number >= 0.

    Examples
    --------
    >>> random_generator(0).integers(10) == random_generator(None).integers(10)
    True
    """
    try:
        return np.random.default_rng(0 if rng is None else rng)
    except (TypeError, ValueError) as error:
        raise DomainError(
            f"Randomness must be a seed, a whole number >= 0, or a numpy Generator; instead received {quoted(rng)}. "
            "Give 1, say."
        ) from error
