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

from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy import sparse

from femfit.core.numerics import BoolArray, FloatArray, IntArray
from femfit.effects.conditions import Conditions, Nominal
from femfit.identify.constants import BEHIND, MIDDLE, NODES, PLAY, SLOPE_SPAN, SPAN
from femfit.identify.observations import TEMPERATURES, circumstances
from femfit.identify.series.balances import Motion
from femfit.identify.series.samples import Samples
from femfit.identify.series.weights import Weights, Windows, window_weights


@dataclass(frozen=True, eq=False)
class View:
    """How a group of channels sees a record.

    ``weights`` are those of the windows over the nodes; those of derivatives are zero where no balance is taken.
    """

    windows: Windows
    covariates: pd.DataFrame
    motion: Motion
    weights: Weights


def balance_view(samples: Samples, windows: Windows, nominal: Nominal) -> View:
    """Whole windows."""
    time, row = _nodes(windows)
    level, _ = _smoothed(samples, windows, time, behind=SPAN, ahead=SPAN, degree=3)
    _, slope = _smoothed(samples, windows, time, behind=SLOPE_SPAN, ahead=SLOPE_SPAN, degree=3)
    rows = Windows(windows.centre_s, np.arange(len(windows.centre_s)), windows.length_s)
    weights = window_weights(rows, time, row, np.ones(len(time), dtype=bool))
    over_samples = window_weights(windows, samples.time, samples.segment, samples.usable)
    covariates = _covariates(samples, windows, over_samples.mean, over_samples.slope, nominal)
    return View(windows, covariates, _motion(samples, windows, covariates, nominal, level, slope), weights)


def sensor_view(samples: Samples, windows: Windows, nominal: Nominal) -> View:
    """The middle thirds of windows."""
    time, row = _nodes(windows)
    half = 0.5 * MIDDLE * windows.length_s
    place = (time - windows.centre_s[row]) / half
    centre = np.where(np.abs(place) < 1.0, windows.centre_s[row] - half, time)
    level, slope = _smoothed(samples, windows, centre, behind=BEHIND, ahead=0.0, degree=2)
    bump = np.maximum(1.0 - place**2, 0.0) ** 2
    shape = len(windows.centre_s), len(time)
    bump /= np.bincount(row, bump)[row]
    mean, none = sparse.csr_array((bump, (row, np.arange(len(time)))), shape=shape), sparse.csr_array(shape)
    covariates = _covariates(samples, windows, mean @ level, mean @ slope, nominal)
    motion = _motion(samples, windows, covariates, nominal, level, slope)
    thirds = Windows(windows.centre_s, windows.segment, MIDDLE * windows.length_s)
    return View(thirds, covariates, motion, Weights(mean, none, none, np.ones(shape[0], dtype=bool)))


def _smoothed(
    samples: Samples, windows: Windows, centre_s: FloatArray, *, behind: float, ahead: float, degree: int
) -> tuple[sparse.csr_array, sparse.csr_array]:
    """Weights of value and slope at the nodes, by usable samples around their centres; spans are parts of a window."""
    time, row = _nodes(windows)
    stretch = samples.stretch
    return local_polynomials(
        time,
        stretch[_nearest(samples, windows)][row],
        samples.time,
        stretch,
        samples.usable,
        centre_s=centre_s,
        behind_s=behind * windows.length_s,
        ahead_s=ahead * windows.length_s,
        degree=degree,
    )


def _known(samples: Samples, name: str) -> FloatArray:
    return np.nan_to_num(samples.columns[name])


def _path(samples: Samples, level: sparse.csr_array) -> FloatArray:
    """The smoothed distance; a polynomial leads nowhere where the body never was."""
    recorded = samples.columns["distance_m"][samples.usable]
    return np.asarray(np.clip(level @ _known(samples, "distance_m"), recorded.min(), recorded.max()))


def _nodes(windows: Windows) -> tuple[FloatArray, IntArray]:
    """Times of the nodes, and the window of each."""
    offsets = np.linspace(-0.5, 0.5, NODES + 1)
    time = (windows.centre_s[:, None] + windows.length_s * offsets).ravel()
    return time, np.repeat(np.arange(len(windows.centre_s)), NODES + 1)


def _covariates(
    samples: Samples,
    windows: Windows,
    mean: sparse.csr_array,
    slope: sparse.csr_array,
    nominal: Nominal,
) -> pd.DataFrame:
    """What is known of every window, by weights of its means and of its mean derivatives."""
    nearest = _nearest(samples, windows)
    run, labels = pd.factorize(samples.run[nearest])
    start = np.array([samples.time[samples.run == label].min() for label in labels])
    within = windows.centre_s - start[run]
    order = np.round(within / windows.length_s - 0.5)
    longest = np.array([order[run == k].max() + 1.0 for k in range(len(labels))])
    before = np.concatenate([[0.0], np.cumsum(longest)[:-1]])
    current = mean @ _known(samples, "current_A")
    new = np.diff(run, prepend=-1) != 0
    temperatures, magnitude = {}, abs(mean)
    for name in TEMPERATURES:  # the mean over the samples of a window that have it; NaN where none has
        values = samples.columns[name]
        share = np.asarray(magnitude @ np.isfinite(values).astype(np.float64))
        total = np.asarray(magnitude @ np.nan_to_num(values))
        temperatures[name] = np.where(share > 0.0, total / np.maximum(share, 1e-300), np.nan)
    return pd.DataFrame(
        {
            "run": run,
            "mount": run,
            "distance_m": _path(samples, mean),
            "current_A": current,
            **{name: mean @ _known(samples, name) for name in samples.currents if name != "current_A"},
            "branch": _branch(current, new, PLAY * (nominal.current_max_A - nominal.current_min_A)),
            **temperatures,
            "order": order,
            "elapsed": before[run] + order,
            "time_s": within,
            "velocity_m_s": slope @ _known(samples, "distance_m"),
            "current_rate_A_s": slope @ _known(samples, "current_A"),
        }
    )


def _branch(current: FloatArray, new: BoolArray, play: float) -> FloatArray:
    """+1 after the current rose by more than the play, -1 after it fell by it, 0 before either."""
    result, low, high, branch = np.zeros(len(current)), 0.0, 0.0, 0.0
    for k, (value, fresh) in enumerate(zip(current, new, strict=True)):
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
        first, last = np.searchsorted(samples.segment, [number, number + 1])
        result.append(min(first + np.searchsorted(samples.time[first:last], centre), last - 1))
    return np.array(result, dtype=int)


def _motion(
    samples: Samples,
    windows: Windows,
    covariates: pd.DataFrame,
    nominal: Nominal,
    level: sparse.csr_array,
    slope: sparse.csr_array,
) -> Motion:
    """The smoothed motion at the nodes of all windows."""
    time, row = _nodes(windows)
    new = np.diff(windows.centre_s) > 1.5 * windows.length_s
    new |= (np.diff(windows.segment) != 0) | (np.diff(windows.centre_s) <= 0.0)
    first = np.zeros(len(time), dtype=bool)
    first[:: NODES + 1] = np.append(True, new)
    within = covariates["time_s"].to_numpy()[row] + time - windows.centre_s[row]
    campaign = (covariates["elapsed"] - covariates["order"]).to_numpy()[row]
    cycle = covariates.groupby("run")["current_A"]
    commands = [level @ _known(samples, name) for name in samples.commands]
    volts = commands[0] if len(commands) == 1 else np.array(commands).reshape(len(commands), level.shape[0]).T
    return Motion(
        time_s=time,
        first=first,
        distance_m=_path(samples, level),
        current_A=level @ samples.current,
        voltage_V=volts,
        at=Conditions(
            nominal=nominal,
            **circumstances(covariates.iloc[row]),
            time_s=within,
            elapsed=within + windows.length_s * campaign,
            velocity_m_s=slope @ _known(samples, "distance_m"),
            current_rate_A_s=slope @ _known(samples, "current_A"),
            current_turn_A=(cycle.transform("min").to_numpy()[row], cycle.transform("max").to_numpy()[row]),
        ),
    )


def local_polynomials(
    node_s: FloatArray,
    node_stretch: IntArray,
    time: FloatArray,
    stretch: IntArray,
    usable: BoolArray,
    *,
    centre_s: FloatArray,
    behind_s: float,
    ahead_s: float,
    degree: int,
) -> tuple[sparse.csr_array, sparse.csr_array]:
    """Weights of value and slope of a local polynomial at n nodes over N samples, two sparse arrays of shape (n, N).

    The samples that count for a node stand around its centre, which is the node itself or before it, from so far behind
    to so far ahead, by the weight (1 - s^2)^2; more, on the same sides, where there are too few of them. All stand in
    the node's stretch: no path is smooth across an impact. Where it begins, what lacks behind is taken ahead.
    """
    here = np.flatnonzero(usable)
    # One clock for all stretches, far enough apart that no node sees another stretch
    span = float(time.max() - time.min()) + 10.0 * (behind_s + ahead_s)
    clock, asked = time[here] - time.min() + span * stretch[here], centre_s - time.min() + span * node_stretch
    least, slack = 2 * (degree + 1), 1e-9 * (behind_s + ahead_s)
    opens, closes = (np.searchsorted(stretch[here], node_stretch, side) for side in ("left", "right"))
    first = np.searchsorted(clock, asked - behind_s - slack)
    last = np.searchsorted(clock, np.maximum(asked + ahead_s, clock[opens] + behind_s) + slack)
    few = last - first < least
    shift = np.where(ahead_s > 0.0, least // 2, least)
    begin = np.searchsorted(clock, asked + slack) - shift
    begin = np.clip(begin, opens, np.maximum(closes - least, opens))
    first, last = np.where(few, begin, first), np.where(few, np.minimum(begin + least, closes), last)
    picked = first[:, None] + np.arange(int((last - first).max()))
    inside = picked < last[:, None]
    picked = np.minimum(picked, len(clock) - 1)
    distance = clock[picked] - asked[:, None]
    farthest = np.abs(np.where(inside, distance, 0.0)).max(axis=1, keepdims=True)
    width = np.maximum(max(behind_s, ahead_s), 1.01 * farthest)
    weight = np.where(inside, (1.0 - (distance / width) ** 2) ** 2, 0.0)
    s = (distance - (node_s - centre_s)[:, None]) / width
    basis = s[:, :, None] ** np.arange(degree + 1)
    carried = weight[:, :, None] * basis
    gram = np.einsum("nka,nkb->nab", carried, basis)
    unit = np.zeros((len(asked), degree + 1, 2))
    unit[:, 0, 0], unit[:, 1, 1] = 1.0, 1.0 / width[:, 0]
    value = carried @ np.linalg.solve(gram, unit)
    row = np.repeat(np.arange(len(asked)), picked.shape[1])[inside.ravel()]
    column = here[picked[inside]]
    shape = (len(asked), len(time))
    level, slope = (sparse.csr_array((value[:, :, j][inside], (row, column)), shape=shape) for j in (0, 1))
    return level, slope
