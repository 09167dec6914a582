"""The constants by which a table becomes a model, each with its kind and source.

*Derived* follows from something else. *Conventional* is a usual level. *Assumed* is an engineer's judgement with no
calibration behind it. *Numerical* bounds rounding or time. The solver's own tolerances stand beside the solver.
"""

# What a table must have

FEWEST_ROWS, FEWEST_DISTANCES = 12, 4
"""Assumed: fewer rows, or distances, leave too little to check a fit by."""

FEWEST_CURRENTS = 3
"""Derived: a parabola in the current; of three currents one can be left out and a line be distinguished from it."""

FAR_ABOVE_WEIGHT = 10.0
"""Assumed: rms force over the weight from which the weight says nothing of how good a model must be."""

SMALL_FORCE = 0.01
"""Assumed: forces below this part of the largest one at the same distance are passages through zero, whose relative
error would say nothing."""

TRAPEZOID = 0.1
"""Assumed: part of the flux linkage's change over the currents that the integral of the inductance may miss: what the
trapezoidal rule loses at a bend between a few currents."""

STRAIGHT = 1e-3
"""Numerical: an inductance that changes with the current by less than this part adds nothing to the flux linkage."""

# How good a model is

COARSE = {"force": 0.01, "inductance": 0.025}
"""Misfit, of the rms or of each point's own, that a co-energy's user is warned of. Of the force conventional; of the
inductance calibrated, November 2026, on 33 sweeps of 11 devices that saturate, by what their left-out points missed: in
26 of them an inductance between the points was off by a quarter or more; with what is said of the force 23 of these
were warned of, and two of the others. A solenoid of 15 currents that is met within 2 % had 0.020.
"""

POOR_CIRCUIT = 0.1
"""Conventional: misfit of flux linkage or inductance, over the rms of the table's, or over the inductance's change with
the distance, that the user is warned of."""

TARGET = 5e-3
"""Conventional: held-out rms error of a law, as a part of the weight (or of the rms force), that is good enough."""

DOMAIN_GRID = (101, 101, 5)
"""Numerical: distances, currents, and currents of each of several circuits, at which what is said of all of a model's
validity domain is evaluated."""

CONTRADICTION = 10.0
"""Assumed: times a column's second largest value by which rows may miss each other, where one is larger."""

# The basis of a co-energy and of a Hall characteristic

U_DEGREE = 4
"""Assumed: degree of the splines in u = d_0 / (d + s): the force, a derivative, has continuous curvature."""

CURRENT_DEGREE = 3
"""Conventional: of the splines along a current that a field at a sensor takes where iron saturates."""

HELD_OUT_TARGET, HALL_TARGET = 5e-5, 2e-5
"""Assumed: the smallest basis whose held-out error is below this part is taken, which is below a good sweep's own; the
same of the Hall field's range: far from the magnet, where the field is a twentieth of its range, a thousandth of it is
still tens of micrometres."""

NEARLY_BEST, NEARLY_BEST_BENT = 1.1, 1.02
"""Assumed: where none reaches the target (noisy rows), the smallest within this factor of the least held-out error; the
second where the inductance bends, since what misses the target there is the bend, seldom noise."""

ROUNDS = 3
"""Numerical: how often distance and current are searched in turn."""

SHIFTS = (0.0, 0.1, 0.3, 1.0, 3.0)
"""Assumed: shifts s of u = d_0 / (d + s) that are tried, as parts of the range of distances: none suits a magnet far
from its electromagnet, large ones a plunger or a pole with a long gap of its own, where d_0 / d would crowd the
distances."""

CLOSEST = 0.05
"""Numerical: least distance plus shift, as a part of the range of distances, for a sweep that reaches the face or
passes it: closer to its pole, an inverse distance puts all distances but one into a corner."""

DISTANCE_CELLS = (1, 2, 3, 4, 5, 6, 8, 10, 12, 16, 20)
"""Assumed: cells in the distance that are tried for one circuit's co-energy."""

CELLS_IN_CURRENT, BENT_CELLS = (1, 2, 3, 4, 6), (3, 6, 12)
"""Assumed: cells in the current that are tried; and where the inductance shows a bend, beside the finest."""

MOST_BENT_CELLS, MOST_CELLS = 48, 8
"""Numerical: in the current and in the distance, where the inductance bends: as many functions as a fit with shapes
takes in seconds. Up to 17 currents have three cells from each to the next."""

SHAPE_POINTS = 24
"""Numerical: shape constraints are imposed at so many points of an axis, or six a cell where that is more; between them
a quartic can dip by a fraction of a per cent."""

KEPT_INDUCTANCE = 0.5
"""Assumed: part of the table's least inductance that a fit keeps everywhere; iron that saturates nears its last one
from above, and a dip between the points where shapes are imposed stays above zero."""

ALLOWED_VIOLATION = 1e-5
"""Numerical: a shape counts as obeyed where it fails by less than this part of its largest value (inductance, slope or
k_m)."""

TWO_GAPS = (0.2, 0.25, 0.32, 0.43, 0.57)
"""Calibrated, on two axial bearings and a double-acting solenoid of steel: the stretches of u = sinh((d - d_0) / h)
about the middle that are tried, as parts of the range of distances."""

CIRCUIT_CELLS = (1, 2, 3, 4, 6, 8, 12)
"""Assumed: cells in the distance that are tried for several circuits, and for the field at a sensor."""

SMALL_CIRCUIT_FORCE, SMALL_FLUX = 0.02, 0.05
"""Conventional: errors of several circuits are parts of each row's own force and flux linkage, but at least of these
parts of the largest ones: where two magnets cancel, or another circuit alone links a little, nothing is to be divided
by."""

NOT_QUADRATIC = 0.01
"""Conventional: what the best quadratic form in several currents misses at a point, over the scale of its force or flux
linkage, from which the iron saturates: a third of :data:`POOR_POINT`."""

POOR_POINT, POOR_BETWEEN = 0.03, 0.05
"""Conventional: error of the force of several circuits at a point of the table, and between two, over the force or a
part of the largest (:data:`SMALL_CIRCUIT_FORCE`), from which the user is told to sweep more finely."""

BETWEEN_LEFT_OUT = 0.5
"""Assumed: of several circuits the force's error between two distances or currents, over that at one left out: of first
order, for few cells follow few values. On a bearing of steel with currents of 0 to 3 A by 1 A it is 0.7."""

BETWEEN_AT_ENDS = {"force": 0.1, "flux linkage": 0.1, "inductance": 0.3}
"""Calibrated, November 2026, on 15 sweeps of five circuits in closed form: of what a row at the least or the largest
distance is missed by when it is left out, the part that counts between rows. A cubic misses a sixteenth over half of an
interval; at a knee, whose inductance is a step, the root of a half. On eight sweeps of two drawings that had no part in
it the force is then told within a factor of two in seven, the inductance in four."""

MOST_UNKNOWNS = 4000
"""Conventional: coefficients of a spline over the distance and several currents; they take half a GB and a minute."""

LEFT_OUT_EVERY = 7
"""Conventional: every seventh inner point of a grid of several currents is left out once, to be told by the others."""

FINER_CURRENTS = (0.34, 0.5, 1.0)
"""Conventional: cells between the currents that are tried, over the steps from one current to the next: inductances
beside flux linkages determine the last."""

SMOOTHNESS, SMOOTH_DISTANCE = 1e-5, 1e-4
"""Numerical: norm of the penalties on what currents and distance leave open, over that of the rows; below the error of
a sweep where rows decide. A tenth and ten times these change what four devices miss at points left out by a tenth."""

ALONE = 1e-2
"""Numerical: penalty on one current's bends over that on bends in two: a corner of the grid that failed is the sum of
what its neighbours do alone."""

# How rows are weighted and left out

RELATIVE_SIGMA = 1e-4
"""Assumed: rows are weighted for this error relative to the force's scale, or to the change of flux linkage and of
inductance over the distance."""

INDUCTANCE_SIGMA = 3.0
"""Assumed: relative sigma of the inductance, over that of the other columns: it is a difference of flux linkages at
neighbouring currents, which it must not outweigh."""

FREE_SLOPE, FREE_BEND = 0.3, 30.0
"""Assumed: sigma of the inductance's slope, as a part of largest inductance over range of currents, and of the flux
linkage's third derivative in u, as a part of both over the range of u cubed: at a knee both are many times as large, so
that they hold only what no row determines. With 1 for the first, a solenoid's and a relay's force was missed by twice
as much at points not fitted; with 0.1, a valve's by as much again on its own."""

SMOOTHED_DEGREE = 3
"""Derived: with cubics in the current the inductance is a broken line, and one slope a cell is all there is to hold."""

DISTANCE_FOLDS, SCATTERED_FOLDS = 4, 5
"""Derived: with row j + 2 current k modulo 5, no two rows of a fold are neighbours, nor next but one along an axis;
every fourth distance keeps its neighbours."""

# Laws

NETWORK_STARTS = ((0.3, 0.02), (0.3, 0.2), (0.05, 0.02), (0.05, 0.2))
"""Assumed: where the search for a plunger's network starts: its shift, as a part of the median distance, and the iron's
own current, as a part of the largest."""

NETWORK_CURRENTS, NETWORK_DISTANCES = 3, 6
"""Derived: a knee takes three currents beside zero, and a network's ten numbers six distances of them."""

NETWORK_NUMBERS = 10
"""Derived: numbers of the network: a, four of ln r, two of s, c, two of the leakage."""

NETWORK_OFF = 10.0
"""Numerical: residual of numbers that make no network, ten times the rms of what is fitted."""

NETWORK_IDLE = 1e-3
"""Assumed: force without current, as a part of the rms force, below which a plunger has no magnet."""

STEPS = (0.0, -0.1, 0.1)
"""Assumed: starts beside the law's first guess, as parts of the logarithm of the range between its bounds."""

NEGLIGIBLE = 5e-4
"""Assumed: part of the weight (or of the rms force) below which a coefficient function's held-out error does not
matter."""

JACKKNIFE_BLOCKS, DISTANCE_BLOCKS = 12, 8
"""Conventional: blocks of distances that are left out in turn, for a coefficient's interval and for a law's held-out
error."""

AT_THE_GAP = 0.2
"""Calibrated: a face acts as a change of the distance where that leaves less than this part of its slopes, in rms. By
drawings solved anew, 0.1 to 0.4 mm elsewhere, the error of the first order then falls by 25 times (0.02 left, a conical
pole), 5 to 6 (0.14, a flat pole; 0.16, a conical plunger's diameter), 2.6 (0.11, a rim), not at all (0.17, a ball)."""

EDDY_FREQUENCIES, EDDY_DISTANCES, EDDY_LOWEST_HZ = 13, 6, 1e-3
"""Numerical: frequencies over the drawing's range, from the lowest on, at which a model's eddy currents are held
against the field's, and distances at which their combinations are found; they are held against all."""

EDDY_POWERS, EDDY_STEPS = (1, 1, 3, 3), 25
"""Numerical: powers of the departures whose least squares the combinations of patterns have, one after the other, with
what they add to the Hall field found anew before each; and steps of each."""

EDDY_LOOSER, EDDY_SINGULAR = 3.0, 1e-4
"""Assumed, numerical: how much less the Hall field of currents that motion induces counts, over its largest, than that
of an ampere; smallest singular value, over the largest, of the responses that a Hall field is fitted with."""

EDDY_FEWER = 0.55
"""Numerical: of the principal patterns that meet an error, how many combinations may do; the search begins there."""

EDDY_DEGREE, EDDY_BETWEEN = 3, 8
"""Numerical: of eddy currents' splines through values and slopes, and places between two distances at which they are
checked to be passive."""

EDDY_PER_DECADE = 10
"""Numerical: frequencies at which the change of an impedance by a conductivity is kept."""

STOP_ROUNDING_M = 1e-12
"""Numerical: by what rounding may keep a stop that is drawn at an end of the sweep from it."""
