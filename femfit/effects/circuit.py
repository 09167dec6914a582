"""What changes the winding's resistance, what drives it and what the motion induces, and the drawing's strengths.

``coil_temperature``
    The resistance grows with the winding's temperature: R -> (1 + coefficient (T - 20 °C)) R.

``driver_dead_zone``
    Below a threshold the driver gives nothing, or its switches' drop opposes the current: applied voltage = commanded
    voltage less a dead zone, less a drop against the current.

``supply_sag``
    Supply and driver have an inner resistance: applied voltage = commanded voltage - R_s i. A bench reads across the
    winding and does not see it; a record of commanded voltages sees the sum of both resistances.

``motional_emf``
    The motion induces more or less voltage than the model's own: further voltage = share k_m v. The model's force and
    back-EMF come from one co-energy; what differs in the circuit alone links the winding or its leads without a force
    on the body: flux through the leads' loop, a pick-up winding in series.

``remanence``
    In linear iron all fields are linear in remanence and current together, so the co-energy is homogeneous of second
    degree in (remanence, i, h): W'(d, i, h; s) = s^2 W'(d, i/s, h/s) for a remanence scaled by s. Where the iron
    saturates this holds to first order in the magnet's share of its flux.

``resistance``, ``turns``
    With t times the turns a current makes t times the ampere-turns and links t times the flux: W'(d, i) -> W'(d, t i),
    the field of the test current in the Hall element's place unchanged; a wire that is t times as long has t times the
    resistance. Ammeter and turns differ in the flux linkage alone, so a fluxmeter separates them.
"""

import numpy as np

from femfit.core.graph import Expression
from femfit.core.numerics import COPPER_TEMPERATURE_COEFFICIENT, FloatArray
from femfit.effects.conditions import like, warmth
from femfit.effects.effect import Calibration, Coenergy, Effect, EffectPoint, effect_of, parameter_of


def _circuit(resistance: FloatArray, voltage: FloatArray, point: EffectPoint) -> tuple[FloatArray, FloatArray]:
    conditions, p = point.conditions, point.p
    coil = warmth(conditions.coil_temperature_C)
    warming = 1.0 if conditions.running else -np.expm1(-like(conditions.time_s, point.i) / p["warming_time"])
    unrecorded = COPPER_TEMPERATURE_COEFFICIENT * (p["warmer_K"] + p["warming_K"] * warming)
    growth = p["coefficient_per_K"] * coil.kelvin + (1.0 if conditions.running else coil.unknown) * unrecorded
    return resistance * (1.0 + growth), voltage


COIL_TEMPERATURE = Effect(
    name="coil_temperature",
    symptom="The voltage at a given current grows as the coil gets warm; force, flux linkage and Hall voltage do not.",
    parameters=(
        parameter_of(
            "coefficient_per_K",
            limits=(-0.01, 2e-3, 6e-3, 0.02),
            description="Relative change of the resistance per kelvin of the recorded temperature over 20 °C.",
            words="the resistance {grows|falls} by {size} of the recorded temperature",
        ),
        parameter_of(
            "warmer_K",
            limits=(-60.0, -10.0, 100.0, 250.0),
            description="Where its temperature was not recorded: the coil's over 20 °C, by 0.393 % a kelvin.",
            words="the winding is {size} {warmer|colder} than 20 °C",
        ),
        parameter_of(
            "warming_K",
            limits=(-10.0, -10.0, 100.0, 250.0),
            description="Where its temperature was not recorded: final warming since the start of the run.",
            words="the winding {warms|cools} by {size} in a run",
        ),
        parameter_of(
            "warming_time",
            unit="readings or s",
            limits=(1.0, 20.0, 500.0, 1e4),
            description="Time constant of the warming, in readings where the data have no clock.",
            usual=100.0,
        ),
    ),
    needs=("~current_A|resistance_ohm", "voltage_V|resistance_ohm"),
    experiment="Read voltage and current of the coil cold, and again after ten minutes at its largest current.",
    reference="IEC 60028 (1925): copper, 0.00393 per kelvin at 20 °C",
    circuit=_circuit,
    calibrations=(
        Calibration(
            {"coefficient_per_K": 1e-4},
            40.0,
            "Measure the winding's resistance by four wires, cold and warm, with a thermometer on the winding.",
        ),
        Calibration(
            {"warmer_K": 1.0, "warming_K": 2.0},
            15.0,
            "Put a thermometer on the winding and read it at the start and at the end of a run.",
        ),
    ),
)


_ROUNDING = 1e-2
"""Current, over the largest, within which the drop turns its sign."""


def _with_dead_zone(resistance: FloatArray, voltage: FloatArray, point: EffectPoint) -> tuple[FloatArray, FloatArray]:
    nominal = point.nominal
    zone, drop = point.p["dead_zone"] * nominal.voltage_V, point.p["drop"] * nominal.voltage_V
    applied = voltage - np.clip(voltage, -zone, zone)
    return resistance, applied - drop * np.tanh(point.i / (_ROUNDING * nominal.peak_current_A))


DRIVER_DEAD_ZONE = Effect(
    name="driver_dead_zone",
    symptom="The current is too small by the same amount at any commanded voltage, and none at a small one.",
    parameters=(
        parameter_of(
            "dead_zone",
            limits=(0.0, 0.0, 0.2, 1.0),
            description="Commanded voltage up to which nothing comes, as a part of the largest.",
            words="the driver gives nothing up to {size}",
            scale="voltage_V",
        ),
        parameter_of(
            "drop",
            limits=(0.0, 0.0, 0.3, 1.0),
            description="Voltage lost in the switches against the current, as a part of the largest.",
            words="the driver's switches lose {size}",
            scale="voltage_V",
        ),
    ),
    needs=("time_s", "voltage_V", "current_A", "voltage driver"),
    experiment="Raise the commanded voltage slowly from zero, in both directions, and read current and voltage.",
    reference="Mohan, Undeland and Robbins, Power Electronics (2003), section 8.5 (blanking time)",
    circuit=_with_dead_zone,
    calibrations=(Calibration({"dead_zone": 2e-3, "drop": 2e-3}, 30.0),),
)


SUPPLY_SAG = effect_of(
    name="supply_sag",
    symptom="The current falls short of the commanded voltage the more, the larger it is; at rest as after a step.",
    parameter="inner_resistance",
    limits=(0.0, 0.0, 0.3, 10.0),
    description="Inner resistance of supply, driver and leads before the terminals, over the winding's.",
    words="supply and driver have an inner resistance of {size} of the winding's",
    needs=("time_s", "voltage_V", "~current_A", "voltage driver"),
    experiment="Command a constant voltage and read that across the winding, with the body held, at a small and a "
    "large current.",
    reference="Horowitz and Hill, The Art of Electronics (2015), section 1.2 (Thevenin's equivalent of a source)",
    circuit=lambda resistance, voltage, point: (
        resistance,
        voltage - point.p["inner_resistance"] * point.nominal.resistance_ohm * point.i,
    ),
    read=(5e-3, 10.0),
)


MOTIONAL_EMF = effect_of(
    name="motional_emf",
    symptom="The current departs from the model while the body moves, in step with its velocity.",
    parameter="share",
    limits=(-2.0, -1.0, 1.0, 5.0),
    description="Further induced voltage over the model's own.",
    words="the motion induces {size} {more|less} voltage than in the model",
    needs=("time_s", "voltage_V", "current_A", "distance_m|hall_V"),
    experiment="Move the body by hand with the winding open and record distance and voltage.",
    reference="Woodson and Melcher, Electromechanical Dynamics I (1968), section 2.2",
    circuit=lambda resistance, voltage, point: (resistance, voltage + point.p["share"] * point.conditions.motional_V),
)


def remanence_scaled(base: Coenergy, scale: Expression, d: Expression, i: Expression, h: Expression) -> Expression:
    """s^2 W'(d, i/s, h/s): the co-energy with the magnet's remanence scaled by s > 0."""
    return scale * scale * base(d, i / scale, h / scale)


REMANENCE = effect_of(
    name="remanence",
    symptom="The magnet's part of every channel is larger or smaller than drawn, everywhere by the same factor.",
    parameter="remanence_error",
    limits=(-0.5, -0.15, 0.1, 0.3),
    description="True over drawn remanence, less one.",
    words="the magnet is {size} {stronger|weaker} than drawn",
    needs=("force_N|flux_linkage_Wb|inductance_H|hall_V", "magnet"),
    experiment="Take the magnet out at 20 °C and compare its field on the axis with the data sheet's by a gaussmeter.",
    reference="Woodson and Melcher, Electromechanical Dynamics I (1968), section 3.1; IEC 60404-8-1 (grades)",
    coenergy=lambda base, point: remanence_scaled(base, 1.0 + point.p["remanence_error"], point.d, point.i, point.h),
    read=(0.01, 40.0),
    also={"magnet_demagnetisation": {"loss": -1.0}},
)


RESISTANCE = effect_of(
    name="resistance",
    symptom="The voltage across the winding is larger or smaller than drawn at every current and temperature.",
    parameter="resistance_error",
    limits=(-0.9, -0.2, 0.5, 9.0),
    description="True over drawn resistance at 20 °C, leads included, less one.",
    words="the winding's resistance is {size} {larger|smaller} than drawn",
    needs=("~current_A|resistance_ohm", "voltage_V|resistance_ohm"),
    experiment="Measure the cold winding's resistance with four wires, at the terminals that the driver feeds.",
    reference="IEC 60317-0-1 (2013), resistance of round wire",
    circuit=lambda resistance, voltage, point: (resistance * (1.0 + point.p["resistance_error"]), voltage),
    read=(2e-3, 10.0),
    also={"turns": {"turns_error": 1.0}},
)


TURNS = effect_of(
    name="turns",
    symptom="The current's part of every channel is larger or smaller than drawn, everywhere by the same factor.",
    parameter="turns_error",
    limits=(-0.5, -0.1, 0.1, 1.0),
    description="True over drawn number of turns, less one, of a wire that is as much longer and otherwise as drawn.",
    words="the winding has {size} {more|fewer} turns than drawn",
    needs=("~current_A|inductance_H", "force_N|flux_linkage_Wb|inductance_H|hall_V|voltage_V"),
    experiment="Lay ten turns around the same core, feed the winding with an alternating voltage and read the voltage "
    "of the ten turns: their ratio is that of the turns.",
    reference="Woodson and Melcher, Electromechanical Dynamics I (1968), section 3.1",
    coenergy=lambda base, point: base(point.d, (1.0 + point.p["turns_error"]) * point.i, point.h),
    circuit=lambda resistance, voltage, point: (resistance * (1.0 + point.p["turns_error"]), voltage),
    read=(2e-3, 40.0),
)
