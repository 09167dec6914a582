"""The constants of the identification and of the calibration of a drawing, each with its kind and source.

Those of the decision itself are in :mod:`femfit.identify.decision.constants`. *Derived* follows from something else.
*Conventional* is a usual level. *Calibrated* was set by trials with known truth. *Assumed* is an engineer's judgement
with no calibration behind it. *Numerical* bounds rounding or time.
"""

# The test of the model, and of what is named

LEVEL = 0.01
"""Conventional: probability that something is said to be missing where nothing is. Two tests share it (Bonferroni)."""

LEVEL_AFTER = 0.005
"""Conventional: p-value below which a refit has left structure."""

POWER = 0.9
"""Conventional: what data "could have shown" they show nine times in ten."""

BEYOND_NOISE = 3.0
"""Conventional: standard errors of an rms from which it is said to be more than noise makes it."""

WITHIN_NOISE = 1.2
"""Conventional: rms error over the noise of one reading up to which data are explained within their noise."""

# Smooth patterns, the alternatives of the lack-of-fit test

DEGREE, BRANCH_DEGREE = 5, 3
"""Assumed: degrees in log distance and current of a misfit of unknown cause, and of its change with the branch."""

COARSE = (2, 3)
"""Assumed: degrees up to which patterns are tested apart from the finer ones, which would drown a broad misfit."""

FINE_DEGREE = 15
"""Assumed: degree of a misfit that depends on the distance alone, or on the current: a stage's leadscrew has turns."""

FINER = 0.7
"""Assumed: by how much each further degree of an unknown misfit, or of a model's own, is smaller."""

LEAST_READINGS = 6
"""Assumed: a channel of fewer readings is not tested; a third of its readings is as many patterns as it may have."""

LEAST_SPREAD_C = 0.5
"""Assumed: temperatures that vary less (standard deviation) are one temperature."""

SPANNED = 1e-4
"""Numerical: squared sine below which a pattern lies in the fitted columns."""

# A refit, and an effect that is added

ROUNDING = 1e-3
"""Numerical: weighted sums of squares closer than this are equal; a refit stops within it."""

ROUNDED, SEEN_SHARE = 1e-9, 1e-3
"""Numerical: part of a reading up to which a misfit, or an effect over its plausible range, is rounding, and of what an
effect does, up to which that by a constant of its shape over its plausible range does not matter: it is not fitted."""

NEXT_TO_BOUND, AS_GOOD = 1e-2, 1e-2
"""Numerical: a parameter within this of its bound, over its plausible range, stands at it where the weighted sum of
squares, whose standard deviation is 1 and more, rises by no more than this."""

MOST_EVALUATIONS = 60
"""Numerical: steps after which a search is ended; nearly all of them need fewer than twenty."""

FILTER_WORSE = 2.0
"""Conventional: factor by which the mean square of a filter's innovations may move away from 1 by an added effect."""

HARMS = 1.05
"""Assumed: rise of a channel's error on runs left out from which they are not, whatever the other channels gain, and
from which it is said of an effect that is added."""

SETTLED = 2.0
"""Assumed: time constants that the longest run must last for it to show where an effect settles (to 14 %)."""

# The noise

PRIOR_MOUNT_M, PRIOR_RUN = 20e-6, 0.1
"""Assumed: a body put back by hand against a stop comes back to about this (standard deviation), unless the user
declares it; a run's offset over the standard deviation of one reading."""

PRIOR_WEIGHT = 8.0
"""Assumed: a declared error of the distance counts like so many mounts, or stops."""

PRIOR_MEMORY, PRIOR_SHARE = 0.5, 0.1
"""Assumed: scales of half-Cauchy priors: of rho / sqrt(1 - rho^2), how readings follow each other, usually by some
tenths; and of what readings of a setting share beyond smooth patterns, over the standard deviation of one."""

OF_SETTINGS = 0.25
"""Assumed: smooth patterns that are taken out before the noise is sought, over the number of settings."""

LEAST_SHARE, LARGEST_SHARE, SHARES = 0.1, 1000.0, 36
"""Numerical: shares of a setting that are tried, even in their logarithm, beside none."""

ROUNDS = 2
"""Numerical: rounds in which correlations are sought by the variances, and these by the correlations."""

FIXED = 1e3
"""Numerical: size of a random effect, over its usual one, or over a reading's, that is as good as fixed."""

MOST_STOPS = 200
"""Numerical, for the time that it takes: what more stops, mounts or runs differ by is left to readings' scatter."""

MOST_MOUNTS = 48
"""Numerical, for the time that it takes: of more mounts, or runs, so many say the noise of all (to 10 %)."""

LARGEST_UNSEEN = 64.0
"""Assumed: scatter of mounts, runs or stops, over its likeliest or usual size, that is reckoned with at most."""

VARIANCES_TRIED = 37
"""Numerical: values over which a variance is averaged, even in its logarithm, from 512 times below the largest
standard deviation."""

LEAST_REPEATS = 12
"""Conventional: degrees of freedom from which repeats say a channel's noise (to 20 %), and how readings follow each
other; and so many differences of neighbours, of windows, or of halves of stretches."""

LEAST_REPEATS_AGAINST_DECLARED = 4 * LEAST_REPEATS
"""Conventional: a declared noise counts like so many repeats (to 10 %)."""

CONTRADICTED = 0.01
"""Conventional: chance of so different a variance below which repeats contradict a declared noise."""

LARGEST_CORRELATION = 0.95
"""Assumed: readings that follow each other more closely are not noise."""

UNKNOWN_CHANNEL = 1e6
"""Numerical: a channel of unknown noise gets this many times its largest reading, so that it has no weight."""

SAME_SETTING = 1.0 / 400.0
"""Assumed: settings closer than this part of their range were meant to be the same."""

SAME_LINE = 1.0 / 50.0
"""Assumed: settings closer than this part of their range lie on one line, along which a smooth misfit is compared."""

FINEST = 1e-7
"""Numerical: noise of a channel over its largest reading below which products of columns lose it in their rounding."""

SAME_READING = 1e-12
"""Derived: some thousand roundings of a float, over the largest reading."""

EXACT = 1e9
"""Numerical: the weight of a variance that is known."""

CORRELATIONS = 40
"""Numerical: correlations that are tried, even in artanh(rho), which moves the variance of a slow pattern,
(1 + rho) / (1 - rho), by 10 % from one to the next."""

SEARCH_STEPS, LARGEST_STEP, SETTLED_STEP, NO_VARIANCE = 100, 2.0, 1e-5, 1e-6
"""Numerical: steps of the search for variances, the largest and the last in a log variance, and the part of its scale
below which a variance is none."""

FLAT = 1e-6
"""Numerical: curvature of -2 log likelihood in a log variance below which it is flat, and the variance stays."""

SPANNED_SQUARE = 1e-9
"""Numerical: part of a squared length below which a column of mounts or runs is spanned by others."""

# Readings that are set aside or suspected

MOST_ROWS = 5000
"""Numerical: rows of a bench table up to which a comparison takes seconds and less than a gigabyte; time grows with
their cube, memory with their square."""

AVERAGED_TO = 1000
"""Numerical: rows to about which a longer bench table is averaged."""

SHORT = 0.5
"""Assumed: part of the usual length of a stretch below which its few readings, taken on the way, are left out; means of
the others have about one noise."""

MOST_DROPPED = 0.1
"""Assumed: part of the stretches that may be left out as too short; more of them are settings of their own."""

IN_ORDER = 0.75
"""Assumed: part of the current's steps that must agree with the branches where rows stand in the order of measuring."""

# Where the model fails

COVARIATE_SHARE = 0.05
"""Assumed: part of a channel's structure that a covariate must add to be reported."""

LEFT_BY_SHARE, SAME_SHARE = 0.05, 0.25
"""Assumed: a misfit is the same everywhere, or one share of the prediction, where that leaves this part of its square,
and where its size in the smaller half of the readings differs from that in all by less than this part."""

# Impedances

FREQUENCY_SLACK = 0.01
"""Conventional: of a frequency, within which an instrument's and the drawing's are the same."""

AWAY = 0.05
"""Assumed: by how much, in its logarithm, a conductivity may seem wrong since iron was solved about another current."""

LEAST_LINKED = 1e-3
"""Assumed: share of the largest impedance at a setting down to which an instrument's errors go with the magnitude: two
circuits may be hardly linked."""

OF_THREE = 2.45
"""Derived: misfit of Z_1 - Z_12^2 / Z_2 over that of Z_1 where Z_12^2 is about Z_1 Z_2 and each of the three is off by
a same share, independently: the root of 1 + 2^2 + 1."""

MOST_STEPS = 8
"""Numerical: numbers that have not settled after so many sweeps in a row follow no Gauss-Newton step."""

MOST_ROUNDS = 3
"""Numerical: how often what a calibrated drawing leaves is diagnosed again; each round needs a cause of its own."""

CALIBRATION_SETTLED = 0.1
"""Conventional: a step below this part of the standard deviations, root mean square, changes no conclusion."""

RISE = 1.0
"""Numerical: a step after which the weighted sum of squares is more than this larger is taken back and halved; less
changes no conclusion, and meshes differ."""

HALVINGS = 4
"""Numerical: a step that draws what cannot be built is halved so often."""

OPEN = 0.5
"""Conventional: a combination of numbers of whose tolerance, a standard deviation, the data leave more than this is not
said to be determined."""

IN_COMBINATION = 0.1
"""Conventional: numbers with less than this part of the largest share of a combination are left out of its words."""

UNUSUAL = 3.0
"""Conventional: a number that is more tolerances than this from its drawn value is to be checked otherwise."""

# Records over time: windows

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

# The smoothed motion of a record within a window

NODES = 12
"""Numerical: intervals between the nodes of a window."""

SPAN, SLOPE_SPAN, BEHIND = 1.0 / 6.0, 0.5, 0.8
"""Assumed: part of a window on each side of a node whose samples its polynomial is fitted to; the same where its slope
is asked for, which noise disturbs more; and behind a node alone."""

MIDDLE = 1.0 / 3.0
"""Assumed: part of a window that a sensor is averaged over."""

PLAY = 0.05
"""Assumed: part of the validity domain's currents; a current that turns by less has not changed its branch."""

ON_STOP = 0.05
"""Assumed: part of the range of distances by which a stop may stand elsewhere than drawn and still be that stop."""

SLOWEST = 1e-12
"""Numerical: decay over a step below which a state, or a pattern of eddy current, only adds up."""

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

SLOPE_STEP = 1e-3
"""Numerical: step of a difference over the width of a parameter's plausible range."""

# What is left unexplained

HELPS = 9.0
"""Conventional: fall of the weighted error on runs left out from which a remainder is used (three deviations)."""

NEAR_STEPS, WHOLE, LEAST_GAPS = 10.0, 0.05, 5
"""Numerical: gaps between readings of up to so many steps are looked at, are whole to that part of a step, and must be
so many for a step to be known."""
