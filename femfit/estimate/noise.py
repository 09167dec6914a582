"""How uncertain model and sensor are, with units, and the covariances Q and R that follow.

Sensor: white noise of one sample plus the converter's quantisation, LSB^2 / 12. Current: the driver's voltage error,
white from sample to sample, moves the currents by A sigma_U in a step, with the A = (1 - exp(-t_s L^-1 R)) R^-1 of
voltages that are held meanwhile. Motion: a force error F_e that varies along
the path is seen as white acceleration of density q = 2 (F_e / m)^2 / lambda, that is, as noise with the variance
(F_e / m)^2 and the correlation time 1 / lambda in which the body moves on. Over a step, white acceleration gives the
covariance q [[t^3 / 3, t^2 / 2], [t^2 / 2, t]] of distance and velocity.

What any filter can reach at an operating point, and whether its innovations are as large as it says.

At constant current the body obeys d'' = lambda^2 d with lambda^2 = (dF_0/dd - dF/dd) / m about the point where the
force F balances weight, springs and load, F_0. Without process noise a steady Kalman filter mirrors the unstable pole
to -lambda, and its error variance is 2 lambda times the measurement's spectral density R t_s. Hence standard deviation
of the measurement over that of the estimate is at most 1 / sqrt(2 lambda t_s).

References
----------
Y. Bar-Shalom, X. Li and T. Kirubarajan, Estimation with Applications to Tracking and Navigation (Wiley, 2001),
section 6.2.2 (white acceleration) and 8.2.1 (correlation time).
B. Widrow and I. Kollar, Quantization Noise (Cambridge, 2008), section 3.5 (LSB^2 / 12).
B. D. O. Anderson and J. B. Moore, Optimal Filtering (Prentice-Hall, 1979), section 4.4 (steady state of a filter for an
unstable process), applied here to d'' = lambda^2 d.
Y. Bar-Shalom, X. Li and T. Kirubarajan, Estimation with Applications to Tracking and Navigation (Wiley, 2001),
section 5.4 (consistency).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.special import gammaincinv

from femfit.core.errors import DomainError
from femfit.core.numerics import FloatArray
from femfit.estimate.holding import holding_currents
from femfit.model.actuator_model import ActuatorModel
from femfit.model.decay import responses
from femfit.model.dynamics import eddy_currents_of, state_derivative
from femfit.model.sensors import HALL, reading_of
from femfit.model.validity import ProcessNoise

UNKNOWN_FORCE_ERROR = 1e-3
"""Conventional: force error over the weight where the model file records no misfit, the fit's own target."""

DRIVER_ERROR = 1e-3
"""Derived: error of the winding's voltage over the driver's largest, one step of a pulse-width modulator of 10 bits."""

BIAS_DENSITY = 1e-3
"""Conventional: random walk of the Hall element's quiescent voltage in V / sqrt(s), 8 mV in a minute; a ratiometric
linear element drifts by some 10 mV over its temperature range (Allegro A1321 data sheet) within minutes of warming."""

OWN_VARIANCE = 1e-12
"""Conventional: what an effect's state gains in a step on its own, small beside its size of one: Q is definite."""

OWN_SHARE = 0.01
"""Conventional: part of the variance of an effect's state that does not follow the current, so that Q is definite."""

UNKNOWN_EDDY_ERROR = 0.01
"""Conventional: part by which eddy currents are off where their model does not say it, the error that a reduction is
asked for."""

LEAST_EDDY_SHARE = 1e-6
"""Numerical: deviation of a pattern's current over the largest of them, so that a covariance is definite."""

FIRST_DEVIATION_M = 1e-3
"""Conventional: first standard deviation of the distance of a body that is put on a support by hand; at most that of a
body that lies anywhere on its way with the same probability, the way over the root of twelve (derived)."""

FIRST_VELOCITY_M_S, FIRST_CURRENT_A = 0.05, 0.1
"""Conventional: first standard deviations of velocity and current of a body near rest."""


def unstable_pole(model: ActuatorModel, distance: float) -> float:
    """Unstable pole lambda = sqrt((dF_0/dd - dF/dd) / m) where the body is held."""
    currents = holding_currents(model, distance)
    place = np.asarray(distance)
    gradient = float(model.magnetics.slopes(place, currents).force_gradient)
    gradient -= float(model.require_motion().static_gradient(place))
    if gradient >= 0.0:
        held = " and ".join(f"{current:g} A" for current in currents)
        raise DomainError(
            "Force and springs together must fall with the distance for the levitation to be unstable; at "
            f"{1e3 * distance:g} mm{f' and {held}' if held else ''} its slope is {gradient:g} N/m, and no bound on the "
            "noise ratio follows."
        )
    return float(np.sqrt(-gradient / model.require_motion().mass_kg))


@dataclass(frozen=True)
class ConsistencyBand:
    """Interval for a mean of normalised innovations squared; 1 is expected."""

    lower: float
    upper: float

    @property
    def limits(self) -> tuple[float, float]:
        """Lower and upper."""
        return self.lower, self.upper

    def contains(self, value: float) -> bool:
        """Whether a mean lies in the band; NaN does not."""
        return self.lower <= value <= self.upper


def consistency_band(samples: int, confidence: float = 0.95) -> ConsistencyBand:
    """Two-sided band of the mean of so many normalised innovations squared.

    Those of a true filter are chi-square with one degree of freedom and white, so that their sum is chi-square with
    ``samples``.
    """
    lower, upper = 2.0 / samples * gammaincinv(0.5 * samples, 0.5 + np.array([-0.5, 0.5]) * confidence)
    return ConsistencyBand(float(lower), float(upper))


@dataclass(frozen=True)
class FilterNoise:
    """Standard deviations and densities of everything white."""

    acceleration_density: float  # q in m^2/s^3
    voltage_V: float | tuple[float, ...]  # One for all circuits, or one each
    hall_V: float
    bias_density: float = BIAS_DENSITY  # Random walk of the Hall bias, V / sqrt(s)
    # White noise of one sample by the name of a sensor, in its own unit; the model's own for one that is not here
    sensors: Mapping[str, float] = field(default_factory=dict)


def default_noise(model: ActuatorModel, distance: float | None = None) -> FilterNoise:
    """Noise of a model at a distance in m, derived as the module says; what a record told of it counts before."""
    circuits, motion = model.require_circuits(), model.require_motion()
    distance = operating_distance(model) if distance is None else distance
    rate = motion_rate(model, distance)
    weight = motion.mass_kg * abs(motion.gravity_m_s2)
    if model.misfit is None:
        error = UNKNOWN_FORCE_ERROR * max(weight, abs(float(motion.static_force(np.asarray(distance)))))
    else:  # a share of the weight is not stated where the forces are far above it
        share = model.misfit.force_rms_of_weight
        error = model.misfit.force_rms_N if share is None or not weight else share * weight
    recorded = model.process_noise or ProcessNoise()
    density, volts = recorded.acceleration_density, recorded.voltage_V
    errors = tuple(DRIVER_ERROR * max(abs(circuit.voltage_min_V), abs(circuit.voltage_max_V)) for circuit in circuits)
    return FilterNoise(
        acceleration_density=2.0 * (error / motion.mass_kg) ** 2 / rate if density is None else density,
        voltage_V=(errors[0] if len(errors) == 1 else errors) if volts is None else volts,
        hall_V=reading_of(model, HALL).white if model.sensor is not None else float("nan"),
    )


def motion_rate(model: ActuatorModel, distance: float) -> float:
    """How fast the body moves on from an error of its force, in 1/s.

    The unstable pole where the body can be held; elsewhere, as on a stop or where springs make its rest stable,
    sqrt(F / (m s)) with the largest net force F at this distance and the stroke s of the validity domain.
    """
    box, motion = model.validity, model.require_motion()
    _, currents = box.grid(1, 21, several=5)
    distances = np.full(len(currents), distance)
    box.require(distances, currents)
    try:
        return unstable_pole(model, distance)
    except DomainError:
        force = model.magnetics.force(distances, currents) - motion.static_force(np.asarray(distance))
        stroke = box.distance_max_m - box.distance_min_m
        return float(np.sqrt(np.abs(force).max() / (motion.mass_kg * stroke)))


def operating_distance(model: ActuatorModel) -> float:
    """Where a filter is tuned by default, in m: the reference's first step, or the middle of the validity box."""
    if model.reference_distances_m:
        return model.reference_distances_m[0]
    return 0.5 * (model.validity.distance_min_m + model.validity.distance_max_m)


def first_deviations(model: ActuatorModel) -> FloatArray:
    """First standard deviations of a model's states.

    That of the distance is no more than that of a body somewhere between its ends.
    """
    box, n = model.validity, len(model.circuits)
    near, far = np.clip(model.require_motion().ends, box.distance_min_m, box.distance_max_m)
    distance = min(FIRST_DEVIATION_M, float(far - near) / float(np.sqrt(12.0)))
    carried = eddy_currents_of(model, np.full(n, FIRST_CURRENT_A), FIRST_VELOCITY_M_S)
    least = LEAST_EDDY_SHARE * max(float(carried.max(initial=0.0)), FIRST_CURRENT_A)
    spreads = [memory.spread for memory in model.memories for _ in memory.names]
    return np.array([distance, FIRST_VELOCITY_M_S, *[FIRST_CURRENT_A] * n, *np.maximum(carried, least), *spreads])


def process_covariance(
    model: ActuatorModel, noise: FilterNoise, distance: float, bias_densities: Sequence[float] = ()
) -> FloatArray:
    """Q of one sample in m, m/s, A, pure numbers for the states of effects, and the units of biases, L at a distance.

    The errors of several drivers are independent, and each moves all currents: cov i = A diag(sigma_U)^2 A^T.

    Parameters
    ----------
    bias_densities : sequence of float
        Random walks of the biases, in their units over sqrt(s).
    """
    t, q = model.sample_time_s, noise.acceleration_density
    circuits, windings = len(model.circuits), model.windings
    middle = np.zeros(windings.count)
    middle[:circuits] = model.validity.current_limits_A.mean(axis=1)[:circuits]
    magnetic = windings.magnetics.state(np.asarray(distance), middle)
    moving = model.order
    result = np.zeros((moving + len(bias_densities),) * 2)
    result[:2, :2] = q * np.array([[t**3 / 3.0, t**2 / 2.0], [t**2 / 2.0, t]])
    moved_A_per_V = t * responses(magnetic.inductance + windings.series_H, windings.resistances_ohm, t)[0]
    steps = moved_A_per_V[:, :circuits] * np.asarray(noise.voltage_V)
    result[2 : windings.end, 2 : windings.end] = steps @ steps.T
    if model.eddy is not None:
        each = range(2 + circuits, windings.end)
        result[each, each] += _eddy_variances(model, magnetic.inductance, distance)
    if model.memory_names:
        _add_memory(result, model, distance, float(middle[0]))
    biases = range(moving, len(result))
    result[biases, biases] = np.square(bias_densities) * t
    return result


def _eddy_variances(model: ActuatorModel, inductance: FloatArray, distance: float) -> FloatArray:
    """What a step adds to each pattern's current: it is off by the patterns' error, and forgets in its time constant.

    A wandering error of the variance s^2 and the time constant T gains s^2 (1 - exp(-2 t / T)) in a step t.
    """
    eddy, box = model.eddy, model.validity
    assert eddy is not None  # noqa: S101  its caller asks
    share = min(eddy.error.largest, 1.0) if eddy.error is not None else UNKNOWN_EDDY_ERROR
    jumps = np.ptp(box.current_limits_A, axis=1)[: len(model.circuits)]
    carried = eddy_currents_of(model, jumps, FIRST_VELOCITY_M_S, distance)
    times = np.diag(inductance)[len(model.circuits) :] / eddy.resistances_ohm
    least = LEAST_EDDY_SHARE * max(float(carried.max()), FIRST_CURRENT_A)
    return np.maximum(share * carried, least) ** 2 * -np.expm1(-2.0 * model.sample_time_s / times)


def _add_memory(result: FloatArray, model: ActuatorModel, distance: float, current: float) -> None:
    """What moves the current moves the states of effects along; a part of it on their own keeps Q definite."""
    state, first = np.zeros((2, model.order)), model.windings.end
    state[:, 0], state[:, 2] = distance, current
    holding = model.require_circuit().resistance_ohm * current
    rates = state_derivative(model, state, np.array([holding, holding + 1.0]))
    along = (rates[1, first:] - rates[0, first:]) / (rates[1, 2] - rates[0, 2])
    variance, end = result[2, 2], first + len(along)
    result[first:end, 2:first] = np.outer(along, result[2, 2:first])
    result[2:first, first:end] = result[first:end, 2:first].T
    result[first:end, first:end] = variance * np.outer(along, along) + np.diag(
        OWN_SHARE * variance * along**2 + OWN_VARIANCE
    )
