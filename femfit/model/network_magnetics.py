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

from dataclasses import dataclass

import numpy as np

from femfit.core.numerics import FloatArray
from femfit.effects.taylor_series import TaylorSeries, current_series, distance_series
from femfit.model.magnetics import OneCurrentMagnetics, Orders, only_current

NETWORK = "reluctance-network"
"""Name of the law."""

FORMULA = "i = r(d) psi + c psi / (s(d) - psi), F = -dW'/dd"

OPERATIONS = 100
"""Floating-point operations of one force, counted as a law's: logarithms and exponentials twenty each."""


@dataclass(frozen=True, eq=False)
class NetworkMagnetics(OneCurrentMagnetics):
    """The co-energy of the network; a current of either sign pulls alike."""

    reference_distance_m: float  # d_0
    distance_shift_m: float  # a
    log_reluctance: tuple[float, float, float, float]  # Of ln r in powers of x, the lowest first; r in A/Wb
    saturation_Wb: tuple[float, float]  # s in powers of x
    knee_A: float  # c
    leakage_H: tuple[float, float]  # L in powers of x

    def force(self, distance: FloatArray, currents: FloatArray) -> FloatArray:
        """F in N, as a microcontroller would work it out."""
        current = only_current(currents)
        near = distance + self.distance_shift_m
        x, slope = np.log(near * (1.0 / self.reference_distance_m)), 1.0 / near
        r0, r1, r2, r3 = self.log_reluctance
        r = np.exp(((r3 * x + r2) * x + r1) * x + r0)
        s = self.saturation_Wb[1] * x + self.saturation_Wb[0]
        size = np.sqrt(current * current)
        gap = r * s
        b = gap + size + self.knee_A
        y = 2.0 * size / (np.sqrt(b * b - 4.0 * gap * size) + b)
        left = 1.0 - y
        psi = y * s
        per_saturation = (np.log(left) + y / left) * (self.knee_A * self.saturation_Wb[1])
        per_reluctance = 0.5 * psi * psi * r * ((3.0 * r3 * x + 2.0 * r2) * x + r1)
        return (per_reluctance - per_saturation - 0.5 * self.leakage_H[1] * size * size) * slope

    def _state(self, distance: FloatArray, current: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Force, motional constant and inductance from psi, without the series of :meth:`coenergy_derivatives`."""
        near = np.asarray(distance + self.distance_shift_m)
        x = np.log(near / self.reference_distance_m)
        r0, r1, r2, r3 = self.log_reluctance
        r = np.exp(((r3 * x + r2) * x + r1) * x + r0)
        r_slope = r * ((3.0 * r3 * x + 2.0 * r2) * x + r1) / near
        s, s_slope = self.saturation_Wb[0] + self.saturation_Wb[1] * x, self.saturation_Wb[1] / near
        size, c = np.abs(current), self.knee_A
        b = r * s + size + c
        y = 2.0 * size / (b + np.sqrt(b * b - 4.0 * r * s * size))
        psi, left = s * y, 1.0 - y
        rate = 1.0 / (r + c / (s * left * left))  # d psi / di
        leakage_slope = self.leakage_H[1] / near
        force = 0.5 * psi**2 * r_slope - c * (np.log(left) + y / left) * s_slope - 0.5 * leakage_slope * np.square(size)
        motional = (psi * r_slope - c * y / (left * left) * s_slope / s) * rate - leakage_slope * size
        return (
            force,
            np.where(np.asarray(current) < 0.0, -motional, motional),
            self.leakage_H[0] + self.leakage_H[1] * x + rate,
        )

    def flux_linkage(self, distance: FloatArray, currents: FloatArray) -> FloatArray:
        """Main flux and leakage in Wb."""
        current = only_current(currents)
        x = np.log((distance + self.distance_shift_m) / self.reference_distance_m)
        r0, r1, r2, r3 = self.log_reluctance
        gap = np.exp(((r3 * x + r2) * x + r1) * x + r0) * (s := self.saturation_Wb[0] + self.saturation_Wb[1] * x)
        size = np.abs(current)
        b = gap + size + self.knee_A
        psi = 2.0 * s * size / (b + np.sqrt(b * b - 4.0 * gap * size))
        linked = np.asarray(np.sign(current) * psi + (self.leakage_H[0] + self.leakage_H[1] * x) * current)
        return linked[..., None][..., : currents.shape[-1]]

    def _derivatives(self, distance: FloatArray, current: FloatArray, orders: Orders) -> list[FloatArray]:
        n_d, n_i = max(a for a, _ in orders), max(b for _, b in orders)
        series = self._series(distance, np.abs(current), n_d, n_i)
        sign = np.where(current < 0.0, -1.0, 1.0)
        return [series.derivative(a, b) * sign**b for a, b in orders]

    def _series(self, distance: FloatArray, current: FloatArray, n_d: int, n_i: int) -> TaylorSeries:
        """W' about points with currents >= 0."""
        count = n_d + n_i + 1
        d, i = distance_series(distance, n_d, n_i), current_series(current, n_d, n_i)
        x = _log(_plus((1.0 / self.reference_distance_m) * d, self.distance_shift_m / self.reference_distance_m), count)
        r0, r1, r2, r3 = self.log_reluctance
        exponent = _plus(_plus(_plus(r3 * x, r2) * x, r1) * x, r0)
        r = exponent.compose([np.exp(exponent.value)] * (count + 1))
        s, c = _plus(self.saturation_Wb[1] * x, self.saturation_Wb[0]), self.knee_A
        gap = r * s
        b = _plus(gap + i, c)
        root = _power(b * b - 4.0 * (gap * i), 0.5, count)
        y = 2.0 * (i * _power(b + root, -1.0, count))
        psi = y * s
        iron = c * (psi + s * _log(_plus(-1.0 * y, 1.0), count))
        leakage = _plus(self.leakage_H[1] * x, self.leakage_H[0])
        return psi * i - 0.5 * (r * psi * psi) + iron + 0.5 * (leakage * i * i)


def _plus(series: TaylorSeries, constant: float) -> TaylorSeries:
    coefficients = series.coefficients.copy()
    coefficients[0, 0, 0] += constant
    return TaylorSeries(coefficients)


def _power(series: TaylorSeries, exponent: float, count: int) -> TaylorSeries:
    derivatives, factor = [], 1.0
    for k in range(count + 1):
        derivatives.append(factor * series.value ** (exponent - k))
        factor *= exponent - k
    return series.compose(derivatives)


def _log(series: TaylorSeries, count: int) -> TaylorSeries:
    inverse = 1.0 / series.value
    derivatives, derivative = [np.log(series.value)], inverse
    for k in range(1, count + 1):
        derivatives.append(derivative)
        derivative = -k * inverse * derivative
    return series.compose(derivatives)
