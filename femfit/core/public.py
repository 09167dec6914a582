"""Around every public function: a wrong argument is named, and linear algebra has one thread."""

import functools
import inspect
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from difflib import get_close_matches
from typing import Any

from threadpoolctl import threadpool_limits

from femfit.core.errors import ArgumentError

_LOCK = threading.Lock()
_limits: list[threadpool_limits] = []
"""The limit, once for each call that is at work; the last one to end lifts it."""


def public(function: Callable[..., Any], module: str, name: str) -> Callable[..., Any]:
    """Wrap a function under the public name by which it is called, and found again by pickle.

    ArgumentError says which argument is not the function's, and which name is nearest.
    """
    signature = inspect.signature(function)

    @functools.wraps(function)
    def called(*arguments: Any, **keywords: Any) -> Any:
        try:
            signature.bind(*arguments, **keywords)
        except TypeError as error:
            raise ArgumentError(_wrong_argument(name, signature, keywords, str(error))) from None
        with one_blas_thread():
            return function(*arguments, **keywords)

    called.__module__, called.__qualname__, called.__name__ = module, name, name
    return called


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Let BLAS work with one thread inside of the block, and as before after it.

    femfit's matrices are small. Threads that wait for each other on cores with other work cost up to twenty times the
    time. The limit is the process's: it holds for the caller's own threads too, until the last block ends.
    """
    with _LOCK:
        _limits.append(_limits[-1] if _limits else threadpool_limits(1, user_api="blas"))
    try:
        yield
    finally:
        with _LOCK:
            limit = _limits.pop()
            if not _limits:
                limit.restore_original_limits()


def _wrong_argument(name: str, signature: inspect.Signature, keywords: dict[str, Any], problem: str) -> str:
    accepted = list(signature.parameters)
    for keyword in keywords:
        if keyword not in accepted:
            near = get_close_matches(keyword, accepted, n=1)
            hint = f"Did you mean {near[0]}?" if near else f"It takes {', '.join(accepted)}."
            return f"{name}() has no argument {keyword}. {hint}"
    return f"{name}(): {problem}. It is {name}{_without_types(signature)}."


def _without_types(signature: inspect.Signature) -> str:
    bare = [parameter.replace(annotation=inspect.Parameter.empty) for parameter in signature.parameters.values()]
    return str(inspect.Signature(bare))
