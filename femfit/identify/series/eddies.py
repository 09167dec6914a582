r"""Eddy currents of the drawing along a recorded motion.

At given distances and currents the patterns' flux linkages beside a current of their own are b = C^T phi + lambda, and
with A = C^T L C + Q

    d(b + A e)/dt = -R e.

Between two times b is taken as linear and A as constant, so that a step is exact however fast a pattern decays. A
stretch begins at rest.
"""

import numpy as np

from femfit.core.arrays import BoolArray, FloatArray
from femfit.identify.series.constants import SLOWEST
from femfit.model.eddy_currents import EddyCurrents


def eddies_along(
    eddy: EddyCurrents,
    time: FloatArray,
    first: BoolArray,
    distance: FloatArray,
    flux_linkage: FloatArray,
    inductance: FloatArray,
) -> FloatArray:
    """Currents (N, r) of the patterns at N times, where stretches begin ``first``.

    Parameters
    ----------
    flux_linkage, inductance : array, shapes (N, n) and (N, n, n)
        Of the circuits, without eddy currents.
    """
    (at,), root = eddy.forms(distance), 1.0 / np.sqrt(eddy.resistances_ohm)
    turned = np.swapaxes(at.coupling, -1, -2)
    beside = root * ((turned @ flux_linkage[..., None])[..., 0] + at.flux_linkage)
    own = root[:, None] * (turned @ inductance @ at.coupling + at.inductance) * root
    kept, gained = _steps(np.diff(time), 0.5 * (own[1:] + own[:-1]), -np.diff(beside, axis=0))
    linked = np.zeros_like(beside)
    for k in np.flatnonzero(~first[1:]):
        linked[k + 1] = kept[k] @ linked[k] + gained[k]
    return np.asarray(root * np.linalg.solve(own, linked[..., None])[..., 0])


def pull_of(eddy: EddyCurrents, distance: FloatArray, flux_linkage: FloatArray, induced: FloatArray) -> FloatArray:
    """What induced currents (N, r) add to the force beside the static one, at the currents that act together."""
    (rising,) = eddy.forms(distance, 1)
    acting = (rising.coupling @ induced[..., None])[..., 0]
    own = rising.flux_linkage + 0.5 * (rising.inductance @ induced[..., None])[..., 0]
    return -np.asarray((flux_linkage * acting).sum(axis=-1) + (own * induced).sum(axis=-1))


def _steps(step: FloatArray, own: FloatArray, gained: FloatArray) -> tuple[FloatArray, FloatArray]:
    """What is left of A e after each step in s, and of a flux linkage that grows evenly within it."""
    delay, modes = np.linalg.eigh(own)
    decay = np.maximum(np.maximum(step, 0.0)[:, None] / delay, SLOWEST)
    turned = np.swapaxes(modes, -1, -2)
    mean = -np.expm1(-decay) / decay
    kept = (modes * np.exp(-decay)[:, None]) @ turned
    return kept, (modes @ (mean[..., None] * (turned @ gained[..., None])))[..., 0]
