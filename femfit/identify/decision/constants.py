"""The constants of the decision, each with its kind and source.

*Derived* follows from something else. *Conventional* is a usual level. *Calibrated* was set by trials with known truth:
seeds 1 to 6 of the hidden-effect study (docs/trial.md, 2026), whose reported table is of another seed. *Assumed* is an
engineer's judgement with no calibration behind it.
"""

LEVEL = 0.01
"""Conventional: probability that something is said to be missing where nothing is. Two tests share it (Bonferroni)."""

LEVEL_AFTER = 0.005
"""Conventional: p-value below which a refit has left structure."""

STRUCTURE_LEFT = 0.01
"""Conventional: p-value below which a refit has left structure that more amplitudes of its effects are tried on."""

OWN_MISFIT = 4.0
"""Assumed: a structured misfit up to twice (four times in square) that to the table that the model was fitted to is the
model's own."""

POWER = 0.9
"""Conventional: what data "could have shown" they show nine times in ten."""

CLEAN_CAMPAIGNS = 40
"""Conventional: clean campaigns of a bootstrap; none of 40 named something means at most 8.8 % at 95 %."""

ENOUGH, ENOUGH_OF_TWO = 0.97, 0.98
"""Calibrated: share of the structured excess that one name, or two, must explain where structure is left."""

LEAST_SHARE = 0.35
"""Calibrated: share that a name must explain at all, however well the test passes after it."""

MOST, AHEAD = 0.7, 0.3
"""Calibrated: share that one name must explain where no further effect adds anything, and by how much more than any
other name."""

MUCH, FAR_AHEAD = 0.6, 0.5
"""Calibrated: the same where further effects add something."""

LEAST_SECOND_SHARE = 0.01
"""Assumed: share that each of two effects must explain beyond the other; the larger's form may be off by as much."""

ELSEWHERE_SHARE = 0.5
"""Calibrated: share of the misfit in channels that the other effect leaves alone that will do instead."""

REMAINDER_SHARE = 0.9
"""Calibrated: share of what one effect leaves that a second one must explain to be named where structure is left."""

OPPOSED = -0.75
"""Calibrated: cosine between the contributions of two effects below which the one only mends the other's form."""

TIE = 9.0
"""Conventional: two effects are one class where the weighted sums of squares differ by less (three deviations), in
units of the noise and of what the better one leaves unexplained."""

SEEN = 0.05
"""Assumed: part of an effect's length beside fitted ones below which nothing can be said of it."""

NONLINEAR_PRICE = 0.5
"""Assumed: price of a nonlinear parameter over that of an amplitude, which is ln M (derived; Schwarz, 1978)."""

PAIR_PRICE = 2.0
"""Conventional: price of an amplitude in the search for pairs (Akaike, 1974), lower than in the choice, so that the
search leaves nothing out."""

REFITTED, PAIRED, CONTINUED = 8, 8, 3
"""Assumed, for the time that it takes: how many single effects are refitted, how many are tried in pairs with every
other to first order, and how many refitted ones are continued by how many others."""

ROUNDING = 1e-3
"""Numerical: weighted sums of squares closer than this are equal; a refit stops within it."""
