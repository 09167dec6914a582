"""What is missing beside a calibrated drawing: the diagnosis with the numbers free."""

from dataclasses import replace

import numpy as np

from femfit.core.finding import Finding
from femfit.identify.calibration.redraw import Estimate, Redrawn
from femfit.identify.comparison.lack_of_fit import pattern_space
from femfit.identify.decision.campaign import considered_effects, gather
from femfit.identify.decision.naming import Decision, decide
from femfit.identify.readings.place import placed
from femfit.identify.refit.start import Start
from femfit.identify.signatures.columns import columns_at
from femfit.model.with_effects import with_effects
from femfit.tables.measurement import Measurement


def decide_beside(redrawn: Redrawn, estimate: Estimate, measured: Measurement) -> Decision | None:
    """The decision about what the calibrated drawing leaves; None where it cannot be tested.

    Had a cause been overlooked, the numbers would have been fitted to it as well, and what they leave of it would look
    like another. So what was fitted is free in this decision: its columns scatter as the noise does, each number by its
    tolerance and each effect by its plausible range.
    """
    observations = placed(with_effects(redrawn.model, estimate.alone), measured)
    nominal, fitted = observations.nominal, estimate.fit.effects
    campaign = gather(
        observations, considered_effects([one.effect.name for one in fitted], nominal.circuits, nominal.drawn)
    )
    if isinstance(campaign, Finding):
        return None
    free = [
        columns.columns * [estimate.prior.sd.get(one.effect.name, p.width) for p in columns.amplitudes]
        for one in fitted
        for columns in columns_at(one, redrawn.whitening.observations)
    ]
    known = campaign.whitening.misfit
    misfit = np.concatenate([*([] if known is None else [known]), *free], axis=1)
    whitening = replace(campaign.whitening, misfit=misfit)
    starts = tuple(Start.at_null(one.columns, whitening) for one in campaign.effects)
    return decide(
        replace(campaign, whitening=whitening, patterns=pattern_space(observations, whitening), effects=starts)
    )
