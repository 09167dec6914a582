"""Single readings that contradict all their neighbours: a slipped digit, a spike, a loose contact.

Each reading is predicted by a robust local plane through its nearest readings of the same run, in distance, current,
branch and time, without itself. What is set aside is alone: its neighbours agree with each other, and fewer than a
quarter of its repeats deviate with it. A physical effect is seen by more than one reading and is kept. At the border of
the range the plane extrapolates, and a smooth curve may leave it by any amount: there a reading is set aside only if a
repeat of its setting does not deviate with it, or if it slipped against the prediction by a sign or a factor of two.

References
----------
P. J. Rousseeuw and A. M. Leroy, Robust Regression and Outlier Detection (Wiley, 1987), sections 1.1 and 3.3: the
median absolute deviation as a scale that outliers do not move.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pandas as pd
from scipy.spatial import cKDTree

from femfit.core.numerics import BoolArray, FloatArray, IntArray, even_scale, robust_deviation
from femfit.core.results import Finding
from femfit.tables.checks import Expected, checked, set_aside
from femfit.tables.findings import finding
from femfit.tables.measurement import BenchTable

USUAL_OUTLIERS = 0.02
"""Assumed: part of a channel that a loose contact or a slip may be; more are warned of."""

_NEIGHBOURS, _LEAST = 12, 8
"""Assumed: neighbours that a reading is judged by, and the fewest."""

_SIGMA = 8.0
"""Assumed: deviation, in local standard deviations, from which a lone reading is set aside."""

_ALIKE = 0.5
"""Conventional: part of a reading's deviation from which a repeat of its setting deviates as well."""

_COMPANY = 0.25
"""Assumed: part of the repeats of a setting, and one at least, that deviate with a reading which is not alone."""

_MOST = 0.1
"""Assumed: largest part of a channel that can be outliers; more are its nature."""

_ROUNDS = 20
"""Numerical: rounds of setting aside, after which a channel is left as it is."""

_REPEATS_APART = 1e-6
"""Numerical: by how much repeats of a setting are set apart, over the scale on which neighbours are far."""

_PLANES = 2
"""Conventional: planes that are fitted to a reading's neighbours, each without what the one before leaves outside."""

_AXES, _RANGES = 3, 2
"""Derived: distance, current and branch, and those of them that a reading can lie between."""

_SLIP = 2.0
"""Conventional: a slipped digit or decimal point changes a reading at least so much, seen against all neighbours."""


def without_outliers(table: BenchTable, predicted: Mapping[str, FloatArray]) -> BenchTable:
    """A table without single readings that contradict all their neighbours, by what a model leaves of each channel."""
    rows, findings = checked(table.rows, (outliers,), Expected(predicted))
    return replace(table, rows=rows, findings=(*table.findings, *findings))


def outliers(rows: pd.DataFrame, model: Expected | None) -> list[Finding]:
    """Single readings whose deviation from a model contradicts that of all neighbours.

    Without a model a steep curve's true end looks like an outlier, so that readings are compared by what the model
    leaves of them.
    """
    predicted = model.predicted if model else {}
    placed = rows[["distance_m", "current_A"]].notna().all(axis=1).to_numpy()
    settings = pd.DataFrame({"distance": even_scale(rows["distance_m"].to_numpy()), "current": rows["current_A"]})
    scaled = (settings - settings.min()) / (settings.max() - settings.min()).clip(lower=1e-300)
    places = scaled.assign(branch=0.1 * rows["branch"]).to_numpy()  # the branches a little apart
    findings: list[Finding] = []
    for name in (name for name in map(str, rows) if name in predicted):
        values, expected = rows[name].to_numpy(), predicted[name]
        readable = np.flatnonzero(np.isfinite(values - expected) & placed)
        if len(readable) < 2:
            continue
        # The smallest usual distance between the levels of a coarse channel
        levels = np.unique(values[readable])
        step = float(np.quantile(np.diff(levels), 0.1)) if 1 < len(levels) < 0.9 * len(readable) else 0.0
        run, residual = pd.factorize(rows["run"].to_numpy()[readable])[0], (values - expected)[readable]
        lone = readable[isolated_outliers(residual, places[readable], run, expected[readable], step)]
        if not len(lone):
            continue
        shown = [
            f"{values[k]:.5g} at {1e3 * rows['distance_m'][k]:.4g} mm and {rows['current_A'][k]:.4g} A "
            f"(run {rows['run'][k]:g}, order {rows['order'][k]:g})"
            for k in lone[:3].tolist()
        ]
        facts = {"readings": len(lone), "shown": "; ".join(shown + ["and so on"] * (len(lone) > 3))}
        code = "outliers many" if len(lone) > USUAL_OUTLIERS * len(readable) else "outliers"
        remark = finding(code, size=float(len(lone)), column=name, **facts)
        findings.append(set_aside(remark, np.isin(np.arange(len(rows)), lone)))
    return findings


def isolated_outliers(
    value: FloatArray, place: FloatArray, run: IntArray, predicted: FloatArray, floor: float = 0.0
) -> BoolArray:
    """Find the readings that contradict all of their neighbours: at most 10 %, else none.

    Each value is a reading of one channel minus its prediction, its place, shape (n, 3), distance, current and branch,
    scaled so that neighbours in each are about equally far; only readings of one run are neighbours. The floor is the
    least standard deviation of a reading, in the channel's unit: its quantisation.
    """
    # Equally near neighbours are taken in this order, so that the order of the rows does not matter
    order = np.lexsort((value, *place.T[::-1], run))
    value, place, run, predicted = value[order], place[order], run[order], predicted[order]
    # Of many repeats each has neighbours of its own, whatever they read
    apart = np.random.default_rng(len(value)).permutation(len(value)) * (_REPEATS_APART / len(value))
    place = np.column_stack([place, apart])
    outlier = np.zeros(len(value), dtype=bool)
    for _ in range(_ROUNDS):
        remaining = np.flatnonzero(~outlier)
        lone = remaining[_lone(value[remaining], place[remaining], run[remaining], predicted[remaining], floor)]
        if not len(lone):
            break
        outlier[lone] = True
        if outlier.sum() > max(1.0, _MOST * len(value)):
            return np.zeros(len(value), dtype=bool)
    return np.asarray(outlier[np.argsort(order)])


def _lone(value: FloatArray, place: FloatArray, run: IntArray, predicted: FloatArray, floor: float) -> IntArray:
    """Lone readings of one round: the most deviating among their neighbours, whose neighbours agree without them."""
    near = _nearest(place, run)
    judged = np.flatnonzero(near[:, 0] >= 0)
    if len(judged) < 2 * _LEAST:
        return np.zeros(0, dtype=np.intp)
    deviation, scale = np.zeros(len(value)), np.full(len(value), np.inf)
    offset = (place[near[judged]] - place[judged][:, None, :])[..., :_AXES]
    deviation[judged] = value[judged] - _planes(value[near[judged]], offset)[:, 0]
    around = deviation[near[judged]]
    local = robust_deviation(around - np.median(around, axis=1)[:, None], axis=1)
    usual = robust_deviation(deviation[judged])
    scale[judged] = np.sqrt(local**2 + (0.5 * usual) ** 2 + floor**2)
    score = deviation / np.maximum(scale, 1e-300)
    largest = np.abs(score[judged]) >= np.maximum(np.abs(score[near[judged]]).max(axis=1), _SIGMA)
    alone = [k for k in judged[largest] if _is_alone(k, near[k], value, place, predicted, scale[k])]
    return np.array(alone, dtype=np.intp)


def _is_alone(
    k: int, neighbours: IntArray, value: FloatArray, place: FloatArray, predicted: FloatArray, scale: float
) -> bool:
    """Whether the neighbours agree once the reading is left out, and can judge it, and no repeat deviates with it."""
    offset = (place[neighbours] - place[k])[:, :_AXES]
    plane = _planes(value[neighbours][None], offset[None])[0]
    rest = value[neighbours] - plane[0] - offset @ plane[1:]
    if abs(value[k] - plane[0]) < _SIGMA * max(robust_deviation(rest), float(scale)):
        return False
    repeats = np.flatnonzero((np.abs(place - place[k]).max(axis=1) < 1e-3) & (np.arange(len(value)) != k))
    # What a device does at a setting, repeats show: they read alike, and not what the neighbours say
    off = (value[repeats] - plane[0]) / (value[k] - plane[0])
    if len(repeats) and np.count_nonzero(off > _ALIKE) >= max(1.0, _COMPANY * len(repeats)):
        return False
    # Neighbours on either side in each setting in which they differ interpolate the reading
    low, high = offset[:, :_RANGES].min(axis=0), offset[:, :_RANGES].max(axis=0)
    between = bool(((low < 0.0) & (high > 0.0))[high > low].all())
    return between or len(repeats) > 0 or _slipped(k, neighbours, value, predicted)


def _slipped(k: int, neighbours: IntArray, value: FloatArray, predicted: FloatArray) -> bool:
    """Whether a reading over its prediction is of the other sign than all neighbours, or off by a factor of two."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        ratio = 1.0 + value / predicted
    around, reading = ratio[neighbours], ratio[k]
    one_sign = np.isfinite(around).all() and (np.all(around > 0.0) or np.all(around < 0.0))
    if not one_sign or np.isnan(reading):
        return False
    reading, around = reading * np.sign(around[0]), np.abs(around)
    return bool(reading < around.min() / _SLIP or reading > _SLIP * around.max())


def _nearest(place: FloatArray, run: IntArray) -> IntArray:
    """Indices of each reading's neighbours in its run, shape (n, neighbours); -1 where there are too few."""
    result = np.full((len(place), _NEIGHBOURS), -1, dtype=np.intp)
    for number in np.unique(run):
        of_run = np.flatnonzero(run == number)
        if len(of_run) <= _LEAST:
            continue
        count = min(_NEIGHBOURS, len(of_run) - 1)
        _, index = cKDTree(place[of_run]).query(place[of_run], k=count + 1)
        for row, nearest in enumerate(np.asarray(index)):
            result[of_run[row]] = np.resize(of_run[nearest[nearest != row][:count]], _NEIGHBOURS)
    return result


def _planes(value: FloatArray, offset: FloatArray) -> FloatArray:
    """Coefficients of robust planes: each without what lies three deviations off the one before, the median at first.

    ``value`` has the shape (m, neighbours), ``offset`` (m, neighbours, k), the result (m, 1 + k). Directions without
    spread are left alone.
    """
    columns, centre = np.concatenate([np.ones((*value.shape, 1)), offset], axis=2), np.median(value, axis=1)
    size = columns.shape[2]
    residual, planes = np.abs(value - centre[:, None]), np.zeros((len(value), size))
    for _ in range(_PLANES):
        keep = residual <= 3.0 * robust_deviation(residual, axis=1)[:, None]
        keep |= (keep.sum(axis=1) < size + 2)[:, None]
        weighted = columns * keep[:, :, None]
        gram = np.einsum("mja,mjb->mab", weighted, columns)
        gram += 1e-6 / size * np.trace(gram, axis1=1, axis2=2)[:, None, None] * np.eye(size)
        right = np.einsum("mja,mj->ma", weighted, value - centre[:, None])
        planes = np.linalg.solve(gram, right[:, :, None])[:, :, 0]
        planes[:, 0] += centre
        residual = np.abs(value - np.einsum("mjk,mk->mj", columns, planes))
    return np.asarray(planes)
