"""Offline: what a Kalman filter would have said had it known the rest of the record (Rauch, Tung and Striebel).

For one state the backward recursion is affine and runs in lanes; for two states it goes from correction to correction,
and the coil's integral carries the samples between.

References
----------
H. E. Rauch, F. Tung and C. T. Striebel, AIAA J. 3 (1965) 1445.
"""

from dataclasses import replace

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.core.coil_block import CoilBlock
from femfit.estimate.integrate.field_block import FieldBlock
from femfit.estimate.integrate.increments import increments
from femfit.estimate.integrate.kalman import KalmanIntegrator
from femfit.estimate.integrate.lanes import Lanes, affine_lanes
from femfit.estimate.integrate.offset_filter import Correction, OffsetFilter


def smooth(integrator: KalmanIntegrator | OffsetFilter, record: CoilBlock) -> FieldBlock:
    """Filter a whole record and smooth it.

    Parameters
    ----------
    integrator : KalmanIntegrator or OffsetFilter
        CS1, CS2, or one with the offset state.
    record : CoilBlock
        All of it, in memory.

    Returns
    -------
    FieldBlock
        Smoothed field and variance, and of the offset state the smoothed offset. Innovations are the filter's;
        responses to systematics are left out.
    """
    if isinstance(integrator, KalmanIntegrator):
        return _smooth_one_state(integrator, record)
    return _smooth_two_states(integrator, record)


def _smooth_one_state(integrator: KalmanIntegrator, record: CoilBlock) -> FieldBlock:
    """x_s,k = x_k + C_k (x_s,k+1 - x_k+1^-), C_k = P_k / P_k+1^-, backwards."""
    start = integrator.start()
    _, out = integrator.advance(start, record)
    _, steps = increments(start.last, record, integrator.coil, integrator.noise, integrator.sample_time)
    x, P = out.field, out.variance
    predicted_variance = P[:-1] + steps.variance[1:]
    gain = P[:-1] / predicted_variance
    back = slice(None, None, -1)
    field = _backwards(gain[back], (x[:-1] - gain * (x[:-1] + steps.field[1:]))[back], float(x[-1]))
    variance = _backwards((gain**2)[back], (P[:-1] - gain**2 * predicted_variance)[back], float(P[-1]))
    return replace(out, field=field, variance=variance, responses=None)


def _backwards(a: FloatArray, b: FloatArray, last: float) -> FloatArray:
    """y_k = a_k y_(k-1) + b_k from the record's end on, in the record's order."""
    if len(a) == 0:
        return np.array([last])
    lanes = Lanes(len(a))
    values = lanes.unfold(affine_lanes(lanes.fold(a, 1.0), [lanes.fold(b, 0.0)], [last])[0])
    return np.concatenate([values[::-1], [last]])


def _smooth_two_states(integrator: OffsetFilter, record: CoilBlock) -> FieldBlock:
    trace: list[Correction] = []
    start = integrator.start()
    _, out = integrator.advance(start, record, trace)
    if not trace:
        return replace(out, responses=None)
    means, variances = _smoothed_corrections(trace, integrator.coil.area_m2)
    _, steps = increments(start.last, record, integrator.coil, integrator.noise, integrator.sample_time)
    field, offset, variance = out.field.copy(), out.offset.copy(), out.variance.copy()
    time, integral = record.time, np.cumsum(steps.field)
    for place in range(len(trace) - 1):
        begin, end = trace[place].row, trace[place + 1].row
        rows = slice(begin, end + 1)
        since = time[rows] - time[begin]
        path = means[place, 0] + integral[rows] - integral[begin] - means[place, 1] * since / integrator.coil.area_m2
        # What the walk of the offset moved is spread over the interval, so that the path meets the next correction.
        share = since / since[-1]
        field[rows] = path + (means[place + 1, 0] - path[-1]) * share
        offset[rows] = means[place, 1] + (means[place + 1, 1] - means[place, 1]) * share
        variance[rows] = variances[place] + (variances[place + 1] - variances[place]) * share
    first = slice(int(np.flatnonzero(np.isfinite(field))[0]), trace[0].row)
    late = time[first] - time[trace[0].row]
    field[first] = means[0, 0] + integral[first] - integral[trace[0].row] - means[0, 1] * late / integrator.coil.area_m2
    offset[first], variance[first] = means[0, 1], variances[0]
    return replace(out, field=field, variance=variance, offset=offset, responses=None)


def _smoothed_corrections(trace: list[Correction], area: float) -> tuple[FloatArray, FloatArray]:
    """Smoothed field and offset (n, 2) and the field's variance (n,) at the corrections."""
    means, variances = np.empty((len(trace), 2)), np.empty(len(trace))
    mean, covariance = trace[-1].mean, trace[-1].covariance
    means[-1], variances[-1] = mean, covariance[0, 0]
    for place in range(len(trace) - 2, -1, -1):
        here, after = trace[place], trace[place + 1]
        F = np.array([[1.0, -after.elapsed / area], [0.0, 1.0]])
        gain = np.linalg.solve(after.predicted_covariance, F @ here.covariance).T
        mean = here.mean + gain @ (mean - after.predicted)
        covariance = here.covariance + gain @ (covariance - after.predicted_covariance) @ gain.T
        means[place], variances[place] = mean, covariance[0, 0]
    return means, variances
