"""Every number that decides what stands in a record, with its kind and source.

Kinds: *derived* (from what is said), *conventional* (a usual choice, any near it would do), *calibrated* (on data that
are named). *Assumed* ones were not varied.
"""

BLOCK = 8
"""Conventional: samples whose mean tells where the body stands."""

STILL = 3.0
"""Conventional: a body stands still while such means stay within so many standard deviations of one sample. Means of
white noise do so in all but one of 1e16 cases; the margin is for the slow noise that sensors of position have."""

LEAST_BLOCKS = 4
"""Conventional: blocks of a rest; fewer are a turning point."""

WRONG_FACTOR = 2.0
"""Conventional: a model is taken to be wrong by less than this factor in its force. A body that stands still where no
such error balances the forces is held; one that could be balanced is taken as free."""

DECISIVE = 5.0
"""Conventional: standard deviations by which a balance must miss, since many windows are looked at."""

AT_STOP = 0.02
"""Conventional: part of the validity domain within which a body at rest counts as on a stop."""

NEARER = 10.0
"""Conventional: logarithm of a likelihood ratio from which one of two explanations is believed (1 to 22,000)."""

OFF = 3.0
"""Conventional: a current within so many standard deviations of zero has stopped."""

FALLING = 12
"""Conventional: samples before a current is lost in its noise, by whose slope it goes on to zero, so many at most."""

FINEST = 1e-7
"""Numerical: part of the validity domain below which a simulated distance is rounding, not noise."""

DIFFERENCE_ORDER, LEAST_DIFFERENCES = 3, 100
"""Conventional: differences of the third order leave next to nothing of a smooth misfit; a hundred say it to 11 %."""

SPIKE = 6.0
"""Assumed: standard deviations beyond which a difference is a spike."""

SAME_STEP = 1e-3
"""Numerical: steps of a converter are equal to this part of one."""

NORMAL_MEDIAN = 0.6745
"""Derived: median magnitude of a standard normal number."""

OFF_GRID = 1.0 / 3.0
"""Conventional: part of the usual step by which a step may miss a multiple of it and still be that multiple."""

MOST_OFF_GRID = 0.05
"""Conventional: part of the steps that may miss by more; of steps of arbitrary length one third does."""

FINEST_PART = 4
"""Conventional: the median step is at most so many grid steps; a record of which more is missing is not resampled."""

FLOWS, AGAINST = 0.1, 0.5
"""Conventional: parts of the largest command or current from which one flows, and of the heat in the winding that the
mean power must be negative by before its polarity is suspected: a body that is driven from outside gives less back."""

SLOWEST_STEP, FASTEST_STEP = 100.0, 1e-6
"""Conventional: times of the model's slowest own time above which a step cannot be filtered, and of its fastest below
which rounding is all that a step changes."""

FLUX_ERROR = 0.1
"""Conventional: part by which a model's change of the flux linkage may be wrong where a resistance is told."""
