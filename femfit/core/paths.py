"""What a caller gives as the path of a file or directory."""

from pathlib import Path

from femfit.core.errors import UsageError


def path_of(given: object, what: str) -> Path:
    """Make a path of a text or a path; anything else is a UsageError that says ``what`` it was to be.

    Examples
    --------
    >>> path_of("runs/rig", "A run directory").name
    'rig'
    """
    if not isinstance(given, str | Path):
        raise UsageError(
            f"{what} must be given as a path, a str or a Path; instead received {type(given).__name__}. Give where the "
            "file is."
        )
    return Path(given)
