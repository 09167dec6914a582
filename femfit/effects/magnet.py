"""What weakens a magnet, adds to its field, or moves it off the axis.

``magnet_temperature``, ``magnet_demagnetisation``
    Warm: remanence = (1 + coefficient (T - 20 °C) + curvature (T - 20 °C)^2) of the base's. Demagnetised, all over or
    in the layer next to its face: a magnet of height t without its layer of thickness l is a magnet weaker by l/t,
    whose middle lies l/2 further away.

``external_field``
    A uniform field from elsewhere: the earth's, a motor's, a magnetised table's. It adds to the field at the Hall
    element, and magnetises a soft core as a current would, which changes force and flux linkage as well:
    W'(d, i, h) -> W'(d, i + i_e, h) + h B_e, with i_e = share B_e / (field at the element per ampere).

``lateral_misalignment``
    The moving part does not hang on the coil's axis. What the coil, or the Hall element's test coil, does to a magnet
    is harmonic in the magnet's place and symmetric about the axis, so at an offset e it is J_0(e d/dd) of its value on
    the axis: f - (e^2/4) f''. The attraction between magnet and core alone is second order in the magnetisation; its
    core-side image follows the magnet, so only a share of the same term applies: none for an infinite plate, about 0.4
    for a core that is small against the distance.

    Iron without a magnet, a plunger in its bore, changes a gap of the circuit instead: at an eccentricity e of a
    clearance c the bore's permeance grows by 1 / sqrt(1 - (e/c)^2). A change of reluctance dR in series with the flux
    is W' -> W' - dR lambda^2 / 2, and the part of the flux that crosses the gap falls as the plunger leaves: any
    parabola in the distance that falls and is not negative.

References
----------
J. D. Jackson, Classical Electrodynamics, 3rd ed. (Wiley, 1999), section 3.7 and problem 3.1 (expansion about an axis);
H. C. Roters, Electromagnetic Devices (Wiley, 1941), chapter 5: permeance between eccentric cylinders.
"""

import numpy as np

from femfit.core.errors import MissingPartError
from femfit.core.graph import Expression, slope
from femfit.core.text import amount
from femfit.effects.circuit import remanence_scaled
from femfit.effects.conditions import Nominal, warmth
from femfit.effects.effect import Calibration, Coenergy, Effect, EffectPoint, Parameters, parameter_of

USUAL_COEFFICIENT = -1.1e-3
"""Relative change of NdFeB's remanence per kelvin, by which an unrecorded warming is counted (IEC 60404-8-1)."""

_LEAST = 0.05
"""Part of the remanence that is left, whatever a fit tries."""


def _warm(base: Coenergy, point: EffectPoint) -> Expression:
    magnet, coil = warmth(point.conditions.magnet_temperature_C), warmth(point.conditions.coil_temperature_C)
    declared = point.p["coefficient_per_K"] * magnet.kelvin + point.p["curvature_per_K2"] * magnet.kelvin**2
    unrecorded = USUAL_COEFFICIENT * (point.p["warmer_K"] + point.p["coil_share"] * coil.kelvin)
    scale = 1.0 + declared + (1.0 if point.conditions.running else magnet.unknown) * unrecorded
    return remanence_scaled(base, np.maximum(scale, _LEAST), point.d, point.i, point.h)


MAGNET_TEMPERATURE = Effect(
    name="magnet_temperature",
    symptom="Force, flux linkage and Hall voltage shrink together in the magnet's share as it gets warm.",
    parameters=(
        parameter_of(
            "coefficient_per_K",
            limits=(-0.01, -3e-3, 0.0, 0.005),
            description="Relative change of the remanence per kelvin of the recorded temperature over 20 °C.",
            words="the remanence {grows|falls} by {size} of the recorded temperature",
        ),
        parameter_of(
            "curvature_per_K2",
            limits=(-1e-4, -1e-5, 1e-5, 1e-4),
            description="The same per kelvin squared.",
            words="it {grows|falls} by {size} besides",
        ),
        parameter_of(
            "warmer_K",
            limits=(-60.0, -10.0, 60.0, 150.0),
            description="Where its temperature was not recorded: the magnet's over 20 °C, by -0.11 % a kelvin.",
            words="the magnet is {size} {warmer|colder} than 20 °C",
        ),
        parameter_of(
            "coil_share",
            limits=(0.0, 0.0, 1.0, 2.0),
            description="Where its temperature was not recorded: the part of the coil's warming that it follows.",
            words="the magnet follows {size} of the winding's warming",
        ),
    ),
    needs=("force_N|flux_linkage_Wb|inductance_H|hall_V", "magnet"),
    experiment="Put thermometers on magnet and winding, and read them while the bench runs, cold and warm.",
    reference="IEC 60404-8-1; Woodson and Melcher, Electromechanical Dynamics I (1968), section 3.1",
    coenergy=_warm,
    calibrations=(Calibration({"warmer_K": 2.0, "coil_share": 0.1}, 15.0),),
)


def _demagnetised(base: Coenergy, point: EffectPoint) -> Expression:
    loss, layer, height = (point.p[name] for name in ("loss", "layer_m", "magnet_height_m"))
    return remanence_scaled(base, (1.0 - loss) * (1.0 - layer / height), point.d + 0.5 * layer, point.i, point.h)


MAGNET_DEMAGNETISATION = Effect(
    name="magnet_demagnetisation",
    symptom="The magnet's share of force, flux linkage and Hall voltage is too small everywhere, at any temperature.",
    parameters=(
        parameter_of(
            "loss",
            limits=(-0.1, -0.03, 0.3, 0.8),
            description="Lost part of the remanence; negative for a magnet that is stronger than its grade.",
            words="the magnet has {lost|gained} {size} of its remanence",
        ),
        parameter_of(
            "layer_m",
            limits=(0.0, 0.0, 1e-3, 2e-3),
            description="Thickness of the demagnetised layer next to the face.",
            words="a layer of {size} at the magnet's face is demagnetised",
        ),
        parameter_of(
            "magnet_height_m",
            limits=(3e-3, 3e-3, 0.02, 0.05),
            description="Height of the whole magnet.",
            usual=5e-3,
        ),
    ),
    needs=("force_N|flux_linkage_Wb|inductance_H|hall_V", "magnet"),
    experiment="Compare the magnet's field on its axis, out of the bench, with that of a fresh one; or measure at both "
    "signs of the current, where the coil's own share is the same.",
    reference="Campbell, Permanent Magnet Materials and their Application (1994), chapter 3",
    coenergy=_demagnetised,
    calibrations=(
        Calibration(
            {"layer_m": 5e-5}, 40.0, "Take the magnet out and compare its field at both faces by a gaussmeter."
        ),
        Calibration(
            {"loss": 5e-3},
            200.0,
            "Have the magnet magnetised anew, and read its field by a gaussmeter before and after.",
        ),
    ),
)


def _coenergy(base: Coenergy, point: EffectPoint) -> Expression:
    if np.isnan(point.nominal.hall_T_per_A):
        raise MissingPartError(
            "A model must have a Hall element for external_field; it has none. Leave that effect out."
        )
    equivalent = point.p["core_share"] * point.p["field_T"] / point.nominal.hall_T_per_A
    return base(point.d, point.i + equivalent, point.h) + point.h * point.p["field_T"]


EXTERNAL_FIELD = Effect(
    name="external_field",
    symptom="The Hall voltage is wrong by a constant, and force and flux linkage as if a small current were added.",
    parameters=(
        parameter_of(
            "field_T",
            limits=(-0.05, -2e-3, 2e-3, 0.05),
            description="Uniform field along the axis.",
            words="a field of {signed} from elsewhere acts along the axis",
        ),
        parameter_of(
            "core_share",
            limits=(0.05, 0.05, 0.6, 2.0),
            description="Field at the Hall element that the core adds to it, over the field itself.",
            usual=0.25,
        ),
    ),
    needs=("hall_V", "force_N|flux_linkage_Wb"),
    experiment="Switch the current off, take the moving part away and turn the bench by 180 degrees: half the change "
    "of the Hall voltage is the outer field's.",
    reference="Bozorth, Ferromagnetism (1993), chapter 19 (a body in a uniform field)",
    coenergy=_coenergy,
    calibrations=(Calibration({"field_T": 2e-5}, 15.0),),
)


def _coenergy_off_axis(base: Coenergy, point: EffectPoint) -> Expression:
    """Without a magnet W' + (i_max / lambda_max) g lambda^2 / 2, g = a + n (1 - x)^2 + m (1 - x^2), x = d / d_max."""
    nominal, i, p = point.nominal, point.i, point.p
    if nominal.has_magnet:
        bend = slope(lambda d: base(d, i, point.h) - (1.0 - p["image_share"]) * base(d, 0.0 * i, 0.0), point.d, 2)
        return base(point.d, i, point.h) - 0.25 * p["offset_squared_m2"] * bend
    x = point.d / nominal.distance_max_m
    growth = p["gap_all"] + p["gap_near"] * (1.0 - x) ** 2 + p["gap_middle"] * (1.0 - x * x)
    linkage = slope(lambda i: base(point.d, i, point.h), i)
    return base(point.d, i, point.h) + 0.5 * nominal.peak_current_A / nominal.flux_linkage_Wb * growth * linkage**2


def _words(p: Parameters, nominal: Nominal) -> list[str]:
    if nominal.has_magnet:
        if p["offset_squared_m2"] == 0.0:
            return []
        return [f"the moving part hangs {amount(p['offset_squared_m2'] ** 0.5, 'm')} beside the axis"]
    x = np.linspace(nominal.distance_min_m / nominal.distance_max_m, 1.0, 50)
    growth = p["gap_all"] + p["gap_near"] * (1.0 - x) ** 2 + p["gap_middle"] * (1.0 - x * x)
    return [f"the moving part touches its guide on one side: up to {amount(float(growth.max()), '')} more flux linkage"]


LATERAL_MISALIGNMENT = Effect(
    name="lateral_misalignment",
    symptom="Near the electromagnet the magnet's share of every channel is too small, most where it bends; without "
    "a magnet, force and flux linkage are too large there together.",
    parameters=(
        parameter_of(
            "offset_squared_m2",
            unit="m^2",
            limits=(0.0, 0.0, 9e-6, 4e-5),
            description="Square of the lateral offset of the magnet from the coil's axis.",
        ),
        *(
            parameter_of(
                f"gap_{name}",
                limits=(0.0, 0.0, 0.2, 0.4),
                description="Without a magnet: growth of the largest flux linkage by a better gap in series, as a part "
                f"of it; what {course}.",
            )
            for name, course in (
                ("all", "is the same at all distances"),
                ("near", "falls most where the gap is closed"),
                ("middle", "falls most at the largest distance"),
            )
        ),
        parameter_of(
            "image_share",
            limits=(-0.2, 0.0, 0.8, 1.0),
            description="Share of the term that applies to the attraction between magnet and core.",
            usual=0.4,
        ),
    ),
    needs=("~distance_m", "force_N|flux_linkage_Wb|inductance_H|hall_V"),
    experiment="Centre the moving part on the coil's axis by a dial gauge, and read how far it was off.",
    reference="Jackson, Classical Electrodynamics (1999), section 3.7",
    coenergy=_coenergy_off_axis,
    words=_words,
    calibrations=(Calibration({"offset_squared_m2": 2e-7}, 30.0),),
)
