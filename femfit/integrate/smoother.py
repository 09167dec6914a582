"""Offline: what the filter would have said had it known the rest of the record.

H. E. Rauch, F. Tung and C. T. Striebel, AIAA J. 3 (1965) 1445. The backward recursion goes from correction
to correction, and the coil's integral carries the samples between.
"""

from dataclasses import replace

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.integrate.increments import increments
from femfit.integrate.offset_filter import Correction, OffsetFilter
from femfit.integrate.uncertainty import FieldBlock, Responses
from femfit.tables.coil_block import CoilBlock


def smooth(integrator: OffsetFilter, record: CoilBlock) -> FieldBlock:
    """Filter a whole record and smooth it; innovations stay the filter's."""
    trace: list[Correction] = []
    start = integrator.start()
    _, out = integrator.advance(start, record, trace)
    if not trace:
        return out
    area = integrator.coil.area_m2
    means, variances = _smoothed_corrections(trace, area)
    _, steps = increments(start.last, record, integrator.coil, integrator.noise, integrator.sample_time)
    time = record.time
    # What moves the columns of the mean between corrections: the coil, nothing, nothing, and a volt of offset.
    moved = np.zeros((len(time), 4))
    moved[:, 0], moved[:, 3] = np.cumsum(steps.field), (time - time[0]) / area
    values, offset, variance = np.full((len(time), 4), np.nan), out.offset.copy(), out.variance.copy()
    for place in range(len(trace) - 1):
        begin, end = trace[place].row, trace[place + 1].row
        rows = slice(begin, end + 1)
        since = (time[rows] - time[begin])[:, None]
        path = means[place, 0] + moved[rows] - moved[begin] - means[place, 1] * since / area
        # What the walk of the offset moved is spread over the interval, so that the path meets the next correction.
        share = since / since[-1]
        values[rows] = path + (means[place + 1, 0] - path[-1]) * share
        offset[rows] = means[place, 1, 0] + (means[place + 1, 1, 0] - means[place, 1, 0]) * share[:, 0]
        variance[rows] = variances[place] + (variances[place + 1] - variances[place]) * share[:, 0]
    known = int(np.flatnonzero(np.isfinite(out.field))[0])
    for part, row, mean in (
        (slice(known, trace[0].row + 1), trace[0].row, means[0]),
        (slice(trace[-1].row, None), trace[-1].row, means[-1]),
    ):
        values[part] = mean[0] + moved[part] - moved[row] - mean[1] * (time[part] - time[row])[:, None] / area
    offset[known : trace[0].row], variance[known : trace[0].row] = means[0, 1, 0], variances[0]
    field, reference, unit, voltage = np.ascontiguousarray(values.T)
    responses = Responses(field - reference, reference, unit, voltage)
    return replace(out, field=field, variance=variance, offset=offset, responses=responses)


def _smoothed_corrections(trace: list[Correction], area: float) -> tuple[FloatArray, FloatArray]:
    """Smoothed field and offset with their responses (n, 2, 4), and the field's variance (n,), at the corrections."""
    means, variances = np.empty((len(trace), 2, 4)), np.empty(len(trace))
    mean, covariance = trace[-1].mean, trace[-1].covariance
    means[-1], variances[-1] = mean, covariance[0, 0]
    for place in range(len(trace) - 2, -1, -1):
        here, after = trace[place], trace[place + 1]
        F = np.array([[1.0, -after.elapsed / area], [0.0, 1.0]])
        gain = np.linalg.solve(after.predicted_covariance, F @ here.covariance).T
        mean = here.mean + gain @ (mean - after.predicted)
        smoothed = here.covariance + gain @ (covariance - after.predicted_covariance) @ gain.T
        # Across a gap of days rounding may eat all of it; the filter's own covariance is on the safe side.
        covariance = smoothed if smoothed[0, 0] > 0.0 else here.covariance
        means[place], variances[place] = mean, covariance[0, 0]
    return means, variances
