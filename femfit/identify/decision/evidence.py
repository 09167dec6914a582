"""What a diagnosis rests on: readings, their noise, the gate's patterns, and what each effect would do to them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.effects.effect import Effect
from femfit.identify.comparison.gate import PatternSpace, pattern_space
from femfit.identify.noise.components import estimate_noise
from femfit.identify.noise.whitening import NoiseModel, Whitening, chains_of
from femfit.identify.readings.observations import Observations
from femfit.identify.signatures.columns import EffectColumns, effect_columns, why_untestable


@dataclass(frozen=True, eq=False)
class Evidence:
    """Everything that the decision rests on.

    Parameters
    ----------
    columns : tuple of (EffectColumns, FloatArray)
        Every testable effect at every combination of shape constants, with its whitened columns.
    untestable : mapping of str to str
        Why the others cannot be tested.
    """

    observations: Observations
    whitening: Whitening
    patterns: PatternSpace
    columns: tuple[tuple[EffectColumns, FloatArray], ...]
    untestable: Mapping[str, str]

    @property
    def noise(self) -> NoiseModel:
        """Of the campaign."""
        return self.whitening.noise

    @property
    def known_misfit(self) -> float:
        """Squared length, in whitened units, of the model's own misfit to the sweep that it was fitted to."""
        tolerance, sigma = self.observations.tolerance, self.noise.sigma[self.observations.channel]
        return float(np.sum((tolerance / sigma) ** 2))

    @property
    def rest(self) -> FloatArray:
        """Whitened residual of the model, shape (M,)."""
        return self.whitening.full(self.observations.residual)

    def of(self, observations: Observations) -> "Evidence":
        """The same for other readings at the same settings, with their own noise estimate."""
        noise = estimate_noise(observations)
        if noise is None:
            noise = self.noise
        whitening = Whitening(observations, noise, self.whitening.chains)
        columns = tuple((one, whitening.full(one.columns)) for one, _ in self.columns)
        return Evidence(observations, whitening, pattern_space(observations, whitening), columns, self.untestable)


def gather(observations: Observations, effects: Sequence[Effect]) -> Evidence | None:
    """Estimate the noise and compute every effect's columns.

    Returns
    -------
    Evidence or None
        None where there is no noise floor.
    """
    noise = estimate_noise(observations)
    if noise is None:
        return None
    whitening = Whitening(observations, noise, chains_of(observations))
    untestable, columns = {}, []
    for effect in effects:
        reason = why_untestable(effect, observations)
        found = [] if reason else effect_columns(effect, observations)
        if not found:
            untestable[effect.name] = reason or "it changes no reading at these settings"
        columns += [(one, whitening.full(one.columns)) for one in found]
    return Evidence(observations, whitening, pattern_space(observations, whitening), tuple(columns), untestable)
