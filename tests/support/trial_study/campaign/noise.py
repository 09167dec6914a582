"""The meters of a campaign."""

from collections.abc import Mapping

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.trial.virtual_bench import Meter


def drawn_meters(truth: Mapping[str, FloatArray], generator: np.random.Generator) -> dict[str, Meter]:
    """Draw a meter for every channel: noise of 0.1 to 0.6 % of the channel's span."""
    result = {}
    for name, values in truth.items():
        share = float(np.exp(generator.uniform(np.log(1e-3), np.log(6e-3))))
        result[name] = Meter(
            sigma=share * float(np.ptp(values)),
            rho=float(generator.uniform(0.0, 0.6)),
            full_scale=1.3 * float(np.abs(values).max()),
        )
    return result
