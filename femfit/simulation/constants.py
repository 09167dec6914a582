"""Every number that decides how a loop is designed and studied, and what is printed, with its kind and source.

Kinds: *derived* (from what is said), *conventional* (a usual choice, any near it would do), *calibrated* (on data that
are named).
"""

DESIGN_POINTS = 9
"""Conventional: points of rest over the reference's range for which controllers are designed."""

DERIVATIVE_FILTER_RATIO = 3.0
"""Calibrated on the suspended magnet of A. Chowdhury and A. Sarjas, Sensors 16 (2016) 1504, at 30 mm: pole of the PID's
derivative filter over the coil's. With 6 the noise on the voltage reaches the clamp so often that runs are lost; with 3
the loop is a tenth slower. A ratio of two poles of one loop does not change with size or time scale; how much noise it
lets through does depend on the driver's voltage and the sensor, so that a quieter sensor would bear a larger one."""

USABLE_PART = 0.3
"""Conventional: fastest pole that a loop is designed with, times the sample time; a third of it turns by 0.1 rad a
sample (K. J. Astrom and B. Wittenmark, Computer-Controlled Systems (Prentice Hall, 1997), section 7.8: 0.1 to 0.6)."""

USED_AUTHORITY = 0.5
"""Conventional: part of the voltage between holding and clamp that the reference may use; feedback has the rest."""

COVERED_PART = 0.95
"""Conventional: part of the swept currents that the driver's voltage may ask for at rest; back-EMF adds in motion."""

SUPPORT_TIME_CONSTANTS = 5.0
"""Derived: a filter's own poles are at least as fast as the body's unstable one, so that after five of its time
constants less than 1 % of the first error is left."""

UNKNOWN_NOISE_PART = 5e-4
"""Conventional: white noise of a Hall sample over the output's range where the model says none: two of 4096 steps."""

WANTED_PHASE_DEG, WANTED_MODULUS = 45.0, 0.5
"""Conventional: margins that a design aims at: a maximum sensitivity of 2 (K. J. Astrom and T. Hagglund, Advanced PID
Control (ISA, 2006), section 4.3) and the phase margin that goes with a well damped loop."""

THIN_PHASE_DEG, THIN_MODULUS = 30.0, 0.4
"""Conventional: margins below which a loop is called thin; a maximum sensitivity of 2.5, and the least phase margin
that is usual (S. Skogestad and I. Postlethwaite, Multivariable Feedback Control (Wiley, 2005), section 2.4.3)."""

COMMAND_ERRORS = (5.0, 20.0, 50.0)
"""Conventional: factors on the error of the driver that a loop's filter allows for, of which the least is taken that
keeps the margins. A filter that trusts its commands takes nearly all of a loop's margin (J. C. Doyle and G. Stein, IEEE
Trans. Automat. Contr. 26 (1981) 4: noise at the plant's input gives it back, and the sensors' noise sets the end)."""

NEARLY = 0.9
"""Conventional: part of the best that is as good as it: of the margins that gains or a filter give, the first is taken
that keeps so much."""

SETTLING_PART = 0.35
"""Conventional: rate at which a loop's slowest motion must decay over the body's own; an integral that is slower would
not be done with a disturbance while one looks."""

NOISE_ROOM = 0.1
"""Conventional: rms of a command that the sensors' noise may take, over the way to the nearer limit: a tenth leaves the
rest to steps of the reference, which use half of it."""

NOISE_FILLS = 1.0 / 3.0
"""Derived: rms of the noise's command over the room to the limit, from which three deviations reach it."""

FOLLOWED_PART = 0.1
"""Conventional: rate of the reference over the body's own that a loop follows whose coil is slow: what holds a body
that runs away closes a loop faster than the body, through a current that the driver's voltage forces, not R/L."""

LONGEST_STAY_S, LEAST_SAMPLES = 1.0, 2000
"""Conventional: of a loop at each reference distance; less than a second where 2000 samples and the step itself take
less, since a loop of 10 kHz needs as many samples to be judged as one of 1 kHz, not as many seconds."""

SLOW_COIL, WANTED_COIL = 3.0, 6.0
"""Conventional: coil's pole over the body's unstable one below which a PID closes a loop of the current, and what that
loop makes of it. Backstepping asks for three times as well; at six times four equal poles are faster than the body."""

REFERENCE_PART = 1.7
"""Conventional: fastest rate of the reference over the body's own, sqrt(|S|/m); what is asked for faster than that is
the force of the driver alone, and a filter's explicit steps are off by more than its sensors' noise."""

SLOWEST_OVER_BODY, SLOWEST_OVER_HIGHEST, NARROWEST_RANGE = 0.3, 0.01, 0.5
"""Conventional: the slowest bandwidth that is tried for a regulator over the body's own rate, which a slower loop could
not hold; not below a hundredth of the highest one, nor above half of it, so that there is a range to choose from."""

FIRST_STIFFNESS, FIRST_INTEGRAL, FIRST_DAMPING, FIRST_FILTER = 2.0, 0.1, 2.0, 10.0
"""Conventional: where a search for PID gains starts. Twice the force that only just holds an unstable body; an integral
a tenth as fast as the body; a derivative over two of its time constants; the derivative's filter ten times as fast."""

FASTEST_FILTER = 3.0
"""Derived: pole of a derivative's filter times the sample time; of what comes in, 1 - exp(-3) = 95 % has gone through
it a sample later, and a faster one would not be told from none."""

BANDWIDTHS = 14
"""Conventional: bandwidths that are tried for a regulator; over a range of a hundred they are a factor of 1.4 apart."""

FIRST_FACTOR, LAST_FACTOR = 1.6, 1.05
"""Conventional: factors on one gain with which a search begins, and below which it ends: nearer gains are as good."""

MOST_PRINTED = 6
"""Conventional: ways to a stop that are printed; the JSON has all."""

AT_ONCE = 1e-6
"""Numerical: part of the simulated time below which a wait is the integrator's first step."""

LEAST_SHARE = 1e-3
"""Conventional: part of the energy supplied below which a share of it is not printed."""

EXACT_M = 1e-9
"""Numerical: an error below a nanometre is rounding: the estimate lies on the stop, as the body does."""

UNCERTAIN = 2.0
"""Conventional: squared innovations over what a filter expects from which its claimed errors are remarked on; they are
too small by more than 40 % then, which no statistical scatter of hundreds of samples makes."""
