"""Every number that decides what a filter believes before it has seen a reading, with its kind and source.

Kinds: *derived* (from what is said), *conventional* (a usual choice, any near it would do), *calibrated* (on data that
are named).

Every number that decides what stands in a record, with its kind and source.

Kinds: *derived* (from what is said), *conventional* (a usual choice, any near it would do), *calibrated* (on data that
are named). *Assumed* ones were not varied.

Every number that decides how a record is run through a filter and judged, with its kind and source.

Kinds: *derived* (from what is said), *conventional* (a usual choice, any near it would do), *calibrated* (on data that
are named).
"""

UNKNOWN_FORCE_ERROR = 1e-3
"""Conventional: force error over the weight where the model file records no misfit, the fit's own target."""

DRIVER_ERROR = 1e-3
"""Derived: error of the winding's voltage over the driver's largest, one step of a pulse-width modulator of 10 bits."""

BIAS_DENSITY = 1e-3
"""Conventional: random walk of the Hall element's quiescent voltage in V / sqrt(s), 8 mV in a minute; a ratiometric
linear element drifts by some 10 mV over its temperature range (Allegro A1321 data sheet) within minutes of warming."""

OWN_VARIANCE = 1e-12
"""Conventional: what an effect's state gains in a step on its own, small beside its size of one: Q is definite."""

OWN_SHARE = 0.01
"""Conventional: part of the variance of an effect's state that does not follow the current, so that Q is definite."""

UNKNOWN_EDDY_ERROR = 0.01
"""Conventional: part by which eddy currents are off where their model does not say it, the error that a reduction is
asked for."""

LEAST_EDDY_SHARE = 1e-6
"""Numerical: deviation of a pattern's current over the largest of them, so that a covariance is definite."""

BIAS_DEVIATION_V = 0.02
"""Conventional: first standard deviation of the Hall offset; the data sheet of a ratiometric linear element allows at
most +-75 mV (Allegro A1321: quiescent output 2.425 to 2.575 V)."""

BIAS_SHARE, BIAS_SHARE_PER_ROOT_S = 0.01, 5e-4
"""Conventional: first standard deviation of another sensor's bias over the span of its readings in the validity domain,
and the random walk of the bias in a second; the ratio of the two is that of the Hall element's."""

FIRST_DEVIATION_M = 1e-3
"""Conventional: first standard deviation of the distance of a body that is put on a support by hand; at most that of a
body that lies anywhere on its way with the same probability, the way over the root of twelve (derived)."""

FIRST_VELOCITY_M_S, FIRST_CURRENT_A = 0.05, 0.1
"""Conventional: first standard deviations of velocity and current of a body near rest."""

OBSERVED_SHARE = 0.5
"""Conventional: a state counts as told by the sensors where its error falls below this share of the first one."""

SETTLING_STEPS = 2000
"""Conventional: samples after which the bound of a body held still is stated."""

TEST_SAMPLES = 20
"""Conventional: samples of a period of a test voltage, of which the filter sees both slopes of the current."""

NEAREST, FARTHEST = 0.5, 2.0
"""Conventional: an estimate is lost below half the smallest or above twice the largest distance of the model's validity
domain. The fit's polynomials continue a little outside of it, which a filter needs while it acquires, and mean nothing
further out; a cubic spline that is continued over half a domain is usually off by its own size."""

FAR_OFF = 1e4
"""Conventional: first deviations beyond which an eddy current, an effect's state or a bias is none that a model has."""

BAND_99_9 = 10.828
"""Derived: 99.9 % quantile of chi-square with one degree of freedom."""

DIVERGENCE_STEPS = 200
"""Conventional: a run is named INNOVATIONS_OUT_OF_BAND once more than half of its last (exponentially weighted) so many
innovations left their 99.9 % band; a true filter leaves it once in a thousand steps."""

MOST_DELAYED_SAMPLES = 100
"""Conventional: samples by which a sensor may be late; each of them is a state of the filter."""

DELAYED_NOISE = 1e-3
"""Numerical: process noise of a remembered value over what its reading's noise makes of it, so that Q is definite."""

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
mean power must be negative by before its polarity is suspected, or less by before it is taken for the current: a body
that is driven from outside gives less back."""

SWAPPED = 3.0
"""Assumed: heat of the drawn resistance over the mean power from which columns are swapped; less is a resistance."""

LOUD = 1.5
"""Derived: times the standard deviation of all readings above which a declared noise is not theirs: that of a hundred
readings of white noise alone is uncertain by 7 %, and a slow noise may last as long as the record."""

SLOWEST_STEP, FASTEST_STEP = 100.0, 1e-6
"""Conventional: times of the model's slowest own time above which a step cannot be filtered, and of its fastest below
which rounding is all that a step changes."""

SHORTEST_PIECE, LONGEST_PIECE = 250, 2000
"""Conventional: samples of a piece of a record; pieces run side by side, and a filter forgets its start within one."""

JOINED, ROUNDING = 1e-12, 1e-15
"""Numerical: a piece begins where the one before ended if no state differs by more than this of its deviation or this
of itself, and no variance by more than the first of itself: the record is then followed sample by sample."""

TURNS = 25
"""Conventional: a filter that has not forgotten its starts after so many turns runs one piece after the other."""

LAGS = 20
"""Conventional: lags of the innovations' autocorrelation, in samples."""

STANDS_STILL = 1e-3
"""Numerical: random walk of a held body's distance in a sample, over the noise of its reading: Q is definite."""

NOISE_SAMPLES = 20_000
"""Conventional: samples that the search for the noise looks at, from the first stretch on."""

NOISE_PIECE, FORGOTTEN = 500, 100
"""Conventional: samples of a piece in the search for the noise, and those at its begin that do not count."""

FORGOTTEN_SHARE = 1.0 / 6.0
"""Conventional: of a record that is shorter than that, the part that does not count."""

LEAST_JUDGED = 60
"""Conventional: readings from which innovations are judged and a noise is sought; 60 tell a deviation to 9 %."""

UNKNOWN = 2.0
"""Conventional: a noise whose logarithm is uncertain by more than this is said to be at most its upper limit."""
