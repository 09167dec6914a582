"""How far a name can be trusted: whether a cause that nobody has listed would bear it too.

Whether a campaign distinguishes an effect from one outside of the catalogue cannot be tested with the catalogue's own
effects as rivals. They serve as examples of what physics does to these readings: had one of them been the cause, as
large as what was found, and not been listed, would an unknown cause have been preferred to the name? What adds the same
to every reading of a channel has more causes than any list holds, so that a constant error of each channel is always
among the examples.

A number of the drawing is known to first order alone. Beside a refit of a large effect, which follows its curvature, it
would look different for that reason only; so it is compared with the first order of what is named as well.
"""

from collections.abc import Sequence

import numpy as np

from femfit.core.numerics import ROUNDING, FloatArray, ranked
from femfit.identify.decision.constants import NOTICED, UNKNOWN_SIZES
from femfit.identify.decision.effect_space import EffectSpace, half_ranges
from femfit.identify.decision.evidence import Linear, density_of
from femfit.identify.decision.naming import Decision
from femfit.identify.decision.search import Explanation
from femfit.identify.refit.refit import Refit, Start
from femfit.identify.signatures import columns_at
from femfit.tables.measurement import CHANNEL_WORDS


def look_alikes(decision: Decision) -> tuple[str, ...]:
    """Effects that would have been given the chosen names on these data, had they been the cause and not been listed.

    First the others of the classes, then those of further explanations that the data leave, then examples, the most
    alike first.
    """
    chosen = decision.chosen
    if chosen is None or chosen.fit is None:
        return ()
    others = [name for members in decision.classes for name in members[1:]]
    others += [n for one in decision.left if not set(chosen.names) <= set(one.names) for n in one.names]
    examples = ranked(list(noticed(decision, chosen).items()), lambda pair: -pair[1], ROUNDING)
    others += [name for name, odds in examples if odds < NOTICED]
    return tuple(name for name in dict.fromkeys(others) if name not in chosen.names)


def noticed(decision: Decision, chosen: Explanation) -> dict[str, float]:
    """Per example, the log odds of an unknown cause beside the chosen names had it been the cause of one of them."""
    space, linear, fit = decision.posterior.space, chosen.linear, chosen.fit
    if linear is None or fit is None:
        return {}
    campaign, observations = space.campaign, space.campaign.observations
    whole = observations.predict(fit.effects)
    lengths = []
    for added in fit.effects:
        change = whole - observations.predict([one for one in fit.effects if one is not added])
        lengths.append(float(np.linalg.norm(campaign.whitening.full(change))))
    names, examples, longest = list[str](), list[FloatArray](), list[float]()
    for one, block in zip(campaign.effects, space.blocks, strict=True):
        if one.name not in chosen.names:
            for column in block[:, : one.count].T:
                names.append(one.name)
                examples.append(column)
                longest.append(2.0 * float(np.linalg.norm(column)))  # the whole of its plausible range
    for name in observations.channels:
        names.append(f"a constant error of the {CHANNEL_WORDS.get(name, name)}")
        examples.append(campaign.whitening.full(observations.of(name).astype(np.float64)))
        longest.append(np.inf)
    compared = [(linear, names, examples, longest)]
    numbers = _drawn_numbers(space, chosen.names)
    if numbers[0]:
        compared.append((_to_first_order(space, fit), *numbers))
    result: dict[str, float] = {}
    for beside, names, examples, longest in compared:
        columns = np.stack(examples, axis=1)
        columns /= np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
        for length in lengths:
            for name, odds, most in zip(names, _odds(decision, beside, columns, length), longest, strict=True):
                if most >= length:
                    result[name] = min(result.get(name, np.inf), float(odds))
    return result


def _drawn_numbers(space: EffectSpace, named: Sequence[str]) -> tuple[list[str], list[FloatArray], list[float]]:
    """Of numbers of the drawing: names, whitened changes per unit, and their lengths over the plausible range."""
    drawn = {effect.name for effect in space.campaign.observations.nominal.drawn} - set(named)
    suspects = [one for one in space.campaign.effects if one.name in drawn]
    changes = [one.whitened[:, 0] for one in suspects]
    longest = [
        2.0 * half_ranges(one)[0] * float(np.linalg.norm(change)) for one, change in zip(suspects, changes, strict=True)
    ]
    return [one.name for one in suspects], changes, longest


def _to_first_order(space: EffectSpace, fit: Refit) -> Linear:
    """What is named, as large as it usually may be, without its curvature."""
    campaign, observations = space.campaign, space.campaign.observations
    columns = []
    for added in fit.effects:
        for one in columns_at(added, observations):
            acting = one if added.runs is None else one.in_runs(added.runs, observations.column("run").astype(int))
            start = Start.at_null(acting, campaign.whitening)
            columns.append(start.whitened * half_ranges(start))
    return Linear(np.zeros(len(observations.value)), np.concatenate(columns, axis=1), density_of(campaign), 0.0)


def _odds(decision: Decision, linear: Linear, columns: FloatArray, length: float) -> FloatArray:
    """Log odds of an unknown cause for readings that are noise of its usual length and a column of a given length."""
    space = decision.posterior.space
    of_columns, of_unknown = linear.beside(columns), linear.beside(space.unknown)
    gram = space.unknown_gram - of_unknown.T @ of_unknown
    along = space.unknown.T @ columns - of_unknown.T @ of_columns
    square = len(columns) + length**2 * np.maximum(1.0 - np.sum(of_columns**2, axis=0), 0.0)
    logs = []
    for group, weight in space.unknown_groups:
        values, vectors = np.linalg.eigh(weight[:, None] * gram[np.ix_(group, group)] * weight)
        parts = (vectors.T @ (weight[:, None] * along[group])) ** 2
        for size in UNKNOWN_SIZES:
            grown = size**2 * np.maximum(values, 0.0)
            fall = length**2 * np.sum((size**2 / (1.0 + grown))[:, None] * parts, axis=0)
            logs.append(linear.density(square - fall, float(np.sum(np.log1p(grown)))))
    together = np.logaddexp.reduce(np.array(logs), axis=0) - np.log(len(logs))
    return np.asarray(together - linear.density(square, 0.0))
