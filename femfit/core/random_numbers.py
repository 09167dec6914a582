"""The random generator that a caller asks for: by a seed, by a generator, or none."""

import numpy as np

from femfit.core.errors import DomainError
from femfit.core.quoted import quoted


def random_generator(rng: int | np.random.Generator | None, default: int = 0) -> np.random.Generator:
    """Make a generator from a seed; a generator is returned as it is, and None stands for the default seed.

    Raises
    ------
    DomainError
        If it is neither a generator nor a whole number >= 0.

    Examples
    --------
    >>> random_generator(1).integers(10) == random_generator(None, default=1).integers(10)
    True
    """
    try:
        return np.random.default_rng(default if rng is None else rng)
    except (TypeError, ValueError) as error:
        raise DomainError(
            f"Randomness must be a seed, a whole number >= 0, or a numpy Generator; instead received {quoted(rng)}. "
            "Give 1, say."
        ) from error
