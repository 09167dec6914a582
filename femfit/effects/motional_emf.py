"""The motion induces more or less voltage than the model's own: further voltage = share k_m v.

The model's force and back-EMF come from one co-energy; what differs in the circuit alone links the winding or its leads
without a force on the body: flux through the leads' loop, a pick-up winding in series.
"""

from femfit.effects.effect import Effect, EffectParameter

MOTIONAL_EMF = Effect(
    name="motional_emf",
    symptom="The current departs from the model while the body moves, in step with its velocity.",
    acts_on=("circuit",),
    parameters=(
        EffectParameter(
            "share",
            bounds=(-2.0, 5.0),
            plausible=(-1.0, 1.0),
            description="Further induced voltage over the model's own.",
            words="the motion induces {size} {more|less} voltage than in the model",
        ),
    ),
    needs=("time_s", "voltage_V", "current_A", "distance_m|hall_V"),
    experiment="Move the body by hand with the winding open and record distance and voltage.",
    reference="Woodson and Melcher, Electromechanical Dynamics I (1968), section 2.2",
    circuit=lambda resistance, voltage, i, conditions, p: (resistance, voltage + p["share"] * conditions.motional_V),
)
