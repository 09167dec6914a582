"""Magnetics, sensors' fields and validity domains of one circuit, with currents that have no axis."""

from dataclasses import replace

import numpy as np

from femfit.model.magnetics import MagneticState

AXES = {"flux_linkage": 1, "motional_constant": 1, "inductance": 2}


class Flat:
    """What a magnetics or a field of one current gives, squeezed."""

    def __init__(self, inner):
        self.inner = inner

    def __getattr__(self, name):
        def called(distance, current):
            value = getattr(self.inner, name)(np.asarray(distance), np.asarray(current)[..., None])
            if isinstance(value, MagneticState):
                return MagneticState(value.force, value.motional_constant[..., 0], value.inductance[..., 0, 0])
            if isinstance(value, tuple):
                return *value[:-1], value[-1][..., 0]
            return value[(..., *[0] * AXES.get(name, 0))]

        return called


def flat(inner):
    """The squeezed one; of several circuits itself."""
    return inner if len(getattr(inner, "names", getattr(inner, "currents", ()))) > 1 else Flat(inner)


def within(box, low=None, high=None, **changes):
    """A domain with other ends of the first circuit's current."""
    limits = box.current_limits_A.copy()
    limits[0] = limits[0, 0] if low is None else low, limits[0, 1] if high is None else high
    return replace(box, current_limits_A=limits, **changes)
