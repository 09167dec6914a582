"""What a drawing's tolerances make of a series: gradients, scatter, and the share of each number.

References
----------
D. H. Evans, Journal of Quality Technology 7 (1975) 1: statistical tolerancing; the scatter of a linear system.
I. M. Sobol, Mathematics and Computers in Simulation 55 (2001) 271: shares of a variance. Of a linear system with
independent numbers, the first-order and the total share are both (slope x standard deviation)^2 over their sum.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from femfit.audit.conclusions import words
from femfit.core.errors import MissingPartError, UsageError
from femfit.core.numerics import FloatArray
from femfit.core.results import Result
from femfit.core.text import amount
from femfit.device.drawn_numbers import NumberFacts
from femfit.tables.sweep_table import SweepTable, current_names, read_sweep_table

SHOWN = 1e-3
"""Conventional: share of the variance from which a number is printed."""


@dataclass(frozen=True)
class NumberShare:
    """What one number of the drawing contributes."""

    number: NumberFacts
    gradient: float  # Of the quantity in its SI unit, per unit of the number, or per one whole of one without a unit
    scatter: float  # Of the quantity in its SI unit, by one standard deviation of the number
    share: float  # Of the variance of a series


@dataclass(frozen=True, eq=False, repr=False)
class ToleranceAnalysis(Result):
    """A quantity at one point of the sweep, and how a series of devices scatters about it.

    Parameters
    ----------
    quantity : str
        ``force_N``, a flux linkage, or ``hall_T``.
    value, scatter : float
        As drawn, and the standard deviation of a series, to first order and with independent numbers.
    shares : tuple of NumberShare
        The largest first.

    Examples
    --------
    >>> import femfit as ff
    >>> ff.analyse_tolerances("runs/rig", distance_m=0.02).scatter  # doctest: +SKIP
    """

    quantity: str
    distance_m: float
    currents_A: tuple[float, ...]
    value: float
    scatter: float
    shares: tuple[NumberShare, ...]

    def __str__(self) -> str:
        return words("tolerance", "tolerance", self, SHOWN)


def analyse_tolerances(
    sweep: SweepTable | str | Path,
    *,
    distance_m: float,
    currents_A: Sequence[float] = (),
    quantity: str = "force_N",
) -> ToleranceAnalysis:
    """Say what the tolerances of a drawing make of a series of devices, at the swept point next to the one given.

    Parameters
    ----------
    sweep : SweepTable or path
        Solved with signatures.
    distance_m : float
        Within the sweep.
    currents_A : sequence of float
        Current, once for each circuit whose current was swept, in the table's order.
    quantity : str
        Quantity with a slope: force_N, flux_linkage_Wb or hall_T.

    Raises
    ------
    MissingPartError
        If the sweep has no signatures.
    UsageError
        If the point lies outside of the sweep, or there is no such quantity.

    Examples
    --------
    >>> import femfit as ff
    >>> table = ff.run_sweep("rig.toml", "runs/rig", signatures=True)  # doctest: +SKIP
    >>> print(ff.analyse_tolerances(table, distance_m=0.02, currents_A=[0.7]))  # doctest: +SKIP
    """
    table = sweep if isinstance(sweep, SweepTable) else read_sweep_table(sweep)
    if table.signatures is None:
        raise MissingPartError("The sweep must have signatures. Sweep the drawing again with --signatures.")
    rows = table.valid_rows()
    settings = ["distance_m", *current_names(rows)]
    swept = rows[settings].to_numpy(dtype=np.float64)
    row = _nearest(swept, settings, distance_m, currents_A)
    point = swept[row]
    if quantity not in table.signatures.channels:
        raise UsageError(f"quantity must be one of {', '.join(table.signatures.channels)}; got {quantity!r}.")
    # The corners of a contour are numbers themselves
    numbers = [number for number in table.signatures.numbers if not number.is_contour]
    gradients = []
    for number in numbers:
        slopes = table.signatures.of(number)
        at_point = np.all(slopes[settings].to_numpy(dtype=np.float64) == point, axis=1)
        gradients.append(float(slopes[quantity].to_numpy()[at_point][0]))
    scatters = [abs(g) * number.tolerance for g, number in zip(gradients, numbers, strict=True)]
    variance = float(np.sum(np.square(scatters)))
    shares = [
        NumberShare(number, g, s, s**2 / variance if variance else 0.0)
        for number, g, s in zip(numbers, gradients, scatters, strict=True)
    ]
    return ToleranceAnalysis(
        quantity,
        float(point[0]),
        tuple(point[1:].tolist()),
        float(rows[quantity].iloc[row]),
        float(np.sqrt(variance)),
        tuple(sorted(shares, key=lambda share: -share.share)),
    )


def _nearest(swept: FloatArray, settings: list[str], distance_m: float, currents_A: Sequence[float]) -> int:
    """The row of the swept point, (rows, settings), next to the one given."""
    varied = [k for k in range(swept.shape[1]) if k == 0 or np.ptp(swept[:, k]) > 0.0]
    if len(currents_A) not in {len(settings) - 1, len(varied) - 1}:
        each = ", ".join(settings[1:])
        raise UsageError(f"currents_A must have one number for each of {each}; got {len(currents_A)}.")
    wanted = swept[0].copy()
    wanted[varied if len(currents_A) == len(varied) - 1 else slice(None)] = [distance_m, *currents_A]
    low, high = swept.min(axis=0), swept.max(axis=0)
    for name, value, least, most in zip(settings, wanted, low, high, strict=True):
        if not least <= value <= most:
            limits = f"{amount(least, name, 4)} to {amount(most, name, 4)}"
            raise UsageError(f"{name} must lie within the sweep, {limits}; got {amount(value, name, 4)}.")
    away = (swept - wanted) / np.where(high > low, high - low, 1.0)
    return int(np.argmin(np.sum(away**2, axis=1)))
