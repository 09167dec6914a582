"""What any filter can reach at an operating point, and whether its innovations are as large as it says.

At constant current the body obeys d'' = lambda^2 d with lambda^2 = (dF_0/dd - dF/dd) / m about the point where the
force F balances weight, springs and load, F_0. Without process noise a steady Kalman filter mirrors the unstable pole
to -lambda, and its error variance is 2 lambda times the measurement's spectral density R t_s. Hence standard deviation
of the measurement over that of the estimate is at most 1 / sqrt(2 lambda t_s).

References
----------
B. D. O. Anderson and J. B. Moore, Optimal Filtering (Prentice-Hall, 1979), section 4.4 (steady state of a filter for an
unstable process), applied here to d'' = lambda^2 d.
Y. Bar-Shalom, X. Li and T. Kirubarajan, Estimation with Applications to Tracking and Navigation (Wiley, 2001),
section 5.4 (consistency).
"""

from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from femfit.core.errors import DomainError
from femfit.filters.holding import holding_currents
from femfit.model.actuator_model import ActuatorModel


def unstable_pole(model: ActuatorModel, distance: float) -> float:
    """Unstable pole lambda = sqrt((dF_0/dd - dF/dd) / m) where the body is held."""
    currents = holding_currents(model, distance)
    place = np.asarray(distance)
    gradient = float(model.magnetics.slopes_of_circuits(place, currents).force_gradient)
    gradient -= float(model.require_motion().static_gradient(place))
    if gradient >= 0.0:
        held = " and ".join(f"{current:g} A" for current in currents)
        raise DomainError(
            "Force and springs together must fall with the distance for the levitation to be unstable; at "
            f"{1e3 * distance:g} mm{f' and {held}' if held else ''} its slope is {gradient:g} N/m, and no bound on the "
            "noise ratio follows."
        )
    return float(np.sqrt(-gradient / model.require_motion().mass_kg))


def noise_ratio_bound(model: ActuatorModel, distance: float) -> float:
    """Best ratio of direct to filtered distance noise, 1 / sqrt(2 lambda t_s)."""
    return float(1.0 / np.sqrt(2.0 * unstable_pole(model, distance) * model.sample_time_s))


@dataclass(frozen=True)
class ConsistencyBand:
    """Interval for a mean of normalised innovations squared; 1 is expected."""

    lower: float
    upper: float

    def contains(self, value: float) -> bool:
        """Whether a mean lies in the band; NaN does not."""
        return self.lower <= value <= self.upper


def consistency_band(samples: int, confidence: float = 0.95) -> ConsistencyBand:
    """Two-sided band of the mean of so many normalised innovations squared.

    Those of a true filter are chi-square with one degree of freedom and white, so that their sum is chi-square with
    ``samples``. Quantiles by E. B. Wilson and M. M. Hilferty's cube-root transformation (Proc. Natl. Acad. Sci. 17
    (1931) 684), within 0.1 % for 60 samples and more (numpy has none).
    """
    width = 2.0 / (9.0 * samples)
    z = NormalDist().inv_cdf(0.5 + 0.5 * confidence) * width**0.5
    return ConsistencyBand((1.0 - width - z) ** 3, (1.0 - width + z) ** 3)
