"""The constants that decide something in this room.

Each has its kind: derived (from what), conventional, calibrated (on what), or chosen (a judgement, with what it means).
"""

GAP = 1.5
"""Two samples further apart than this many sample times have a gap between them. Derived: 2 is one lost sample, and
half a sample time is left for jitter."""

# ---- what may be wrong with a record

LARGEST_VOLTAGE_V = 1e6
"""No coil on a bench has more. Chosen."""

CLIPPED_RUN = 4
"""So many equal samples in a row at the largest |voltage| look clipped. Chosen: two neighbours are equal by chance on a
converter of few steps, four in a row at the very top hardly ever."""

CLIPPED_STEPS = 16
"""A record of fewer different voltages is quiet noise on a coarse converter, or computed. Chosen."""

STEPS_COMPARED = 7
"""Of the steps below the largest |voltage|, these are held against as many beside them. Derived: twice as many and the
outermost one are no more than :data:`CLIPPED_STEPS`."""

BEYOND_A_STEP = 1.5
"""Readings that differ by more steps than this differ by more than one. Derived: half a step is left for rounding."""

STUCK_TIME_S = 0.05
"""For so long a living instrument never repeats a reading exactly. Chosen: its noise is above its resolution."""

STUCK_SHARE = 0.01
"""A reading is stuck if coil and probe meanwhile saw the field move differently by this share of all that they saw in
the record. Chosen: far above a probe's noise, far below a ramp."""

STUCK_OFFSET_V = 60e-6
"""What a coil makes of so much is no motion of the field. Derived: three standard deviations of an offset voltage that
nothing took off, as in :data:`FIRST_OFFSET_SIGMA_V`."""

NIL_CHANCE = 1e-9
"""Expected number of stretches of equal readings in a whole record that its own noise is not believed to make.
Chosen."""

GAIN_TOLERANCE = 0.05
"""Relative disagreement of coil and reference over the ramps that is put down to a wrong area or gain. Chosen: areas
are known to a per cent, wrong turns or wrong units are off by more."""

AGREEMENT = 0.8
"""Squared correlation from which the changes that coil and reference see are the same thing. Chosen."""

COMPARED_S = 0.1
"""Time over which changes of coil and reference are compared: long enough that white noise is small beside a ramp.
Chosen."""

RANGE_SLACK = 0.01
"""Share of its range of currents by which a field model may be exceeded. Chosen: noise of the current reading."""

INNOVATIONS_AVERAGED = 50
INNOVATION_BAND = 9.0
"""Mean square of 50 normalised innovations (1 in a true filter) beyond which they have left their band. Derived: its
standard deviation is sqrt(2 / 50) = 0.2, so this is 40 of them; a reference that is wrong by 3 sigma reaches it."""

GAIN_SIGMAS = 5.0
"""So many standard uncertainties from 1 a ratio of reference to coil is found to differ. Chosen: an offset voltage that
happens to wander with the ramps makes two or three."""

PLATEAU_FOLLOWS = 0.9
"""Squared correlation from which the voltage of plateaus is put down to R i. Chosen: R i leaves no other cause."""

# ---- what is assumed where the user says nothing

OFFSET_SIGMA_V = {"trapezoid": 20e-6, "ffa1": 5e-6, "ffa2": 5e-6}
"""Standard uncertainty of the offset voltage that a method leaves. Chosen: 20 uV for an amplifier's own offset, 5 uV
for what wanders after it was measured; the filters estimate it."""

FIRST_OFFSET_SIGMA_V = 20e-6
"""Standard deviation of the offset voltage when a record begins. Chosen: an amplifier's own offset."""

OFFSET_WANDER_V = 1e-6
"""How far the offset voltage walks in a second, V/sqrt(s), for the filters that estimate it. Chosen: a few microvolts
in ten seconds, as instrumentation amplifiers do."""

FIRST_FIELD_SIGMA_T = 3e-3
"""Uncertainty of the first field where a current is the reference. Chosen: the remanence of a core that was switched
off."""

MODEL_ERROR_TIME_S = 1.0
"""For so long an error of the current's field counts as noise; weighed as lasting longer, the offset would drift after
it. Chosen: the scale of a ramp."""

SWEPT_SHARE = 0.01
"""Error of a swept model over its largest field, remanence and eddy currents included. Chosen."""

SETTLING_S = 1.0
"""After each ramp, before ffa2 takes the mean voltage for the offset. Chosen: eddy currents of a small actuator decay
in milliseconds; a magnet with a solid yoke needs tens of seconds."""

STILL_A, STILL_V = 0.1, 1e-4
"""A current, or where there is none a mean voltage, that moves by less in a second is on a plateau. Chosen."""
