"""Whether a lag is what the drawing predicts, in a sentence.

Where the current i changes slowly, eddy currents are e = -R^-1 C^T L di/dt. The field is that of i + C e, so that it
follows late by C R^-1 C^T L. What ``eddy_current_lag`` finds adds its own shares times their time constants.
"""

from typing import TYPE_CHECKING

import numpy as np

from femfit.core.amount import amount
from femfit.effects.eddy_current_lag import EDDY_CURRENT_LAG, slow_lag

if TYPE_CHECKING:
    from femfit.identify.decision.diagnosis import Diagnosis


def lag_lines(diagnosis: "Diagnosis", *, misses: bool) -> list[str]:
    """The sentence, where the drawing has eddy currents, the data show them, and the model misses nothing else.

    The conductivity of one of several materials changes the lag, too, but the model's states do not say by how much.
    """
    base = diagnosis.model.without_effects
    lags = {EDDY_CURRENT_LAG.name, *(one.key for one in base.drawn if one.conducts)}
    named = {one.name: one.parameters for one in diagnosis.missing if one.name in lags}
    alike = {name for one in diagnosis.missing for name in one.members if one.name not in lags}
    if base.eddy is None or len(base.circuits) != 1 or not (named or lags & diagnosis.detectable.keys()):
        return []
    parts = {one.key for one in base.drawn if one.key.endswith("conductivity_MS_per_m")} - lags
    if (lags | parts) & alike or misses or diagnosis.observations.away_from_bias:
        return []
    at = diagnosis.observations.covariates[["distance_m", "current_A"]].mean()
    d, i = np.asarray(at["distance_m"]), np.asarray(at["current_A"])
    inductance, (forms,) = base.magnetics.inductance(d, i), base.eddy.forms(d)
    drawn = float((forms.coupling[0] ** 2 / base.eddy.resistances_ohm).sum() * inductance)
    here = f"at {amount(float(d), 'm')} and {amount(float(i), 'A')}"
    if not named:
        return [
            f"The lag is what the drawing predicts: the field follows a slow current by {amount(drawn, 's')} {here}."
        ]
    more = sum(slow_lag(p) if name == EDDY_CURRENT_LAG.name else drawn * p["change"] for name, p in named.items())
    off = f"{amount(abs(more), 's')} {'more' if more > 0.0 else 'less'}"
    return [f"The field lags a slow current by {off} than the {amount(drawn, 's')} that the drawing predicts {here}."]
