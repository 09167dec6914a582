"""How far apart two explanations are by a direct reading of an effect's parameters: a shunt, a weight, a micrometer."""

from collections.abc import Callable, Iterable

import numpy as np
from scipy import stats

from femfit.core.arrays import FloatArray
from femfit.effects.effect import AddedEffect, Calibration
from femfit.identify.experiments.separation import needed_distance
from femfit.identify.refit.refit import Refit

Distance = Callable[[Refit, Refit], float | None]
"""How far apart two explanations are with an experiment; None where that is less than needed."""


def by_direct_reading(effect: str, calibration: Calibration) -> Distance:
    """By a direct reading of an effect's parameters."""

    def distance(a: Refit, b: Refit) -> float | None:
        apart = apart_by_direct_reading(effect, calibration, a, b)
        return apart if apart >= needed_distance() else None

    return distance


def apart_by_direct_reading(effect: str, calibration: Calibration, a: Refit, b: Refit) -> float:
    """What two explanations say of a direct reading, over its uncertainty and theirs."""
    uncertainty = np.array(list(calibration.reads.values()))
    difference = direct_reading(effect, calibration, a.effects) - direct_reading(effect, calibration, b.effects)
    of_a, of_b = (standard_errors(effect, calibration, fit.effects) for fit in (a, b))
    return float(np.linalg.norm(difference / np.sqrt(uncertainty**2 + of_a**2 + of_b**2)))


def direct_reading(effect: str, calibration: Calibration, effects: Iterable[AddedEffect]) -> FloatArray:
    """What a direct reading of an effect's parameters shows where some effects act, in the parameters' units."""
    values = np.zeros(len(calibration.reads))
    for added in effects:
        if added.effect.name == effect:
            values += [added.parameters[name] for name in calibration.reads]
        for name, change in calibration.also.get(added.effect.name, {}).items():
            values[0] += change * added.parameters[name]
    return values


def standard_errors(effect: str, calibration: Calibration, effects: Iterable[AddedEffect]) -> FloatArray:
    """How well the fit of some effects knows the parameters that a direct reading reads; 0 where none has them."""
    for added in effects:
        if added.effect.name == effect:
            limits = [added.ci95.get(name, (0.0, 0.0)) for name in calibration.reads]
            return np.asarray(np.ptp(limits, axis=1) / (2.0 * stats.norm.isf(0.025)))
    return np.zeros(len(calibration.reads))
