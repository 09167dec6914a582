"""Where the refit of several effects starts."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from femfit.core.errors import TableError
from femfit.effects.effect import AddedEffect, Effect, EffectParameter
from femfit.identify.noise.whitening import Whitening
from femfit.identify.readings.observations import Observations
from femfit.identify.refit.refit import Refit, Start, bounded_amplitudes, continued
from femfit.identify.signatures.columns import effect_columns


def starting_point(
    observations: Observations, whitening: Whitening, effects: Sequence[Effect], at_null: bool = False
) -> list[Start]:
    """Amplitudes of effects to first order, bounded, with the shape constants that fit best.

    Parameters
    ----------
    effects : sequence of Effect
        In order; the shape constants of each are chosen with those before it.
    at_null : bool
        Whether all amplitudes are null instead.

    Returns
    -------
    list of (EffectColumns, array of shape (k,))
        One an effect.

    Raises
    ------
    TableError
        If an effect changes no reading.
    """
    target = whitening.full(observations.residual)
    chosen: list[Start] = []
    columns = np.zeros((len(target), 0))
    bounds = np.zeros((2, 0))
    for effect in effects:
        variants = effect_columns(effect, observations)
        if not variants:
            raise TableError(
                f"Effect {effect.name} changes no reading at these settings, so it cannot be fitted to them. "
                f"{effect.experiment}"
            )
        tries = []
        for one in variants:
            both = np.concatenate([columns, whitening.full(one.columns)], axis=1)
            limits = np.concatenate([bounds, one.bounds], axis=1)
            amplitude, fall = bounded_amplitudes(target, both, limits)
            tries.append((fall, one, both, limits, amplitude))
        _, one, columns, bounds, amplitude = max(tries, key=lambda item: item[0])
        chosen.append((one, np.zeros(len(one.amplitudes))))
    if at_null or not chosen:
        return chosen
    ends = np.cumsum([len(one.amplitudes) for one, _ in chosen])[:-1]
    return [(one, part) for (one, _), part in zip(chosen, np.split(amplitude, ends), strict=True)]


def restart(fit: Refit) -> list[Start]:
    """A fit as the start of another.

    Returns
    -------
    list of (EffectColumns, array of shape (k,))
        One an effect, at the fitted values.
    """
    return [continued(one, added) for one, added in zip(fit.start, fit.effects, strict=True)]


def without_untold(fit: Refit) -> list[Start]:
    """A fit as the start of another, without the amplitudes that the data do not tell.

    Their interval holds the null and more than their usual range: a warming that takes hours is no part of a record of
    seconds, but the new model would run with all of it.

    Returns
    -------
    list of (EffectColumns, array of shape (k,))
        One an effect, each with one amplitude at least.
    """
    result = []
    for (one, amplitude), added in zip(restart(fit), fit.effects, strict=True):
        keep = np.array([not _untold(added, p) for p in one.amplitudes])
        if not keep.any() or keep.all():
            result.append((one, amplitude))
            continue
        told = tuple(p for p, kept in zip(one.amplitudes, keep, strict=True) if kept)
        fewer = replace(one, amplitudes=told, columns=one.columns[:, keep])
        result.append((fewer, amplitude[keep]))
    return result


def _untold(added: AddedEffect, parameter: EffectParameter) -> bool:
    low, high = added.ci95.get(parameter.name, (np.nan, np.nan))
    return low < parameter.null < high and high - low > parameter.plausible[1] - parameter.plausible[0]
