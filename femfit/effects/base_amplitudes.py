"""What the field solution leaves open of a drawing: the magnet's strength, the winding's turns and its resistance.

They are no missing physics and are never named. When an effect is added they may be fitted beside it, held near their
nulls by a prior, so that the effect does not have to mop up a base that is slightly off. Magnet and winding as the only
sources of a linear field give W'(d, i) -> s^2 W'(d, i / s) for a magnet s times as strong, and W'(d, t i) for t times
the turns; where iron saturates both hold for s and t near one.

References
----------
H. H. Woodson and J. R. Melcher, Electromechanical Dynamics, part I (Wiley, 1968), section 3.1.
IEC 60404-8-1 (2015), table of NdFeB grades: remanence within some 3 %; IEC 60317-0-1 (2013): resistance of round wire.
"""

from femfit.core.arrays import FloatArray
from femfit.effects.conditions import Conditions
from femfit.effects.effect import Effect, EffectParameter, Parameters
from femfit.effects.magnet_temperature import remanence_scaled
from femfit.effects.taylor_series import CoenergySeries, TaylorSeries

PRIOR_SD = 0.02
"""Standard deviation of each relative error before anything is measured."""


def _magnet(
    base: CoenergySeries, d: FloatArray, i: FloatArray, n_d: int, n_i: int, conditions: Conditions, p: Parameters
) -> TaylorSeries:
    return remanence_scaled(base, 1.0 + p["remanence_error"], d, i, n_d, n_i)


def _turns(
    base: CoenergySeries, d: FloatArray, i: FloatArray, n_d: int, n_i: int, conditions: Conditions, p: Parameters
) -> TaylorSeries:
    t = 1.0 + p["turns_error"]
    return base(d, t * i, n_d, n_i).scaled(current=t)


def _resistance(
    resistance: FloatArray, voltage: FloatArray, current: FloatArray, conditions: Conditions, p: Parameters
) -> tuple[FloatArray, FloatArray]:
    return resistance * (1.0 + p["resistance_error"]), voltage


def _relative(name: str, description: str) -> tuple[EffectParameter, ...]:
    return (EffectParameter(name, "", -0.3, 0.3, (-3.0 * PRIOR_SD, 3.0 * PRIOR_SD), description),)


BASE_AMPLITUDES: tuple[Effect, ...] = (
    Effect(
        name="base_magnet_strength",
        symptom="The magnet's part of every channel is larger or smaller than drawn, everywhere by the same factor.",
        acts_on=("magnetics",),
        parameters=_relative("remanence_error", "True over drawn remanence, less one."),
        needs=("magnet", "distance_m", "force_N|flux_linkage_Wb|hall_V"),
        experiment="Measure the field or the force of the magnet without current.",
        reference="Woodson and Melcher, Electromechanical Dynamics I (1968), section 3.1",
        coenergy=_magnet,
    ),
    Effect(
        name="base_turns",
        symptom="The current's part of every channel is larger or smaller than drawn, everywhere by the same factor.",
        acts_on=("magnetics",),
        parameters=_relative("turns_error", "True over drawn ampere turns of a current, less one."),
        needs=("current_A", "force_N|flux_linkage_Wb|hall_V"),
        experiment="Measure the inductance with the moving part far away.",
        reference="Woodson and Melcher, Electromechanical Dynamics I (1968), section 3.1",
        coenergy=_turns,
    ),
    Effect(
        name="base_resistance",
        symptom="The voltage across the winding is larger or smaller than drawn at every current and temperature.",
        acts_on=("circuit",),
        parameters=_relative("resistance_error", "True over drawn resistance at 20 C, less one."),
        needs=("current_A", "voltage_V"),
        experiment="Measure the cold winding's resistance with four wires.",
        reference="IEC 60317-0-1 (2013), resistance of round wire",
        circuit=_resistance,
    ),
)
"""Relative errors of the base, each held near zero by :data:`PRIOR_SD`."""
