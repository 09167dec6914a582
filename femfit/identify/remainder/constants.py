"""The constants of the remainder, each with its kind as in :mod:`femfit.identify.constants`."""

PRICE = 4.5
"""Conventional: log evidence that a part must add, as three deviations of one number would (9 in chi-square)."""

POSSIBLE = 3.0
"""Conventional: log of the twentieth of the likelihood with which other parts are still possible."""

BEGUN = 0.5
"""Numerical, for the time that it takes: share of the largest evidence of one part from which another begins a set."""

LEAST_SHARE = 0.001
"""Assumed: share of all evidence that a further part must add, for the first one's form is cut to finite cells."""

DEGREE = 4
"""Derived: force gradients and inductance gradients, third derivatives of W', are continuous with quartic splines."""

FIELD_CELLS, CURVE_CELLS, DISTANCE_CELLS = (8, 3), 8, 36
"""Numerical: cells of a function of distance and current, of a curve, and of a curve over the distance, which may have
the period of a stage's screw. Smoothness is chosen by the data; these are the finest that it can be."""

FIELD_SCALES, CURVE_SCALES = ((0.15, 0.4), (0.6, 1.8, 6.0)), (0.15, 0.6)
"""Numerical: correlation lengths that are tried, over the range of the data; the longest is next to a straight line."""

DISTANCE_SCALES = (0.03, 0.1, 0.4)
"""Numerical: the same of a curve over the distance."""

JITTER = 1e-8
"""Numerical: added to the correlation of a coefficient with itself, so that its root exists."""

SIZES = 50
"""Numerical: sizes of a part that are tried, from a tenth of the noise to 1e4 times as much."""

ROUNDS, HALVINGS = 4, 6
"""Numerical: linear steps in which a part is fitted that bends what it acts on (an error of the position), and how
often one is halved until it lowers the penalised sum of squares."""

LINEAR_STEP = 1e-4
"""Numerical: step of a difference, over the range of what a part changes."""

PART_OF_MOST = 0.02
"""Assumed: a brake rises from zero over this part of the largest speed."""

SAID = 0.9
"""Assumed: share of a part's square that a short law must have to be said to be one."""

PER_FACTOR = 0.01
"""Assumed: share that a further factor of a law must add."""

UNMEASURED = 0.1
"""Assumed: part of the range of the data from which a setting was not measured."""

REFITTED, WORTH_A_REFIT = 2, 0.8
"""Numerical, for the time that it takes: how many named effects are refitted, and part of the remainder's fall that one
must reach to first order."""

LEVELS = (31, 11)
"""Numerical: distances and currents at which a measurement is sought that would refute it."""
