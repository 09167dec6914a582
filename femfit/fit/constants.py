"""The constants by which a table becomes a model, each with its kind and source.

*Derived* follows from something else. *Conventional* is a usual level. *Assumed* is an engineer's judgement with no
calibration behind it. *Numerical* bounds rounding or time. The solver's own tolerances stand beside the solver.
"""

# What a table must have

FEWEST_CURRENTS = 3
"""Derived: a parabola in the current; of three currents one can be left out and a line be distinguished from it."""

# How good a model is

COARSE = 0.01
"""Conventional: misfit of the force, of its rms or of each point's own, that a co-energy's user is warned of."""

POOR_CIRCUIT = 0.1
"""Conventional: misfit of flux linkage or inductance, over the rms of the table's, or over the inductance's change with
the distance, that the user is warned of."""

TARGET = 5e-3
"""Conventional: held-out rms error of a law, as a part of the weight (or of the rms force), that is good enough."""

# The basis of a co-energy and of a Hall characteristic

U_DEGREE = 4
"""Assumed: degree of the splines in u = d_0 / (d + s): the force, a derivative, has continuous curvature."""

HELD_OUT_TARGET, HALL_TARGET = 5e-5, 2e-5
"""Assumed: the smallest basis whose held-out error is below this part is taken, which is below a good sweep's own; the
same of the Hall field's range: far from the magnet, where the field is a twentieth of its range, a thousandth of it is
still tens of micrometres."""

CIRCUIT_CELLS = (1, 2, 3, 4, 6, 8, 12)
"""Assumed: cells in the distance that are tried for several circuits, and for the field at a sensor."""

SMALL_CIRCUIT_FORCE, SMALL_FLUX = 0.02, 0.05
"""Conventional: errors of several circuits are parts of each row's own force and flux linkage, but at least of these
parts of the largest ones: where two magnets cancel, or another circuit alone links a little, nothing is to be divided
by."""

POOR_POINT, POOR_BETWEEN = 0.03, 0.05
"""Conventional: error of the force of several circuits at a point of the table, and between two, over the force or a
part of the largest (:data:`SMALL_CIRCUIT_FORCE`), from which the user is told to sweep more finely."""

# How rows are weighted and left out

SMOOTHED_DEGREE = 3
"""Derived: with cubics in the current the inductance is a broken line, and one slope a cell is all there is to hold."""

DISTANCE_FOLDS, SCATTERED_FOLDS = 4, 5
"""Derived: with row j + 2 current k modulo 5, no two rows of a fold are neighbours, nor next but one along an axis;
every fourth distance keeps its neighbours."""

# Laws

NETWORK_IDLE = 1e-3
"""Assumed: force without current, as a part of the rms force, below which a plunger has no magnet."""

JACKKNIFE_BLOCKS, DISTANCE_BLOCKS = 12, 8
"""Conventional: blocks of distances that are left out in turn, for a coefficient's interval and for a law's held-out
error."""

EDDY_FREQUENCIES, EDDY_DISTANCES, EDDY_LOWEST_HZ = 13, 6, 1e-3
"""Numerical: frequencies over the drawing's range, from the lowest on, at which a model's eddy currents are held
against the field's, and distances at which their combinations are found; they are held against all."""
