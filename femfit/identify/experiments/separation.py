"""How far apart two effects, or combinations of effects, are on given settings: one judge for advice and plans.

What effects leave of readings is what their best refit leaves, within their bounds and with their nonlinear parameters
free, in standard deviations of the noise. Readings of one explanation without noise, refitted by the other, give the
distance between the two: the T-criterion of a discriminating design.

References
----------
A. C. Atkinson and V. V. Fedorov, Biometrika 62 (1975) 57: T-optimal designs.
"""

from collections.abc import Sequence
from itertools import product

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.core.ties import ROUNDING
from femfit.effects.effect import AddedEffect, Effect
from femfit.identify.experiments.constants import ALMOST_SURELY, LARGEST_BENDING, NONLINEAR_PRICE, TIE, VARIANTS
from femfit.identify.noise.whitening import Whitening
from femfit.identify.readings.observations import Observations
from femfit.identify.refit.refit import refit
from femfit.identify.refit.start import Start, fitted_together
from femfit.identify.signatures.columns import columns_at, effect_columns


def needed_distance(tie: float = TIE) -> float:
    """Distance from which a diagnosis leaves the wrong one of two explanations out, in 19 of 20 campaigns.

    The weighted sums of squares differ by delta^2 with a standard deviation of 2 delta; they must differ by the tie of
    the decision, and by what the right explanation pays for its further parameters.
    """
    return float(ALMOST_SURELY + np.sqrt(ALMOST_SURELY**2 + tie))


def separation(
    observations: Observations,
    whitening: Whitening,
    change: FloatArray,
    rivals: Sequence[Sequence[Start]],
    tie: float = TIE,
    more_parameters: float = 0.0,
) -> float | None:
    """How far the best refit of rivals stays from what an explanation changes; None where that is less than needed.

    The change has the shape (M,) and the readings' units.
    """
    needed = needed_distance(tie + max(more_parameters, 0.0) * np.log(len(change)))
    apart = _unexplained(observations.with_values(observations.base + change), whitening, rivals, needed)
    return None if apart < needed * (1.0 - ROUNDING) else apart


def parameters_of(effects: Sequence[AddedEffect]) -> float:
    """Number of parameters off their nulls, as the decision counts them."""
    return sum(
        NONLINEAR_PRICE if p.nonlinear else float(added.parameters[p.name] != p.null)
        for added in effects
        for p in added.effect.parameters
    )


def _unexplained(
    observations: Observations, whitening: Whitening, rivals: Sequence[Sequence[Start]], enough: float
) -> float:
    """What effects leave of readings, in standard deviations: the best refit from several starting points.

    None is tried where the first order leaves less than enough already, nor where it leaves so much of the readings'
    change that no nonlinear parameter would make up for it.
    """
    target = whitening.full(observations.residual)
    whole = float(target @ target)
    best, chosen = whole, None
    for starts in rivals:
        begun, fall = fitted_together(target, starts)
        if chosen is None or whole - fall < best:
            best, chosen = whole - fall, begun
    if chosen is not None and np.sqrt(max(best, 0.0)) >= enough and best <= LARGEST_BENDING**2 * whole:
        best = min(refit(observations, whitening, chosen).chi2, max(best, 0.0))
    return float(np.sqrt(max(best, 0.0)))


def starting_points(
    effects: Sequence[Effect],
    observations: Observations,
    whitening: Whitening,
    fitted: Sequence[AddedEffect] = (),
) -> list[list[Start]]:
    """Where refits of effects begin: at trial nonlinear parameters, and where they were fitted before."""
    variants: list[list[Start]] = []
    for k, effect in enumerate(effects):
        found = effect_columns(effect, observations)
        if fitted:
            found = [*columns_at(fitted[k], observations), *found]
        if found:
            variants.append([Start.at_null(one, whitening) for one in found])
    return [list(starts) for starts, _ in zip(product(*variants), range(VARIANTS), strict=False)] if variants else []


def pairs_in_words(pairs: Sequence[tuple[str, ...]]) -> list[str]:
    """Pairs in as few clauses as say them: ``a from b and c``, ``d from e``."""
    left, clauses = list(pairs), []
    while left:
        names = [name for pair in left for name in pair]
        name = max(dict.fromkeys(names), key=names.count)
        clauses.append(f"{name} from {listed([a if b == name else b for a, b in left if name in {a, b}], 'and')}")
        left = [pair for pair in left if name not in pair]
    return clauses


def listed(names: Sequence[str], word: str) -> str:
    """Names as ``a, b and c``."""
    return f" {word} ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)
