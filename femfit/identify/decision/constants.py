"""The constants of the decision what is missing and what to measure next; no other file of these has one.

The kinds are those of :mod:`femfit.identify.constants`; what is *calibrated* was read from trials with known truth, as
the text says.
"""

import math

from scipy import stats

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
