"""The magnet is weaker when warm: W'(d, i, h; s) = s^2 W'(d, i/s, h/s) for a remanence scaled by s.

In linear iron all fields are linear in remanence and current together, so the co-energy is homogeneous of second degree
in (remanence, i, h); where the iron saturates this holds to first order in the magnet's share of its flux.

References
----------
IEC 60404-8-1 (temperature coefficient of the remanent flux density).
H. H. Woodson and J. R. Melcher, Electromechanical Dynamics, part I (Wiley, 1968), section 3.1.
"""

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.effects.conditions import REFERENCE_TEMPERATURE_C, Conditions, like
from femfit.effects.effect import Calibration, Effect, EffectParameter, Parameters
from femfit.effects.taylor_series import CoenergySeries, TaylorSeries

USUAL_COEFFICIENT = -1.1e-3
"""Relative change of NdFeB's remanence per kelvin, by which an unrecorded warming is counted (IEC 60404-8-1)."""


def remanence_scaled(
    base: CoenergySeries, scale: FloatArray | float, d: FloatArray, i: FloatArray, n_d: int, n_i: int
) -> TaylorSeries:
    """The co-energy with the magnet's remanence scaled.

    Parameters
    ----------
    scale : array, shape (n,), or float
        s > 0.
    d, i : array, shape (n,)
        Points.

    Returns
    -------
    TaylorSeries
        s^2 W'(d, i/s, h/s).
    """
    inverse = 1.0 / scale
    return (scale * scale) * base(d, i * inverse, n_d, n_i).scaled(current=inverse, hall=inverse)


def _coenergy(
    base: CoenergySeries, d: FloatArray, i: FloatArray, n_d: int, n_i: int, conditions: Conditions, p: Parameters
) -> TaylorSeries:
    recorded = like(conditions.magnet_temperature_C, d) - REFERENCE_TEMPERATURE_C
    coil = np.nan_to_num(like(conditions.coil_temperature_C, d) - REFERENCE_TEMPERATURE_C)
    unrecorded = USUAL_COEFFICIENT * (p["warmer_K"] + p["coil_share"] * coil)
    hidden = np.isnan(recorded) | conditions.running
    recorded = np.nan_to_num(recorded)
    known = p["coefficient_per_K"] * recorded + p["curvature_per_K2"] * recorded**2
    scale = 1.0 + known + np.where(hidden, unrecorded, 0.0)
    return remanence_scaled(base, np.maximum(scale, 0.05), d, i, n_d, n_i)


MAGNET_TEMPERATURE = Effect(
    name="magnet_temperature",
    symptom="Force, flux linkage and Hall voltage shrink together in the magnet's share as it gets warm.",
    acts_on=("magnetics",),
    parameters=(
        EffectParameter(
            name="coefficient_per_K",
            unit="1/K",
            lower=-0.01,
            upper=0.005,
            plausible=(-3e-3, 0.0),
            description="Relative change of the remanence per kelvin of the recorded temperature over 20 degC.",
        ),
        EffectParameter(
            name="curvature_per_K2",
            unit="1/K^2",
            lower=-1e-4,
            upper=1e-4,
            plausible=(-1e-5, 1e-5),
            description="The same per kelvin squared.",
        ),
        EffectParameter(
            name="warmer_K",
            unit="K",
            lower=-60.0,
            upper=150.0,
            plausible=(-10.0, 60.0),
            description="Where its temperature was not recorded: the magnet's over 20 degC, by -0.11 % a kelvin.",
        ),
        EffectParameter(
            name="coil_share",
            unit="",
            lower=0.0,
            upper=2.0,
            plausible=(0.0, 1.0),
            description="Where its temperature was not recorded: the part of the coil's warming that it follows.",
        ),
    ),
    needs=("force_N|flux_linkage_Wb|hall_V", "magnet"),
    experiment="Measure the same settings with the magnet cold and after warming it by 20 K, its temperature recorded.",
    reference="IEC 60404-8-1; Woodson and Melcher, Electromechanical Dynamics I (1968), section 3.1",
    coenergy=_coenergy,
    calibrations=(
        Calibration(
            {"warmer_K": 2.0, "coil_share": 0.1},
            15.0,
            "Put thermometers on magnet and winding, and read them while the bench runs.",
        ),
    ),
)
"""Remanence = (1 + coefficient (T - 20 degC) + curvature (T - 20 degC)^2) of the model's."""
