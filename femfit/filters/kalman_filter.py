"""A Kalman filter for a model, ready to start."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

from femfit.core.errors import FilterError
from femfit.filters.extended import ExtendedFilter
from femfit.filters.filter import Filter
from femfit.filters.levitation import levitation_process
from femfit.filters.noise import FilterNoise
from femfit.filters.unscented import UnscentedFilter
from femfit.model.actuator_model import ActuatorModel
from femfit.model.json_file import model_of

FilterKind = Literal["ukf", "ekf"]

_KINDS: dict[str, type[Filter]] = {"ukf": UnscentedFilter, "ekf": ExtendedFilter}


def kalman_filter(
    model: ActuatorModel | str | Path,
    kind: FilterKind = "ukf",
    *,
    sensors: Sequence[str] | None = None,
    biases: Sequence[str] | None = None,
    hall_bias: bool = True,
    noise: FilterNoise | None = None,
    distance: float | None = None,
    first_deviation_m: float | None = None,
    commanded: bool = False,
) -> Filter:
    """A filter of a model, its noise derived from the model and its first covariance chosen.

    Parameters
    ----------
    kind : {'ukf', 'ekf'}
        Unscented or extended.
    sensors : sequence of str or None
        Names of the sensors that it reads, as ``("current", "laser")``, in the order of a measurement's entries; the
        Hall element where None, or all sensors where there is none.
    biases : sequence of str or None
        Sensors whose bias is estimated, each as a state after the others.
    hall_bias : bool
        Estimate the Hall element's offset where ``biases`` is None and it is read.
    noise : FilterNoise or None
        Derived by :func:`femfit.filters.noise.default_noise` where None.
    distance : float or None
        Operating point in m; the model's first reference distance, or the middle of its range, where None.
    first_deviation_m : float or None
        Standard deviation of the first estimate's distance; 1 mm where None, or less where the way is short.
    commanded : bool
        Whether it is stepped with what the drivers are told, in V or A for a current amplifier, instead of the voltages
        across the circuits.

    Returns
    -------
    Filter
        ``start([distance_m, velocity_m_s, current_A])``, then ``step(state, voltage, readings)`` every sample; a
        reading that is missing is NaN.

    Raises
    ------
    MissingPartError
        If the model lacks circuit, motion, sensor or inductance.
    FilterError
        If the kind is unknown.

    Examples
    --------
    >>> import femfit as ff
    >>> ukf = ff.kalman_filter("model.json")
    >>> ukf.process.names
    ('distance_m', 'velocity_m_s', 'current_A', 'hall_bias_V')
    >>> state = ukf.start([0.022, 0.0, 0.4])
    >>> state = ukf.step(state, 1.1, 2.7)
    >>> state.mean.shape
    (1, 4)
    """
    if kind not in _KINDS:
        raise FilterError(f"The kind of a filter must be one of {', '.join(_KINDS)}; instead received {kind!r}.")
    model = model_of(model)
    process = levitation_process(
        model,
        hall_bias=hall_bias,
        noise=noise,
        distance=distance,
        sensors=sensors,
        biases=biases,
        commanded=commanded,
    )
    covariance = process.require_start_covariance().copy()
    if first_deviation_m is not None:
        covariance[0, 0] = first_deviation_m**2
    return _KINDS[kind](replace(process, start_covariance=covariance))
