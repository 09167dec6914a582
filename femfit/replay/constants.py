"""Every number that decides how a record is run through a filter and judged, with its kind and source.

Kinds: *derived* (from what is said), *conventional* (a usual choice, any near it would do), *calibrated* (on data that
are named).
"""

SHORTEST_PIECE, LONGEST_PIECE = 250, 2000
"""Conventional: samples of a piece of a record; pieces run side by side, and a filter forgets its start within one."""

JOINED = 1e-3
"""Conventional: a piece begins where the one before ended if no state differs by more than this of its deviation, and
no variance by more than this of itself."""

LAGS = 20
"""Conventional: lags of the innovations' autocorrelation, and of a delay between channels, in samples."""

DELAY_GAIN = 0.9
"""Conventional: a shift counts as a delay if it takes the rms of what is left of a channel below this part."""

MOST_LEFT = 0.5
"""Conventional: a cause accounts for a misfit where the model with it leaves less than this part."""

STANDS_STILL = 1e-3
"""Numerical: random walk of a held body's distance in a sample, over the noise of its reading: Q is definite."""

APART, LEAST_UNSEATED = 0.25, 1e-3
"""Conventional: parts of the stroke beyond which a body was away from a stop, and within which it is at it."""

AT_REST = 1e-3
"""Conventional: part of its deviation that is left of a distance that is read as a stop's, or of a speed at rest."""

SEAT_BEFORE = 20
"""Conventional: samples before the estimate's arrival at which the body may have seated already."""

BEYOND = 0.1
"""Conventional: part of the stroke by which the rival body passes the stop; the model is continued no further."""

LEAST_CONFIDENCE, CERTAIN = 0.95, 0.999
"""Conventional: probabilities from which a seating is said, and from which no more digits are given."""

FOLLOWED = 0.998
"""Conventional: level of the band that the mean square of the innovations at a seating must not exceed."""

WORK_POINTS = 41
"""Numerical: distances, and currents, over which the largest work of the force is added up."""

MOST_SEATINGS = 6
"""Conventional: arrivals at a stop that are printed; all of them are in the JSON."""

NOISE_SAMPLES = 20_000
"""Conventional: samples that the search for the noise looks at, from the first stretch on."""

NOISE_PIECE, FORGOTTEN = 500, 100
"""Conventional: samples of a piece in the search for the noise, and those at its begin that do not count."""

FORGOTTEN_SHARE = 1.0 / 6.0
"""Conventional: of a record that is shorter than that, the part that does not count."""

LEAST_JUDGED = 60
"""Conventional: readings from which innovations are judged and a noise is sought; 60 tell a deviation to 9 %."""

COVARIANCE_LAGS, COVARIANCE_BLOCK = 15, 50
"""Conventional: lags of the autocovariances that noises are fitted to, and samples of a block whose means scatter."""

FOLLOWS = 2.0
"""Conventional: mean square of the normalised innovations up to which a filter follows the motion."""

MOVING, SHOWN = 3.0, 4.0
"""Conventional: deviations of its velocity from which a body moves one way, and of a friction from which it is said."""

LEAST_BLOCKS = 10
"""Conventional: such blocks that give a scatter; ten tell it to a quarter."""

UNKNOWN = 2.0
"""Conventional: a noise whose logarithm is uncertain by more than this is said to be at most its upper limit."""
