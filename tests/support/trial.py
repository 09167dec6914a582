"""Points of a bench for the trial's truths."""

import numpy as np

from support.trial_study.truth.bench import Points

FAMILIES = ("core", "memory", "magnets", "layer", "ring")
"""Field solutions that the tests of the trial use."""


def points_at(distance, current, coil_C=20.0, magnet_C=20.0, element_C=20.0):
    n = len(distance)
    flat = np.ones(n)
    return Points(
        distance=np.asarray(distance, dtype=float),
        current=current * flat,
        run=np.zeros(n, dtype=int),
        order=np.arange(n),
        time_s=10.0 * np.arange(n),
        branch=flat,
        coil_C=coil_C * flat,
        magnet_C=magnet_C * flat,
        element_C=element_C * flat,
    )
