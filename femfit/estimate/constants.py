"""Numbers that several files of this room, its templates or other rooms decide by, each with its kind and source.

Kinds: *derived* (from what is said), *conventional* (a usual choice, any near it would do), *calibrated* (on data that
are named). *Assumed* ones were not varied. Those that one file decides by stand there.
"""

TEST_SAMPLES = 20
"""Conventional: samples of a period of a test voltage, of which the filter sees both slopes of the current."""

BLOCK = 8
"""Conventional: samples whose mean tells where the body stands."""

STILL = 3.0
"""Conventional: a body stands still while such means stay within so many standard deviations of one sample. Means of
white noise do so in all but one of 1e16 cases; the margin is for the slow noise that sensors of position have."""

DECISIVE = 5.0
"""Conventional: standard deviations by which a balance must miss, since many windows are looked at."""

AT_STOP = 0.02
"""Conventional: part of the validity domain within which a body at rest counts as on a stop."""

DIFFERENCE_ORDER, LEAST_DIFFERENCES = 3, 100
"""Conventional: differences of the third order leave next to nothing of a smooth misfit; a hundred say it to 11 %."""

SPIKE = 6.0
"""Assumed: standard deviations beyond which a difference is a spike."""

NOISE_SAMPLES = 20_000
"""Conventional: samples that the search for the noise looks at, from the first stretch on."""

LEAST_JUDGED = 60
"""Conventional: readings from which innovations are judged and a noise is sought; 60 tell a deviation to 9 %."""
