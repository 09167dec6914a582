"""The constants of records over time, of their windows and noise; kinds as in :mod:`femfit.identify.constants`."""

# Windows

LEAST_SAMPLES, USUAL_SAMPLES = 12, 36
"""Derived: in a window, twice what its weights are exact for; and three times that, enough for its middle third."""

TIME_CONSTANTS = 1.5
"""Assumed: length of a window in time constants of the falling body: noise averages out, and the motion is seen."""

LEAST_WINDOWS, MOST_WINDOWS = 120, 1200
"""Assumed: windows of a record; fewer leave few readings, more take long."""

WIDEST_GAP = 1.0 / 6.0
"""Assumed: part of a window that may lie between two of its samples."""

EXACT_DEGREE = 5
"""Assumed: polynomials up to this degree are integrated exactly, whatever the sampling."""

EVEN = 1.5
"""Assumed: a step of the clock longer than this many times the usual one hides commands of the driver."""

ANYWHERE = 0.25
"""Derived: part of a command's change that acts before its sample, halfway from edges at samples to edges anywhere."""

# The smoothed motion within a window

SPAN, SLOPE_SPAN, BEHIND = 1.0 / 6.0, 0.5, 0.8
"""Assumed: part of a window on each side of a node whose samples its polynomial is fitted to; the same where its slope
is asked for, which noise disturbs more; and behind a node alone."""

MIDDLE = 1.0 / 3.0
"""Assumed: part of a window that a sensor is averaged over."""

PLAY = 0.05
"""Assumed: part of the validity domain's currents; a current that turns by less has not changed its branch."""

ON_STOP = 0.05
"""Assumed: part of the range of distances by which a stop may stand elsewhere than drawn and still be that stop."""

# The noise of samples and windows

LEAST_VARIANCE = 0.2
"""Assumed: part of a difference's variance that the removed patterns must leave; it is 2 without them."""

RESTLESS = 1.25
"""Assumed: successive windows that scatter this many times more than the sensors' noise makes have another noise."""

MEDIAN_CHANCE = 3.5
"""Derived: three standard deviations of a median of magnitudes, times the root of their number (Hampel, 1974)."""

METHOD_ACCURACY = 3e-5
"""Derived: error of the balances themselves, over the largest force, voltage and swing of the Hall output: a held
command's kinks of the current in a window of 36 samples."""

TURNS_OF_MISFIT = 5.0
"""Assumed: how often the misfit of a flux linkage turns its sign over the domain."""
