"""Every number that decides what a filter believes before it has seen a reading, with its kind and source.

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

BAND_99_9 = 10.828
"""Derived: 99.9 % quantile of chi-square with one degree of freedom."""

DIVERGENCE_STEPS = 200
"""Conventional: a run is named INNOVATIONS_OUT_OF_BAND once more than half of its last (exponentially weighted) so many
innovations left their 99.9 % band; a true filter leaves it once in a thousand steps."""

MOST_DELAYED_SAMPLES = 100
"""Conventional: samples by which a sensor may be late; each of them is a state of the filter."""

DELAYED_NOISE = 1e-3
"""Numerical: process noise of a remembered value over what its reading's noise makes of it, so that Q is definite."""

UNMOVED_KG = 1e12
"""Numerical: a body of this mass stays where it is."""
