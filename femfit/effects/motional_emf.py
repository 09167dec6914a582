"""The motion induces more or less voltage than the model's own k_m v.

The model's force and back-EMF come from one co-energy; what differs in the circuit alone links the winding or its leads
without a force on the body: flux through the leads' loop, a pick-up winding in series.

References
----------
H. H. Woodson and J. R. Melcher, Electromechanical Dynamics, part I (Wiley, 1968), section 2.2.
"""

from femfit.core.arrays import FloatArray
from femfit.effects.conditions import Conditions
from femfit.effects.effect import Effect, EffectParameter, Parameters


def _circuit(
    resistance: FloatArray, voltage: FloatArray, current: FloatArray, conditions: Conditions, p: Parameters
) -> tuple[FloatArray, FloatArray]:
    return resistance, voltage + p["share"] * conditions.motional_V


MOTIONAL_EMF = Effect(
    name="motional_emf",
    symptom="The current departs from the model while the body moves, in step with its velocity.",
    acts_on=("circuit",),
    parameters=(
        EffectParameter(
            name="share",
            unit="",
            lower=-2.0,
            upper=5.0,
            plausible=(-1.0, 1.0),
            description="Further induced voltage over the model's own.",
        ),
    ),
    needs=("time_s", "voltage_V", "current_A", "distance_m|hall_V"),
    experiment="Move the body by hand with the winding open and record distance and voltage.",
    reference="Woodson and Melcher, Electromechanical Dynamics I (1968), section 2.2",
    circuit=_circuit,
)
"""Further voltage = share k_m v."""
