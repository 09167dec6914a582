"""What effects do to the error of readings that they were not fitted to.

Each run is left out in turn and the effects are fitted to the others, without any linearisation.

References
----------
M. Stone, Journal of the Royal Statistical Society B 36 (1974) 111: cross-validation.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from femfit.core.numerics import BoolArray, FloatArray
from femfit.core.results import Finding
from femfit.effects.effect import AddedEffect
from femfit.identify.constants import SETTLED
from femfit.identify.noise.whitening import Whitening
from femfit.identify.observations import Observations
from femfit.identify.refit import Refit, Start, refit
from femfit.identify.words import finding


def unseen_error(whitening: Whitening, fit: Refit) -> dict[str, float]:
    """Rms of recorded minus predicted per channel on runs left out, the effects of a fit fitted to the others."""

    def fitted(keep: BoolArray) -> tuple[AddedEffect, ...]:
        readings = whitening.observations.select(keep)
        return refit(Whitening.granting(readings, whitening.noise), fit.restart).effects

    rms, _ = cross_validated(whitening, fitted)
    return rms


def cross_validated(
    whitening: Whitening, fitted: Callable[[BoolArray], tuple[AddedEffect, ...]]
) -> tuple[dict[str, float], float]:
    """The error on each run, or quarter of a single one, by effects fitted to the readings that stay, of shape (M,).

    The root mean square of recorded minus predicted per channel, and the weighted sum of squares over all noise,
    re-mounts and offsets.
    """
    observations = whitening.observations
    group = observations.column("run").astype(int)
    if len(np.unique(group)) == 1:  # four stretches of a single run
        order: FloatArray = observations.column("order")
        group = np.searchsorted(np.quantile(order, [0.25, 0.5, 0.75]), order)
    as_read, chi2 = np.zeros(len(group)), 0.0
    for number in np.unique(group):
        out = group == number
        unseen = observations.select(out)
        as_read[out] = unseen.value - unseen.predict(fitted(~out))
        white = Whitening(unseen, whitening.noise).full(as_read[out])
        chi2 += float(white @ white)
    return observations.rms(as_read), chi2


def checked_refit(whitening: Whitening, start: Sequence[Start]) -> tuple[Refit, tuple[Finding, ...]]:
    """A refit of what the data show, and what was held: amplitudes that they do not identify, and extrapolated ends."""
    fit = refit(whitening, start)
    for values_of in (_unsettled, _unidentified):
        held = values_of(whitening.observations, fit)
        if any(held):
            restart = zip(fit.restart, held, strict=True)
            fit = refit(whitening, [replace(effect, held={**effect.held, **values}) for effect, values in restart])
    slow = [
        effect.name
        for effect in fit.start
        if any(p.name in effect.held for p in effect.columns.effect.parameters if p.nonlinear)
    ]
    return fit, tuple(finding("not-settled", name=name) for name in slow)


def _unsettled(observations: Observations, fit: Refit) -> list[dict[str, float]]:
    """Of each effect time constants of the circuit that are longer than the runs, held at these.

    The new model runs with the end of such a change. A fit to its beginning says only its rate, and would put an end
    into the circuit that nobody has seen.
    """
    clock = observations.column("time_s" if observations.in_motion else "order")
    longest = float(clock.max()) / SETTLED
    held: list[dict[str, float]] = [{} for _ in fit.effects]
    for k, p in fit.free:
        added = fit.effects[k]
        slow = p.nonlinear and p.name.endswith("_time") and added.parameters[p.name] > longest
        if slow and added.effect.circuit is not None:
            held[k] = {p.name: max(longest, p.lower)}
    return held


def _unidentified(_: Observations, fit: Refit) -> list[dict[str, float]]:
    """Of each effect the amplitudes that the data do not identify, held at their nulls; one stays free at least.

    Their interval holds the null and more than their plausible range.
    """
    held: list[dict[str, float]] = []
    for start, added in zip(fit.start, fit.effects, strict=True):
        free = [p for p in start.columns.amplitudes if p.name not in start.held]
        limits = [(p, *added.ci95.get(p.name, (np.nan, np.nan))) for p in free]
        vague = {p.name: p.null for p, low, high in limits if low < p.null < high and high - low > p.width}
        held.append(vague if len(vague) < len(free) else {})
    return held
