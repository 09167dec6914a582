"""The law of a plunger that saturates: a gap and an iron path in series, leakage beside them, in closed form.

The main flux linkage psi obeys i = r(d) psi + c psi / (s(d) - psi): the gap's part r, and iron that saturates at s as
Froelich's curve does. That is a quadratic equation for psi. The co-energy is

    W'(d, i) = psi i - r psi^2 / 2 + c (psi + s ln(1 - psi / s)) + L(d) i^2 / 2,

stationary in psi, so that F = psi^2 r' / 2 - c (ln(1 - y) + y / (1 - y)) s' - L' i^2 / 2 with y = psi / s. With
x = ln((d + a) / d_0), ln r is a cubic in x, because flux fringes in a power of the gap, and s and L are straight lines:
what leaks past the gap saturates the iron as well.

References
----------
H. C. Roters, Electromagnetic Devices (Wiley, 1941), chapters IV to VII (permeances, fringing, leakage of plungers).
O. Froelich, Elektrotechnische Zeitschrift 2 (1881) 134 (the curve).
"""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from casadi import SX

from femfit.model.magnetics import Magnetics, current_of

NETWORK = "reluctance-network"
"""Name of the law."""

FORMULA = "i = r(d) psi + c psi / (s(d) - psi), F = -dW'/dd"

OPERATIONS = 100
"""Floating-point operations of one force, counted as a law's: logarithms and exponentials twenty each."""


@dataclass(frozen=True, eq=False)
class NetworkMagnetics(Magnetics):
    """The co-energy of the network; a current of either sign pulls alike."""

    kind: Literal["reluctance_network"] = field(default="reluctance_network", kw_only=True)
    reference_distance_m: float = field(metadata={"positive": True})  # d_0
    distance_shift_m: float  # a
    log_reluctance: tuple[float, float, float, float]  # Of ln r in powers of x, the lowest first; r in A/Wb
    saturation_Wb: tuple[float, float]  # s in powers of x
    knee_A: float = field(metadata={"positive": True})  # c
    leakage_H: tuple[float, float]  # L in powers of x

    def expression(self, distance: SX, currents: SX) -> SX:
        """W' of an expression's distance and current."""
        x = np.log((distance + self.distance_shift_m) / self.reference_distance_m)
        current, c = current_of(currents), self.knee_A
        size = np.where(current < 0.0, -current, current)  # whose slope is 1 at no current, unlike a magnitude's
        r0, r1, r2, r3 = self.log_reluctance
        r = np.exp(((r3 * x + r2) * x + r1) * x + r0)
        s = self.saturation_Wb[0] + self.saturation_Wb[1] * x
        gap = r * s
        b = gap + size + c
        y = 2.0 * size / (b + np.sqrt(b * b - 4.0 * gap * size))
        psi = y * s
        leakage = self.leakage_H[0] + self.leakage_H[1] * x
        return psi * size - 0.5 * r * psi**2 + c * (psi + s * np.log(1.0 - y)) + 0.5 * leakage * size**2
