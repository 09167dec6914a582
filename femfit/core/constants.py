"""Physical constants, SI.

References
----------
CODATA 2022: mu_0 = 1.25663706127e-6 N/A^2. femfit keeps the pre-2019 exact value 4 pi 1e-7, as every
published reference value and every other field solver does; the two differ by 1.6e-10.
"""

import math

MU_0 = 4e-7 * math.pi
"""Vacuum permeability in H/m."""

GRAVITY = 9.80665
"""Standard acceleration of free fall in m/s^2 (3rd CGPM, 1901)."""

ABSOLUTE_ZERO_C = -273.15
"""Absolute zero in degC, by the definition of the Celsius scale."""

COPPER_RESISTIVITY_20C = 1.7241e-8
"""Resistivity of annealed copper at 20 degC in ohm m (IEC 60028)."""

COPPER_TEMPERATURE_COEFFICIENT = 0.00393
"""Relative change of copper's resistivity per kelvin at 20 degC (IEC 60028)."""

BIAS_SHARE = 2.0 / 3.0
"""Numerical: of the largest flux linkage, at which eddy currents beside iron that saturates are solved. The pull-ins of
a flat solenoid by 5, 12 and 24 V then end 1.3 % late, 0.1 % and 2.1 % early beside the nonlinear field in time; with a
half 0.0, 1.2 and 3.0 % early, with 0.7 2.8, 2.0 and 0.5 % late."""
