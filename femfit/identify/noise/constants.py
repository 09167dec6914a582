"""Constants of the noise model, each with its kind and source.

*Derived* follows from something else, *conventional* is a usual level, *assumed* is an engineer's judgement with no
calibration behind it.
"""

PRIOR_MOUNT_M = 20e-6
"""Assumed: a body put back by hand against a stop comes back to about this (standard deviation)."""

PRIOR_MOUNT_DOF = 6.0
"""Assumed: that judgement counts like so many mounts."""

PRIOR_RUN = 0.1
"""Assumed: a run's offset over the standard deviation of one reading."""

PRIOR_RUN_DOF = 4.0
"""Assumed: that judgement counts like so many runs."""

LEAST_REPEATS = 12
"""Conventional: degrees of freedom from which repeats say a channel's noise (to 20 %)."""

LEAST_REPEATS_AGAINST_DECLARED = 4 * LEAST_REPEATS
"""Conventional: the same where the noise is declared, so that repeats (to 10 %) replace what is declared."""

LARGEST_CORRELATION = 0.95
"""Assumed: readings that follow each other more closely are not noise."""

CORRELATION_PRICE = 0.5
"""Assumed: a quarter of Akaike's price of 2 for a parameter, so that one that repeats show is rarely dropped."""

TEST_LEVEL = 2.5e-4
"""Derived: one tail of the decision's level, 0.01, over some twenty effects; there a test's normal quantile is replaced
by Student's, for scatter that is known from few mounts or runs."""

UNKNOWN_CHANNEL = 1e6
"""Assumed: a channel of unknown noise gets this many times the largest known one, so that it has no weight."""

SAME_SETTING = 1.0 / 400.0
"""Assumed: settings closer than this part of their range were meant to be the same."""

SAME_LINE = 1.0 / 50.0
"""Assumed: settings closer than this part of their range lie on one line, along which a smooth misfit is compared."""

LEAST_NEIGHBOURS = 12
"""Conventional: pseudo-residuals from which smoothness is let guess a noise, as many as repeats must be."""

GUESS_WIDER = 1.5
"""Calibrated (November 2026): clean single sweeps of a levitated magnet, a voice coil and a lifting magnet, 8 x 6
settings, noise of successive readings independent and correlated by 0.5: something was missing in 0 of 240, at most
1.2 %."""
