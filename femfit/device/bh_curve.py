r"""The magnetisation curve of a soft material: H(B), its slope and the energy, from tabulated points.

Between the points H(B) is the monotone cubic of Fritsch and Carlson, so that dH/dB is continuous and H never turns
back; H is odd, which fixes its slope at B = 0. Beyond the last point dH/dB rises linearly to nu_0 over a fifth of the
last B and stays there: a saturated material takes up field like air. No slope exceeds nu_0.

References
----------
F. N. Fritsch and R. E. Carlson, SIAM J. Numer. Anal. 17 (1980) 238: monotone piecewise cubic interpolation;
C. Pechstein and B. Juettler, J. Comput. Appl. Math. 196 (2006) 45: monotone B-H curves in field solvers.
"""

import numpy as np
from scipy.interpolate import CubicHermiteSpline, PchipInterpolator

from femfit.core.arrays import FloatArray
from femfit.core.constants import MU_0

TAIL = 0.2
"""Length, relative to the last B, over which dH/dB rises to nu_0. The polarisation still gained there is at most a
tenth of the last B, as between the usual end of a data sheet's curve (10 kA/m) and the saturation of iron."""


class BHCurve:
    """H(B), to be evaluated at arrays of B >= 0 in T."""

    def __init__(self, flux_density_T: tuple[float, ...], field_A_per_m: tuple[float, ...]) -> None:
        b, h = np.asarray(flux_density_T, dtype=np.float64), np.asarray(field_A_per_m, dtype=np.float64)
        slopes = np.minimum(_slopes(b, h), 1.0 / MU_0)
        tail = TAIL * b[-1]
        self.saturated_T = float(b[-1] + tail)
        self._saturated_field = float(h[-1] + 0.5 * tail * (slopes[-1] + 1.0 / MU_0))
        self._field = CubicHermiteSpline(
            np.append(b, self.saturated_T), np.append(h, self._saturated_field), np.append(slopes, 1.0 / MU_0)
        )
        self._slope = self._field.derivative()
        self._energy = self._field.antiderivative()

    def field(self, b: FloatArray) -> FloatArray:
        """H in A/m."""
        inside, beyond = self._split(b)
        return np.asarray(self._field(inside) + beyond / MU_0)

    def differential_reluctivity(self, b: FloatArray) -> FloatArray:
        """dH/dB in m/H."""
        return np.asarray(self._slope(self._split(b)[0]))

    def reluctivity(self, b: FloatArray) -> FloatArray:
        """H / B in m/H, its limit dH/dB at B = 0."""
        b = np.asarray(b, dtype=np.float64)
        zero = b == 0.0
        return np.where(zero, float(self._slope(0.0)), self.field(b) / np.where(zero, 1.0, b))

    def energy_density(self, b: FloatArray) -> FloatArray:
        """Integral of H dB from 0, in J/m^3."""
        inside, beyond = self._split(b)
        return np.asarray(self._energy(inside) + beyond * (self._saturated_field + 0.5 * beyond / MU_0))

    def _split(self, b: FloatArray) -> tuple[FloatArray, FloatArray]:
        """B up to saturation, and what is beyond."""
        inside = np.minimum(b, self.saturated_T)
        return inside, b - inside


def _slopes(b: FloatArray, h: FloatArray) -> FloatArray:
    """dH/dB at the points. With the points mirrored at B = 0, since H is odd, the slope there is the first secant's.

    At the last point it is at least the last secant's: a saturating curve does not become steeper in B(H) again.
    """
    mirrored = PchipInterpolator(np.append(-b[:0:-1], b), np.append(-h[:0:-1], h))
    slopes = np.asarray(mirrored(b, 1))
    slopes[-1] = max(slopes[-1], (h[-1] - h[-2]) / (b[-1] - b[-2]))
    return slopes
