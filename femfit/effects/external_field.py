"""A uniform field from elsewhere: the earth's, a motor's, a magnetised table's.

It adds to the field at the Hall element, and magnetises a soft core as a current would, which changes force and flux
linkage as well: W'(d, i, h) -> W'(d, i + i_e, h) + h B_e, with i_e = share B_e / (field at the element per ampere).
"""

from femfit.core.arrays import FloatArray
from femfit.effects.conditions import Conditions
from femfit.effects.effect import Calibration, Effect, EffectParameter, Parameters
from femfit.effects.taylor_series import CoenergySeries, TaylorSeries


def _coenergy(
    base: CoenergySeries, d: FloatArray, i: FloatArray, n_d: int, n_i: int, conditions: Conditions, p: Parameters
) -> TaylorSeries:
    equivalent = p["core_share"] * p["field_T"] / conditions.nominal.hall_T_per_A
    coefficients = base(d, i + equivalent, n_d, n_i).coefficients.copy()
    coefficients[1, 0, 0] += p["field_T"]
    return TaylorSeries(coefficients)


EXTERNAL_FIELD = Effect(
    name="external_field",
    symptom="The Hall voltage is wrong by a constant, and force and flux linkage as if a small current were added.",
    acts_on=("magnetics",),
    parameters=(
        EffectParameter(
            "field_T",
            unit="T",
            bounds=(-0.05, 0.05),
            plausible=(-2e-3, 2e-3),
            description="Uniform field along the axis.",
            words="a field of {signed} from elsewhere acts along the axis",
        ),
        EffectParameter(
            "core_share",
            bounds=(0.05, 2.0),
            plausible=(0.05, 0.6),
            description="Field at the Hall element that the core adds to it, over the field itself.",
            null=0.25,
            nonlinear=True,
        ),
    ),
    needs=("hall_V", "force_N|flux_linkage_Wb"),
    experiment="Turn the whole bench by 180 degrees about a horizontal axis, the current off, and read the Hall "
    "voltage in both positions.",
    reference="Bozorth, Ferromagnetism (1993), chapter 19 (a body in a uniform field)",
    coenergy=_coenergy,
    calibrations=(
        Calibration(
            {"field_T": 2e-5},
            15.0,
            "Switch the current off, take the moving part away and turn the bench by 180 degrees: half the "
            "change of the Hall voltage is the outer field's.",
        ),
    ),
)
