"""The constants of what to measure next, each with its kind and source.

The kinds are those of :mod:`femfit.identify.constants`.
"""

import math

from scipy import stats

from femfit.identify.decision.constants import IN_CLASS

ALMOST_SURELY = float(stats.norm.isf(0.05))
"""Conventional: what is promised holds in 19 of 20 campaigns."""

HINTS = ALMOST_SURELY
"""Conventional: standard deviations from which two explanations expect different direct readings, one-sided at 95 %,
though sizes that are known badly do not let it be promised that the reading settles it."""

VISIBLE = 4.0
"""Conventional: standard deviations from which a whole signal is seen, where nobody asks for its form."""

GUESSED_NOISE = 2e-3
"""Assumed: noise of a channel that was never measured and has none declared, over its largest reading in the validity
domain."""

LARGEST_BENDING = 0.5
"""Assumed: what first-order columns at the trial values of the nonlinear parameters leave of a signal, a refit of these
parameters may lower from up to this share."""

SMALL = 3.0
"""Conventional: a small effect in a plan, over the smallest that the plan would show."""

NEAR_SHARE, DISTANCES, CURRENTS = 0.25, 24, 6
"""Assumed: a usual sweep has so many distances and currents; most effects are largest in its nearest quarter."""

A_DECADE, IMPEDANCE_DISTANCES = 10, 6
"""Assumed: frequencies of a decade, and distances of the travel, at which an LCR meter or analyser is read."""

HEATED_K = 30.0
"""Assumed: what a heat gun does to a small part in a minute."""

CHANNEL_COST, HEAT_COST = 60.0, 120.0
"""Assumed: readings of a usual sweep that setting up a further sensor, or heating a part, takes the time of."""

SHOWN, SHOWN_CLAUSES = 3, 3
"""Conventional: measurements that are printed, and clauses of what each separates."""

COMPARED = 6
"""Assumed, for the time that it takes: explanations that are compared pair by pair, the best first."""

VARIANTS = 12
"""Assumed, for the time that it takes: combinations of trial values of two effects' nonlinear parameters."""

TIE = 2.0 * math.log(1.0 / IN_CLASS)
"""Derived: difference of the weighted sums of squares within which two explanations stay in one class."""

NONLINEAR_PRICE = 0.5
"""Assumed: price of a nonlinear parameter over that of an amplitude, which is ln M (derived; Schwarz, 1978)."""
