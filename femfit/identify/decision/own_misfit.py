"""A model's own misfit to the table that it was fitted to: what a verdict grants it, and what would make it smaller."""

from collections.abc import Mapping

import numpy as np

from femfit.core.text import rounded
from femfit.fit.misfit import to_be_added
from femfit.identify.decision.constants import OWN_MISFIT
from femfit.identify.noise.scatter import in_words
from femfit.identify.readings.observations import Observations
from femfit.model.actuator_model import ActuatorModel
from femfit.model.magnetics import LawMagnetics
from femfit.model.network_magnetics import NetworkMagnetics
from femfit.tables.measurement import CHANNEL_WORDS

_VERDICT = (
    "{nothing} is missing beyond the model's own misfit to the table that it was fitted to: it misses {both}. {share} "
    "Of its own misfit no more than the size is known, so an error of up to {most} times it, {hidden}, could hide "
    "behind it."
)
_AWAY = (
    "{nothing} is missing beyond what the model may miss by itself, since its eddy currents hold for other currents: "
    "it misses {both}. An error of up to {most} times that, {hidden}, could hide behind it."
)
_FINER = "To see smaller errors, make the model's own misfit smaller. "


def own_misfit_sentence(observations: Observations, times_own: float, apart: Mapping[str, str]) -> str:
    """The verdict where a model misses the readings no more than its own table by an assumed factor.

    Parameters
    ----------
    times_own : float
        Of :class:`~femfit.identify.decision.naming.Decision`.
    apart : mapping of str to str
        Channels whose error is more than noise and own misfit, as :func:`beyond_own_misfit` has them: they are said
        first, and granted nothing.
    """
    both, hidden, away, said = [], [], observations.away_from_bias, observations.amount
    for name in granted_channels(observations, apart):
        here, words = observations.of(name), CHANNEL_WORDS[name]
        read, own = (float(np.sqrt(np.mean(x[here] ** 2))) for x in (observations.residual, observations.own_misfit))
        where = f"may miss {said(own, name)}" if away else f"{said(own, name)} in that table"
        both.append(f"the {words} by {said(read, name)} rms in these readings and {where}")
        hidden.append(f"{said(OWN_MISFIT * own, name)} rms of the {words}")
    missed = [f"No effect is named, but the model misses {' and '.join(apart.values())}."] if apart else []
    if not both:
        return " ".join(missed)
    granted = (_AWAY if away else _VERDICT).format(
        nothing="Apart from that, nothing" if apart else "Nothing",
        both=", ".join(both),
        share=f"Noise taken off, that is {rounded(times_own, 2)} times its own misfit."
        if times_own > 0.0
        else "Noise alone makes as much.",
        most=f"{OWN_MISFIT:g}",
        hidden=" or ".join(hidden),
    )
    return " ".join([*missed, granted])


def also_allowed(observations: Observations, beyond: Mapping[str, str]) -> str:
    """What lets a test pass that leaves channels beyond their noise: the model's own misfit there; empty for none."""
    most = own_misfit(observations)
    sizes = [
        f"{observations.amount(most[name] / OWN_MISFIT, name)} rms of the {CHANNEL_WORDS[name]}"
        for name in beyond
        if most[name]
    ]
    return f"the model's own misfit in any pattern, {' and '.join(sizes)}" if sizes else ""


def granted_channels(observations: Observations, apart: Mapping[str, str]) -> list[str]:
    """Channels whose error is taken for the model's own misfit, where that of those apart is not."""
    return [name for name, most in own_misfit(observations).items() if most > 0.0 and name not in apart]


def beyond_own_misfit(
    observations: Observations, beyond: Mapping[str, float], rms: Mapping[str, float]
) -> dict[str, str]:
    """Channels beyond the noise whose error the model's own misfit does not make either, in words."""
    most = own_misfit(observations)
    return in_words(observations, {name: times for name, times in beyond.items() if rms[name] > most[name]}, rms)


def own_misfit(observations: Observations) -> dict[str, float]:
    """Rms error per channel, in its unit, up to which it is taken for the model's own misfit to its table."""
    return {
        name: OWN_MISFIT * float(np.sqrt(np.mean(observations.own_misfit[observations.of(name)] ** 2)))
        for name in observations.channels
    }


def finer_model(model: ActuatorModel) -> str:
    """What to do about a model's own misfit: settings to add to the sweep, or the co-energy in place of a law."""
    if isinstance(model.without_effects.magnetics, LawMagnetics | NetworkMagnetics):
        return f"{_FINER}Fit the co-energy to the same table (femfit fit without --model) and diagnose with it."
    finer = (model.provenance.get("fit") or {}).get("finer_sweep")
    return _FINER + (to_be_added(finer) if finer else "Sweep at more distances and currents, and fit again.")
