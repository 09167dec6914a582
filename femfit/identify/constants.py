"""The constants of the identification and of the calibration of a drawing, each with its kind and source.

*Derived* follows from something else. *Conventional* is a usual level. *Calibrated* was set by trials with known truth,
as the text says. *Assumed* is an engineer's judgement with no calibration behind it. *Numerical* bounds rounding or
time; such ones stand beside their algorithm, and here what several share. Those of records over time stand in
:mod:`femfit.identify.series.constants`.
"""

import math

from scipy import stats

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

# A refit, and an effect that is added

ROUNDING = 1e-3
"""Numerical: weighted sums of squares closer than this are equal; a refit stops within it."""

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

LARGEST_UNSEEN = 64.0
"""Assumed: scatter of mounts, runs or stops, over its likeliest or usual size, that is reckoned with at most."""

LEAST_REPEATS = 12
"""Conventional: degrees of freedom from which repeats say a channel's noise (to 20 %), and how readings follow each
other; and so many differences of neighbours, of windows, or of halves of stretches."""

LEAST_REPEATS_AGAINST_DECLARED = 4 * LEAST_REPEATS
"""Conventional: a declared noise counts like so many repeats (to 10 %)."""

CONTRADICTED = 0.01
"""Conventional: chance of so different a variance below which repeats contradict a declared noise."""

LARGEST_CORRELATION = 0.95
"""Assumed: readings that follow each other more closely are not noise."""

SAME_SETTING = 1.0 / 400.0
"""Assumed: settings closer than this part of their range were meant to be the same."""

SAME_LINE = 1.0 / 50.0
"""Assumed: settings closer than this part of their range lie on one line, along which a smooth misfit is compared."""

# Readings that are set aside or suspected

MOST_ROWS = 5000
"""Numerical: rows of a bench table up to which a comparison takes seconds and less than a gigabyte; time grows with
their cube, memory with their square."""

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

# A drawing that is calibrated

CALIBRATION_SETTLED = 0.1
"""Conventional: a step below this part of the standard errors, root mean square, changes no conclusion."""

OPEN = 0.5
"""Conventional: a combination of numbers of whose tolerance, a standard deviation, the data leave more than this is not
said to be determined."""

IN_COMBINATION = 0.1
"""Conventional: numbers with less than this part of the largest share of a combination are left out of its words."""

UNUSUAL = 3.0
"""Conventional: a number that is more tolerances than this from its drawn value is to be checked otherwise."""

# What is left unexplained

HELPS = 9.0
"""Conventional: fall of the weighted error on runs left out from which a remainder is used (three deviations)."""

# The decision what is missing, and what to measure next

EXPECTED_EFFECTS = 1.0
"""Assumed: how many of all known effects a bench has on average before it is looked at, each as likely as any other."""

LIKELIEST = 0.1
"""Assumed: prior probability of an effect that few others are considered beside, at most."""

UNKNOWN_CAUSE = 0.02
"""Assumed: prior probability of a smooth misfit that no known effect makes."""

FORM = {"magnetics": 0.1}
FORM_ELSEWHERE = 0.02
"""Assumed: standard error of an effect's form, as a part of its size: a magnetic one is known to a tenth."""

FORM_SPREAD = (0.0, 0.3, 1.0, 3.0)
"""Assumed: factors on it, equally likely; the first is an exact form."""

FORM_DEGREE = 3
"""Assumed: degree in distance and current of a form's error."""

UNKNOWN_SIZES = (3.0, 10.0, 30.0, 100.0, 300.0)
"""Assumed: lengths of an unknown misfit's patterns, in standard deviations, equally likely."""

BROAD = (0, 1, 2, 3)
"""Assumed: degrees up to which an unknown misfit of one channel, or of all, may go alone."""

SHARE_DEGREE = 2
"""Assumed: degree in distance and current of an unknown misfit that is a share of the prediction."""

IN_PART = 0.1
"""Assumed: prior probability that an effect begins or ends between two runs, each as likely as any other."""

READINGS_OF_A_STOP = 3
"""Assumed: rows for each stop of the stage from which an error of each stop cannot explain just anything."""

CREEP_DEGREE = 3
"""Assumed: degree in the order of the rows up to which a sensor's zero creeps."""

STILL_THE_NOISE = 0.8
"""Assumed: part of a standard deviation down to which what is named leaves the noise as it was: as well as the noise of
forty readings is known, and mounts and runs far less."""

NOTHING_MISSING = 0.1
"""Calibrated: probability of nothing missing down to which nothing is named."""

IN_CLASS = 0.01
"""Calibrated: probability over that of what is named from which an exchange for it belongs to its class."""

TIED = 1.0 / 3.0
"""Conventional: probability over that of what is named from which another cause is as likely: odds of up to three are
not worth more than a bare mention (R. E. Kass and A. E. Raftery, Journal of the American Statistical Association 90
(1995) 773)."""

OWN_MISFIT = 2.0
"""Conventional: times a model's misfit to its own table up to which an error is not told from it: two standard
deviations."""

RIVALS = 2.0
"""Conventional: times the squared misfit that the best leaves up to which another effect explains as much."""

EXPLAINED = 0.5
"""Conventional: part of the squared misfit above the noise that effects of another form must explain, fitted to all
readings, where the search names them."""

CERTAIN = 0.5
"""Conventional: probability of just what is named below which it is not certain."""

NOTICED = 5.0
"""Calibrated: logarithm of the odds by which an unknown cause must be preferred for a name to be certain."""

ALMOST_SURELY = float(stats.norm.isf(0.05))
"""Conventional: what is promised holds in 19 of 20 campaigns."""

HEATED_K = 30.0
"""Assumed: what a heat gun does to a small part in a minute."""

SHOWN = 3
"""Conventional: measurements, clauses of what each separates, and undetermined directions that are printed."""

COMPARED = 6
"""Assumed, for the time that it takes: explanations that are compared pair by pair, the best first."""

NEEDED_DISTANCE = ALMOST_SURELY + math.sqrt(ALMOST_SURELY**2 + 2.0 * math.log(1.0 / IN_CLASS))
"""Derived: distance, in standard deviations of the noise, from which a diagnosis leaves out the wrong one of two
explanations, as promised. The weighted sums of squares differ by its square, with a deviation of twice itself."""
