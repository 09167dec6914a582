"""The motion of a record as balances and as sensors see it: windows, their covariates, and smoothed motion at nodes.

A balance takes a whole window. A sensor takes the window's middle third, and of the motion only what had happened by
then: in a closed loop a sensor's noise drives the current that follows, so that the mean of the noise over a window and
the rate of the current in that window are correlated, and any effect of a rate would be found in clean data. Noise and
what came before it are independent.

References
----------
L. Ljung, System Identification (Prentice Hall, 1999), section 13.4: bias from feedback of the noise.
J. Fan and I. Gijbels, Local Polynomial Modelling and Its Applications (Chapman and Hall, 1996), section 3.2.
"""

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy import sparse

from femfit.core.numerics import FloatArray, IntArray
from femfit.effects.conditions import TEMPERATURES, Conditions, Nominal
from femfit.identify.observations import circumstances
from femfit.identify.series.constants import BEHIND, MIDDLE, PLAY, SLOPE_SPAN, SPAN
from femfit.identify.series.motion import Motion
from femfit.identify.series.samples import Samples
from femfit.identify.series.weights import Weights, Windows, local_polynomials, window_weights
from femfit.model.actuator_model import ActuatorModel

NODES = 12
"""Numerical: intervals between the nodes of a window."""


@dataclass(frozen=True, eq=False)
class View:
    """How a group of channels sees a record.

    ``weights`` are those of the windows over the nodes; those of derivatives are zero where no balance is taken.
    """

    windows: Windows
    covariates: pd.DataFrame
    motion: Motion
    weights: Weights


def balance_view(base: ActuatorModel, samples: Samples, windows: Windows, nominal: Nominal) -> View:
    """Whole windows."""
    time, row = _nodes(windows)
    level, _ = _smoothed(samples, windows, time, behind=SPAN, ahead=SPAN, degree=3)
    _, slope = _smoothed(samples, windows, time, behind=SLOPE_SPAN, ahead=SLOPE_SPAN, degree=3)
    each_alone = replace(windows, segment=np.arange(len(windows.centre_s)))
    weights = window_weights(each_alone, time, row, np.ones(len(time), dtype=bool))
    window_means = window_weights(windows, samples["time_s"], samples["segment"], samples["usable"])
    covariates = _covariates(samples, windows, window_means.mean, window_means.slope, nominal)
    return View(windows, covariates, _motion(base, samples, windows, covariates, level, slope, nominal), weights)


def sensor_view(base: ActuatorModel, samples: Samples, windows: Windows, nominal: Nominal) -> View:
    """The middle thirds of windows."""
    time, row = _nodes(windows)
    thirds = replace(windows, length_s=MIDDLE * windows.length_s)
    place = (time - windows.centre_s[row]) / (0.5 * thirds.length_s)
    centre = np.where(np.abs(place) < 1.0, windows.centre_s[row] - 0.5 * thirds.length_s, time)
    level, slope = _smoothed(samples, windows, centre, behind=BEHIND, ahead=0.0, degree=2)
    bump = np.maximum(1.0 - place**2, 0.0) ** 2
    mean = sparse.csr_array((bump / np.bincount(row, bump)[row], (row, np.arange(len(time)))))
    none = sparse.csr_array(mean.shape)
    weights = Weights(mean, none, none, np.ones(len(windows.centre_s), dtype=bool))
    covariates = _covariates(samples, windows, mean @ level, mean @ slope, nominal)
    return View(thirds, covariates, _motion(base, samples, windows, covariates, level, slope, nominal), weights)


def _smoothed(
    samples: Samples, windows: Windows, centre_s: FloatArray, *, behind: float, ahead: float, degree: int
) -> tuple[sparse.csr_array, sparse.csr_array]:
    """Weights of value and slope at the nodes, by samples around their centres; spans are parts of a window."""
    time, row = _nodes(windows)
    stretch, spans = (
        samples["stretch"][_nearest(samples, windows)][row],
        (behind * windows.length_s, ahead * windows.length_s),
    )
    return local_polynomials(time, stretch, samples["time_s"], samples["stretch"], centre_s, spans, degree)


def _path(samples: Samples, level: sparse.csr_array) -> FloatArray:
    """The smoothed distance; a polynomial leads nowhere where the body never was."""
    recorded = samples["distance_m"]
    return np.asarray(np.clip(level @ recorded, recorded.min(), recorded.max()))


def _nodes(windows: Windows) -> tuple[FloatArray, IntArray]:
    """Times of the nodes, and the window of each."""
    offsets = np.linspace(-0.5, 0.5, NODES + 1)
    time = (windows.centre_s[:, None] + windows.length_s * offsets).ravel()
    return time, np.repeat(np.arange(len(windows.centre_s)), NODES + 1)


def _covariates(
    samples: Samples, windows: Windows, mean: sparse.csr_array, slope: sparse.csr_array, nominal: Nominal
) -> pd.DataFrame:
    """What is known of every window, by weights of its means and of its mean derivatives."""
    nearest = _nearest(samples, windows)
    run = pd.factorize(samples["run"][nearest])[0]
    within = windows.centre_s - samples["time_s"][nearest] + samples["since_start_s"][nearest]
    order = np.round(within / windows.length_s - 0.5)
    longest = pd.Series(order + 1.0).groupby(run).max().to_numpy()
    before = np.append(0.0, np.cumsum(longest)[:-1])
    current = mean @ samples["current_A"]
    temperatures, magnitude = {}, abs(mean)
    for name in TEMPERATURES:  # the mean over the samples of a window that have it; NaN where none has
        share = np.asarray(magnitude @ np.isfinite(samples[name]).astype(np.float64))
        total = np.asarray(magnitude @ np.nan_to_num(samples[name]))
        temperatures[name] = np.where(share > 0.0, total / np.maximum(share, 1e-300), np.nan)
    return pd.DataFrame(
        {
            "run": run,
            "mount": run,
            "distance_m": _path(samples, mean),
            "current_A": current,
            **{name: mean @ samples[name] for name in samples.currents if name != "current_A"},
            "branch": _branch(current, run, PLAY * (nominal.current_max_A - nominal.current_min_A)),
            **temperatures,
            "order": order,
            "elapsed": before[run] + order,
            "time_s": within,
            "velocity_m_s": slope @ samples["distance_m"],
            "current_rate_A_s": slope @ samples["current_A"],
        }
    )


def _branch(current: FloatArray, run: IntArray, play: float) -> FloatArray:
    """+1 after the current rose by more than the play, -1 after it fell by it, 0 before either in a run."""
    result, low, high, branch = np.zeros(len(current)), 0.0, 0.0, 0.0
    for k, (value, fresh) in enumerate(zip(current, np.diff(run, prepend=-1) != 0, strict=True)):
        low, high, branch = (value, value, 0.0) if fresh else (min(low, value), max(high, value), branch)
        if value > low + play:
            branch, low = 1.0, value - play
        if value < high - play:
            branch, high = -1.0, value + play
        result[k] = branch
    return result


def _nearest(samples: Samples, windows: Windows) -> IntArray:
    """The sample at the middle of each window."""
    result = []
    for number, centre in zip(windows.segment, windows.centre_s, strict=True):
        first, last = np.searchsorted(samples["segment"], [number, number + 1])
        result.append(min(first + np.searchsorted(samples["time_s"][first:last], centre), last - 1))
    return np.array(result, dtype=int)


def _motion(
    base: ActuatorModel,
    samples: Samples,
    windows: Windows,
    covariates: pd.DataFrame,
    level: sparse.csr_array,
    slope: sparse.csr_array,
    nominal: Nominal,
) -> Motion:
    """The smoothed motion at the nodes of all windows."""
    time, row = _nodes(windows)
    apart = np.diff(windows.centre_s)
    new = np.append(True, (apart > 1.5 * windows.length_s) | (apart <= 0.0) | (np.diff(windows.segment) != 0))
    first = np.append(True, np.diff(row) != 0) & new[row]
    within = covariates["time_s"].to_numpy()[row] + time - windows.centre_s[row]
    campaign = (covariates["elapsed"] - covariates["order"]).to_numpy()[row]
    conditions = Conditions(
        nominal=nominal,
        **circumstances(covariates.iloc[row], ["run"]),
        time_s=within,
        elapsed=within + windows.length_s * campaign,
        velocity_m_s=slope @ samples["distance_m"],
        current_rate_A_s=slope @ samples["current_A"],
    )
    currents, voltages = (level @ samples.stacked(names) for names in (samples.currents, samples.commands))
    return Motion(base, time, first, _path(samples, level), currents, voltages, conditions)
