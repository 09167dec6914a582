"""The net under every library that decodes a foreign file: a damaged one is said to be damaged, whatever was raised."""

from collections.abc import Iterator
from contextlib import contextmanager

from femfit.core.errors import FemfitError, TableError
from femfit.core.quoted import quoted


@contextmanager
def decoding(source: object, kind: str) -> Iterator[None]:
    """Turn any exception into a TableError, but for femfit's own and for too little memory.

    Libraries raise over damaged files what their authors never thought of: no list of exceptions is complete.
    """
    try:
        yield
    except (FemfitError, MemoryError):
        raise
    except Exception as error:
        raise TableError(damaged(source, kind, f"{type(error).__name__}: {error}")) from error


def damaged(source: object, kind: str, reason: object) -> str:
    """Say that a file cannot be decoded."""
    return (
        f"{source} cannot be read as {kind}; it seems to be damaged ({quoted(reason, 300)}). Write it again, or export "
        "it as CSV."
    )
