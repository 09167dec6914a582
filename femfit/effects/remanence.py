"""The magnet is stronger or weaker than drawn: another grade, or its tolerance.

In linear iron all fields are linear in remanence and current together, so the co-energy is homogeneous of second degree
in (remanence, i, h): W'(d, i, h; s) = s^2 W'(d, i/s, h/s) for a remanence scaled by s. Where the iron saturates this
holds to first order in the magnet's share of its flux.
"""

from femfit.core.arrays import FloatArray
from femfit.effects.effect import Calibration, Effect, EffectParameter
from femfit.effects.taylor_series import CoenergySeries, TaylorSeries


def remanence_scaled(
    base: CoenergySeries, scale: FloatArray | float, d: FloatArray, i: FloatArray, n_d: int, n_i: int
) -> TaylorSeries:
    """s^2 W'(d, i/s, h/s): the co-energy with the magnet's remanence scaled by s > 0, at n points or everywhere."""
    inverse = 1.0 / scale
    return (scale * scale) * base(d, i * inverse, n_d, n_i).scaled(current=inverse, hall=inverse)


REMANENCE = Effect(
    name="remanence",
    symptom="The magnet's part of every channel is larger or smaller than drawn, everywhere by the same factor.",
    acts_on=("magnetics",),
    parameters=(
        EffectParameter(
            "remanence_error",
            "",
            bounds=(-0.5, 0.3),
            plausible=(-0.15, 0.1),
            description="True over drawn remanence, less one.",
            words="the magnet is {size} {stronger|weaker} than drawn",
        ),
    ),
    needs=("force_N|flux_linkage_Wb|hall_V", "magnet"),
    experiment="Compare the magnet's field on its axis, out of the bench and at a known temperature, with that of its "
    "data sheet.",
    reference="Woodson and Melcher, Electromechanical Dynamics I (1968), section 3.1; IEC 60404-8-1 (grades)",
    coenergy=lambda base, d, i, n_d, n_i, conditions, p: remanence_scaled(
        base, 1.0 + p["remanence_error"], d, i, n_d, n_i
    ),
    calibrations=(
        Calibration(
            {"remanence_error": 0.01},
            40.0,
            "Take the magnet out at 20 °C and read its field on the axis by a gaussmeter.",
            also={"magnet_demagnetisation": {"loss": -1.0}},
        ),
    ),
)
