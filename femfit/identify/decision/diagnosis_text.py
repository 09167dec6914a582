"""The facts that a diagnosis prints beside its own: what its verdict grants, a lag, and what could have been shown.

Where the current i changes slowly, eddy currents are e = -R^-1 C^T L di/dt. The field is that of i + C e, so that it
follows late by C R^-1 C^T L. What ``eddy_current_lag`` finds adds its own shares times their time constants. The words
stand in ``diagnosis.j2``.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from femfit.effects.catalogue import device_effects, known_effect
from femfit.effects.lags import EDDY_CURRENT_LAG, slow_lag
from femfit.effects.words import smallest_visible
from femfit.identify.decision.allowances import Allowed, allowed, finer_sweep
from femfit.identify.signatures import CHANGES_NOTHING
from femfit.identify.words import printed, sentence

if TYPE_CHECKING:
    from femfit.identify.decision.diagnosis import Diagnosis


def verdict_sentence(diagnosis: "Diagnosis") -> str:
    """The verdict in one sentence."""
    return sentence("diagnosis", "verdict", diagnosis, _allowed_after(diagnosis))


def certainty_sentence(diagnosis: "Diagnosis") -> str:
    """How far what is named can be trusted against other causes."""
    return sentence("diagnosis", "certainty", diagnosis)


def dimensions_unsuspected(diagnosis: "Diagnosis") -> str:
    """That the drawing's dimensions were not looked at, and what would change that; empty where they were."""
    return sentence("diagnosis", "unsuspected", diagnosis)


def _allowed_after(diagnosis: "Diagnosis") -> Allowed:
    """What is granted of the errors with what is named."""
    rms = {channel.channel: channel.rms_after for channel in diagnosis.error_fall.channels}
    return allowed(diagnosis.observations, diagnosis.campaign.noise if diagnosis.campaign else None, rms)


def diagnosis_text(diagnosis: "Diagnosis") -> str:
    """The result as lines of text, the verdict first."""
    after, nominal = _allowed_after(diagnosis), diagnosis.observations.nominal
    misses = bool(after.apart) or diagnosis.verdict not in {"nothing_missing", "named"}
    effects, named = device_effects(nominal.circuits, nominal.drawn), {effect.name for effect in diagnosis.missing}
    shown = [effect for effect in (*diagnosis.missing, diagnosis.dominant) if effect]
    hidden: dict[str, list[str]] = {}
    for score in diagnosis.ranking:
        if score.note:
            hidden.setdefault(score.note, []).append(score.name)
    return printed(
        "diagnosis",
        d=diagnosis,
        a=after,
        symptoms={effect.name: getattr(known_effect(effect.name), "symptom", "") for effect in shown},
        lagging=None if misses else _lag(diagnosis),
        blind=hidden.get(CHANGES_NOTHING, []),  # it may be missing all the same, since it changes no reading
        finer=finer_sweep(diagnosis.model),
        visible={
            name: smallest_visible(effects[name], amplitudes, nominal)
            for name, amplitudes in diagnosis.detectable.items()
            if name not in named
        },
        hidden=hidden,
    )


@dataclass(frozen=True)
class _Lag:
    """How late the field follows a slow current, as drawn, and by how much more; None where it is as drawn."""

    drawn_s: float
    more_s: float | None
    distance_m: float
    current_A: float


def _lag(diagnosis: "Diagnosis") -> _Lag | None:
    """The lag, where the drawing has eddy currents, the data show them, and nothing else could stand for it.

    The conductivity of one of several materials changes the lag, too, but the model's states do not say by how much.
    """
    base = diagnosis.model.without_effects
    lags = {EDDY_CURRENT_LAG.name, *(number.key for number in base.drawn if number.conducts)}
    named = {effect.name: effect.parameters for effect in diagnosis.missing if effect.name in lags}
    alike = {name for effect in diagnosis.missing for name in effect.members if effect.name not in lags}
    if base.eddy is None or len(base.circuits) != 1 or not (named or lags & diagnosis.detectable.keys()):
        return None
    parts = {number.key for number in base.drawn if number.key.endswith("conductivity_MS_per_m")} - lags
    if (lags | parts) & alike or diagnosis.observations.away_from_bias:
        return None
    setting = diagnosis.observations.covariates[["distance_m", "current_A"]].mean()
    d, i = np.asarray(setting["distance_m"]), np.asarray(setting["current_A"])
    inductance, (forms,) = base.magnetics.inductance(d, i), base.eddy.forms(d)
    drawn = float((forms.coupling[0] ** 2 / base.eddy.resistances_ohm).sum() * inductance)
    more = [slow_lag(p) if name == EDDY_CURRENT_LAG.name else drawn * p["change"] for name, p in named.items()]
    return _Lag(drawn, sum(more) if named else None, float(d), float(i))
