"""The points of a parameter sweep: every combination, line by line, or a Latin hypercube.

References
----------
M. D. McKay, R. J. Beckman and W. J. Conover, Technometrics 21 (1979) 239: Latin hypercube sampling.
"""

from collections.abc import Sequence
from itertools import product

import numpy as np

from femfit.device.decimals import decimal_sum
from femfit.device.schema import MAX_AXIS_POINTS, SampledEntry

Value = float | str
"""Of a parameter: a number, or the name of a material."""

Points = tuple[tuple[Value, ...], ...]
"""One tuple a point, one value a parameter."""


def order(value: Value) -> tuple[str, float]:
    """What to sort a parameter's values by: numbers by size, names by letters."""
    return (value, 0.0) if isinstance(value, str) else ("", value)


def shown(value: Value) -> str:
    """A value as a message says it."""
    return value if isinstance(value, str) else f"{value:g}"


def grid_points(values: Sequence[Sequence[Value]], problems: list[str]) -> Points:
    """Every combination, the last parameter fastest."""
    count = int(np.prod([float(len(column)) for column in values]))
    if count > MAX_AXIS_POINTS:
        problems.append(
            f"sweep.parameters must have at most {MAX_AXIS_POINTS} combinations; they have {count}. Give fewer values, "
            'or take design = "latin_hypercube".'
        )
        return ()
    return tuple(product(*values))


def list_points(names: Sequence[str], values: Sequence[Sequence[Value]], problems: list[str]) -> Points:
    """The first values together, the second ones together, and so on."""
    if len({len(column) for column in values}) > 1:
        lengths = ", ".join(f"{name} {len(column)}" for name, column in zip(names, values, strict=True))
        problems.append(
            f'sweep.parameters must have equally many values for design = "list"; they are {lengths}. Complete the '
            'lists, or take design = "grid".'
        )
        return ()
    return tuple(zip(*values, strict=True))


def latin_hypercube(ranges: Sequence[SampledEntry | Sequence[str]], samples: int, seed: int) -> Points:
    """Samples of which each of equally many slices of every range holds one.

    Returns
    -------
    tuple of tuple of float or str
        With a step, values are those of the steps whose equal shares of the range the samples fall into.
    """
    from scipy.stats import qmc  # noqa: PLC0415  half a second that other actuator files need not spend

    shares = qmc.LatinHypercube(len(ranges), rng=np.random.default_rng(seed)).random(samples)
    return tuple(
        tuple(_at_share(entry, float(share)) for entry, share in zip(ranges, row, strict=True)) for row in shares
    )


def _at_share(entry: SampledEntry | Sequence[str], share: float) -> Value:
    if not isinstance(entry, SampledEntry):
        return entry[int(share * len(entry))]
    if entry.step is None:
        return entry.min + share * (entry.max - entry.min)
    steps = round((entry.max - entry.min) / entry.step)
    return decimal_sum(entry.min, min(int(share * (steps + 1)), steps), entry.step)
