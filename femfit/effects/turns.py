"""The winding has more or fewer turns than drawn.

With t times the turns a current makes t times the ampere-turns and links t times the flux: W'(d, i) -> W'(d, t i), the
field of the test current in the Hall element's place unchanged; a wire that is t times as long has t times the
resistance. Ammeter and turns differ in the flux linkage alone, by which a fluxmeter tells them apart.
"""

from femfit.core.arrays import FloatArray
from femfit.effects.conditions import Conditions
from femfit.effects.effect import Calibration, Effect, EffectParameter, Parameters
from femfit.effects.taylor_series import CoenergySeries, TaylorSeries


def _coenergy(
    base: CoenergySeries, d: FloatArray, i: FloatArray, n_d: int, n_i: int, conditions: Conditions, p: Parameters
) -> TaylorSeries:
    t = 1.0 + p["turns_error"]
    return base(d, t * i, n_d, n_i).scaled(current=t)


TURNS = Effect(
    name="turns",
    symptom="The current's part of every channel is larger or smaller than drawn, everywhere by the same factor.",
    acts_on=("magnetics", "circuit"),
    parameters=(
        EffectParameter(
            "turns_error",
            "",
            bounds=(-0.5, 1.0),
            plausible=(-0.1, 0.1),
            description="True over drawn number of turns, less one.",
            words="the winding has {size} {more|fewer} turns than drawn",
        ),
    ),
    needs=("~current_A", "force_N|flux_linkage_Wb|hall_V|voltage_V"),
    experiment="Count the turns by the voltage that a coil of known turns around the same core induces in the winding.",
    reference="Woodson and Melcher, Electromechanical Dynamics I (1968), section 3.1",
    coenergy=_coenergy,
    circuit=lambda resistance, voltage, i, conditions, p: (resistance * (1.0 + p["turns_error"]), voltage),
    calibrations=(
        Calibration(
            {"turns_error": 2e-3},
            40.0,
            "Lay ten turns around the same core, feed the winding with an alternating voltage and read the voltage of "
            "the ten turns: their ratio is that of the turns.",
        ),
    ),
)
