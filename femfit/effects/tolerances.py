"""What a field solution leaves open of a drawing: the magnet's strength, the winding's turns and its resistance.

They may also be fitted beside another effect, held near their nulls by a prior, so that this does not have to mop up a
base that is slightly off.

In linear iron all fields are linear in remanence and current together, so the co-energy is homogeneous of second degree
in (remanence, i, h): W'(d, i, h; s) = s^2 W'(d, i/s, h/s) for a remanence scaled by s. Where the iron saturates this
holds to first order in the magnet's share of its flux.

With t times the turns a current makes t times the ampere-turns and links t times the flux: W'(d, i) -> W'(d, t i), the
field of the test current in the Hall element's place unchanged; a wire that is t times as long has t times the
resistance. Ammeter and turns differ in the flux linkage alone, so a fluxmeter separates them.
"""

from femfit.core.graph import Expression
from femfit.effects.effect import Coenergy, DirectReading, EffectParameter, effect_of


def remanence_scaled(base: Coenergy, scale: Expression, d: Expression, i: Expression, h: Expression) -> Expression:
    """s^2 W'(d, i/s, h/s): the co-energy with the magnet's remanence scaled by s > 0."""
    return scale * scale * base(d, i / scale, h / scale)


REMANENCE = effect_of(
    name="remanence",
    symptom="The magnet's part of every channel is larger or smaller than drawn, everywhere by the same factor.",
    parameter=EffectParameter(
        "remanence_error",
        bounds=(-0.5, 0.3),
        plausible=(-0.15, 0.1),
        description="True over drawn remanence, less one.",
        words="the magnet is {size} {stronger|weaker} than drawn",
    ),
    needs=("force_N|flux_linkage_Wb|inductance_H|hall_V", "magnet"),
    experiment="Compare the magnet's field on its axis, out of the bench and at a known temperature, with that of its "
    "data sheet.",
    reference="Woodson and Melcher, Electromechanical Dynamics I (1968), section 3.1; IEC 60404-8-1 (grades)",
    coenergy=lambda base, d, i, h, conditions, p: remanence_scaled(base, 1.0 + p["remanence_error"], d, i, h),
    read=DirectReading(
        0.01,
        40.0,
        "Take the magnet out at 20 °C and read its field on the axis by a gaussmeter.",
        also={"magnet_demagnetisation": {"loss": -1.0}},
    ),
)


RESISTANCE = effect_of(
    name="resistance",
    symptom="The voltage across the winding is larger or smaller than drawn at every current and temperature.",
    parameter=EffectParameter(
        "resistance_error",
        bounds=(-0.9, 9.0),
        plausible=(-0.2, 0.5),
        description="True over drawn resistance at 20 °C, leads included, less one.",
        words="the winding's resistance is {size} {larger|smaller} than drawn",
    ),
    needs=("~current_A|resistance_ohm", "voltage_V|resistance_ohm"),
    experiment="Measure the cold winding's resistance with four wires, at the terminals that the driver feeds.",
    reference="IEC 60317-0-1 (2013), resistance of round wire",
    circuit=lambda resistance, voltage, i, conditions, p: (resistance * (1.0 + p["resistance_error"]), voltage),
    read=DirectReading(2e-3, 10.0, also={"turns": {"turns_error": 1.0}}),
)


TURNS = effect_of(
    name="turns",
    symptom="The current's part of every channel is larger or smaller than drawn, everywhere by the same factor.",
    parameter=EffectParameter(
        "turns_error",
        bounds=(-0.5, 1.0),
        plausible=(-0.1, 0.1),
        description="True over drawn number of turns, less one.",
        words="the winding has {size} {more|fewer} turns than drawn",
    ),
    needs=("~current_A|inductance_H", "force_N|flux_linkage_Wb|inductance_H|hall_V|voltage_V"),
    experiment="Count the turns by the voltage that a coil of known turns around the same core induces in the winding.",
    reference="Woodson and Melcher, Electromechanical Dynamics I (1968), section 3.1",
    coenergy=lambda base, d, i, h, conditions, p: base(d, (1.0 + p["turns_error"]) * i, h),
    circuit=lambda resistance, voltage, i, conditions, p: (resistance * (1.0 + p["turns_error"]), voltage),
    read=DirectReading(
        2e-3,
        40.0,
        "Lay ten turns around the same core, feed the winding with an alternating voltage and read the voltage of "
        "the ten turns: their ratio is that of the turns.",
    ),
)


TOLERANCES = (REMANENCE, TURNS, RESISTANCE)

TOLERANCE_SD = 0.02
"""Standard deviation of each of them beside another effect, before anything is measured.

Remanence within a grade some 3 % either way (IEC 60404-8-1), resistance of round wire some 3 % (IEC 60317-0-1).
"""
