"""Tables 1 to 3 of the paper, as printed.

References
----------
P. Arpaia et al., Sensors 22 (2022) 182, Tables 1 to 3.
"""

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Printed:
    """A method's figures in the paper at 3.2, 32 and 100 A/s; None where it has none.

    Parameters
    ----------
    drift : tuple of float
        Table 2, 1/s, from the first flat-top's beginning.
    """

    offset_mean: tuple[float, float, float] | None
    offset_range: tuple[tuple[float, float], ...] | None
    drift: tuple[float, float, float]
    uncertainty_end: tuple[float, float, float]


PAPER: Mapping[str, Printed] = {
    "trapezoid": Printed(None, None, (112.14e-6, 119.98e-6, 59.90e-6), (194.48e-3, 104.23e-3, 60.34e-3)),
    "ffa1": Printed((3.3e-6, 6.8e-6, 6.8e-6), None, (59.25e-6, 8.03e-6, 53.02e-6), (100.25e-3, 9.38e-3, 25.97e-3)),
    "ffa2": Printed(
        (6.0e-6, 6.9e-6, 4.6e-6),
        ((-1e-6, 14e-6), (1e-6, 16e-6), (-1e-6, 24e-6)),
        (55.47e-6, 5.05e-6, 2.95e-6),
        (37.57e-3, 6.53e-3, 5.53e-3),
    ),
    "cs1": Printed(
        (6.9e-6, 7.2e-6, 4.4e-6),
        ((-1e-6, 19e-6), (-3e-6, 17e-6), (-11e-6, 24e-6)),
        (0.03e-6, 0.04e-6, 0.03e-6),
        (65e-6, 65e-6, 65e-6),
    ),
    "cs2": Printed(
        (6.9e-6, 7.2e-6, 4.4e-6),
        ((-29e-6, 122e-6), (-129e-6, 412e-6), (-250e-6, 496e-6)),
        (0.02e-6, 0.03e-6, 0.08e-6),
        (667e-6, 533e-6, 482e-6),
    ),
}
"""Tables 1 to 3 as printed."""
