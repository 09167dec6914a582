"""Whether coil and reference disagree by a gain, told from offset and drift by the filter's innovations.

The innovations nu of a filter are white with variance S, and a relative gain e of the reference adds e r to them, where
r follows from the filter alone. So e = sum(nu r / S) / sum(r^2 / S) is the generalised least squares estimate beside an
offset voltage that walks. Its uncertainty is the larger one of 1 / sqrt(sum(r^2 / S)), which holds if nothing else is
wrong, and that from the scatter of the sums about it from second to second, which holds whatever else is wrong there.
Where sum(nu^2 / S) is more than noise makes, the gain must explain most of that: an offset voltage that wanders faster
than the filter assumes makes a small gain on a few ramps.

H. White, Econometrica 48 (1980) 817 (uncertainty from the scatter).
"""

import math
from dataclasses import dataclass

from femfit.core.arrays import FloatArray
from femfit.integrate.constants import GAIN_SIGMAS


@dataclass
class GainTest:
    """Sums over stretches of a record: of sum(nu^2 / S) - n, a = sum(nu r / S), b = sum(r^2 / S), a^2, a b and b^2."""

    excess: float = 0.0

    a: float = 0.0
    b: float = 0.0
    aa: float = 0.0
    ab: float = 0.0
    bb: float = 0.0

    def see(self, excess: FloatArray, a: FloatArray, b: FloatArray) -> None:
        """Add stretches; each of shape (n,)."""
        self.excess += float(excess.sum())
        self.a, self.b = self.a + float(a.sum()), self.b + float(b.sum())
        self.aa, self.ab, self.bb = self.aa + float(a @ a), self.ab + float(a @ b), self.bb + float(b @ b)

    def result(self) -> tuple[float, float] | None:
        """Reference's changes over the coil's, and the ratio's standard uncertainty; None where none is shown."""
        if self.b <= 0.0:
            return None
        e = self.a / self.b
        scatter = math.sqrt(max(self.aa - 2.0 * e * self.ab + e**2 * self.bb, 0.0)) / self.b
        sigma = max(1.0 / math.sqrt(self.b), scatter)
        if abs(e) <= GAIN_SIGMAS * sigma or e >= 1.0 or e**2 * self.b < 0.5 * self.excess:
            return None
        # r is the reading's part, gain included: reading = field / (1 - e)
        return 1.0 / (1.0 - e), sigma / (1.0 - e) ** 2
