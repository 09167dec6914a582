"""The moments that each filter computes.

The unscented Kalman filter with control input, the paper's (19) to (31), in difference form.

With delta_i = Y_i - Y_0 and s = sum_i W_i delta_i, the weighted mean is Y_0 + s, and the weighted covariance about it
is sum_{i>0} W_i delta_i delta_i^T + (2 - alpha^2) s s^T: the centre weight, -2.5e5 for the paper's alpha = 0.002, has
cancelled algebraically, so that it cannot cancel numerically. Here alpha is 1, beta 2 (a Gaussian) and kappa 0. New
points are drawn for the update, so that they contain Q.

The extended Kalman filter: the covariance follows the Jacobians of transition and measurement.

The Jacobians are exact where the process has them (the levitation process does, from the model's own equations)
and central differences otherwise. The covariance is updated in Joseph's form, which keeps it positive definite.

References
----------
A. Chowdhury and A. Sarjas, Sensors 16 (2016) 1504, eqs. (19) to (31).
S. J. Julier and J. K. Uhlmann, Proc. IEEE 92 (2004) 401.
S. J. Julier, The scaled unscented transformation, American Control Conference (2002) 4555.
D. Simon, Optimal State Estimation (Wiley, 2006), sections 13.2 and 5.2.
"""

from dataclasses import dataclass
from functools import cached_property
from math import sqrt
from typing import Any, ClassVar, final

from femfit.estimate.filter import Filter
from femfit.estimate.single_step import Terms


@final
@dataclass(frozen=True, eq=False, repr=False)
class ExtendedFilter(Filter):
    """Extended Kalman filter; parameters as in :class:`Filter`."""

    title: ClassVar[str] = "extended Kalman filter"

    def predicted(self, of: Terms, mean: Any, factor: Any, inputs: Any) -> tuple[Any, Any]:
        """F L (F L)' + Q."""
        moved, slope = of.moved_with_slope(mean, inputs)
        root = of.product(slope, factor)
        return moved, of.product(root, of.turned(root)) + of.noise

    def corrected(
        self, of: Terms, sensor: int, before: tuple[Any, Any, Any], reading: Any, noise: Any
    ) -> tuple[Any, Any, Any, Any]:
        """(1 - K H) P (1 - K H)' + K R K'."""
        mean, covariance, _ = before
        slope = of.read_slope(sensor, mean)
        cross = of.product(covariance, of.turned(slope))
        variance = of.product(slope, cross) + noise
        gain, innovation = cross / variance, reading - of.read(sensor, mean)
        remainder = of.unit - of.product(gain, slope)
        covariance = of.product(of.product(remainder, covariance), of.turned(remainder))
        covariance = covariance + noise * of.product(gain, of.turned(gain))
        return mean + gain * innovation, 0.5 * (covariance + of.turned(covariance)), innovation, variance


@final
@dataclass(frozen=True, eq=False, repr=False)
class UnscentedFilter(Filter):
    """Unscented Kalman filter."""

    title: ClassVar[str] = "unscented Kalman filter"
    is_unscented: ClassVar[bool] = True

    @cached_property
    def scaling(self) -> tuple[float, float, float]:
        """Spread sqrt(n + lambda) of the points, weight W_i of all but the centre, and weight of s s^T.

        The points lie as far out as without eddy currents: with many they would leave the model's distances.
        """
        order = self.process.order
        without_eddies = order - (self.process.model.eddy.count if self.process.model.eddy else 0)
        return sqrt(without_eddies), 0.5 / without_eddies, 2.0 - without_eddies / order

    def predicted(self, of: Terms, mean: Any, factor: Any, inputs: Any) -> tuple[Any, Any]:
        """Mean and covariance of the points one sample later, eqs. (21) to (24)."""
        _, weight, shift_weight = self.scaling
        moved = of.moved(self._drawn(of, mean, factor), inputs)
        delta = moved[:, 1:] - moved[:, :1]
        shift = weight * of.total(delta)
        covariance = weight * of.product(delta, of.turned(delta)) + shift_weight * of.product(shift, of.turned(shift))
        return moved[:, :1] + shift, covariance + of.noise

    def corrected(
        self, of: Terms, sensor: int, before: tuple[Any, Any, Any], reading: Any, noise: Any
    ) -> tuple[Any, Any, Any, Any]:
        """Mean and covariance by those of the readings of points that are drawn anew, eqs. (25) to (31).

        They lie in pairs mean +- spread L_k, whose differences in z are v, and whose sums the rest r of the variance
        S = v'v + r. The covariance is that of J. Potter's square root L - L v v' / (S + sqrt(S r)) (Simon, section
        6.3.3), which no rounding makes indefinite.
        """
        (mean, _, factor), (spread, weight, shift_weight), half = before, self.scaling, self.process.order
        readings = of.read(sensor, self._drawn(of, mean, factor))
        delta = readings[:, 1:] - readings[:, :1]
        across, both = weight * spread * (delta[:, :half] - delta[:, half:]), delta[:, :half] + delta[:, half:]
        shift = weight * of.total(both)
        rest = 0.5 * weight * of.product(both, of.turned(both)) + shift_weight * shift * shift + noise
        variance, cross = of.product(across, of.turned(across)) + rest, of.product(factor, of.turned(across))
        root = factor - of.product(cross / (variance + (variance * rest) ** 0.5), across)
        innovation = reading - (readings[:, :1] + shift)
        return mean + cross * (innovation / variance), of.product(root, of.turned(root)), innovation, variance

    def _drawn(self, of: Terms, mean: Any, factor: Any) -> Any:
        """The points mean, mean + spread L_k and mean - spread L_k, eq. (20)."""
        columns = self.scaling[0] * factor
        return of.beside(mean, mean + columns, mean - columns)
