"""The moving part does not hang on the coil's axis.

What the coil, or the Hall element's test coil, does to a magnet is harmonic in the magnet's place and symmetric about
the axis, so at an offset e it is J_0(e d/dd) of its value on the axis: f - (e^2/4) f''. The attraction between magnet
and core alone is second order in the magnetisation; its core-side image follows the magnet, so only a share of
the same term applies: none for an infinite plate, about 0.4 for a core that is small against the distance.

Iron without a magnet, a plunger in its bore, changes a gap of the circuit instead: at an eccentricity e of a clearance
c the bore's permeance grows by 1 / sqrt(1 - (e/c)^2). A change of reluctance dR in series with the flux is
W' -> W' - dR lambda^2 / 2, and the part of the flux that crosses the gap falls as the plunger leaves: any parabola in
the distance that falls and is not negative.

References
----------
J. D. Jackson, Classical Electrodynamics, 3rd ed. (Wiley, 1999), section 3.7 and problem 3.1 (expansion about an axis);
H. C. Roters, Electromagnetic Devices (Wiley, 1941), chapter 5: permeance between eccentric cylinders.
"""

import numpy as np

from femfit.core.graph import Expression, slope
from femfit.core.text import amount
from femfit.effects.conditions import Conditions, Nominal
from femfit.effects.effect import Calibration, Coenergy, Effect, EffectParameter, Parameters


def _coenergy(
    base: Coenergy, d: Expression, i: Expression, h: Expression, conditions: Conditions, p: Parameters
) -> Expression:
    if not conditions.nominal.has_magnet:
        return _with_gap(base, d, i, h, conditions, p)

    bend = slope(lambda at: base(at, i, h) - (1.0 - p["image_share"]) * base(at, 0.0 * i, 0.0), d, 2)
    return base(d, i, h) - 0.25 * p["offset_squared_m2"] * bend


def _with_gap(
    base: Coenergy, d: Expression, i: Expression, h: Expression, conditions: Conditions, p: Parameters
) -> Expression:
    """W' + (i_max / lambda_max) g lambda^2 / 2, g = a + n (1 - x)^2 + m (1 - x^2), with x = d / d_max."""
    nominal = conditions.nominal
    x = d / nominal.distance_max_m
    growth = p["gap_all"] + p["gap_near"] * (1.0 - x) ** 2 + p["gap_middle"] * (1.0 - x * x)
    linkage = slope(lambda at: base(d, at, h), i)
    return base(d, i, h) + 0.5 * nominal.peak_current_A / nominal.flux_linkage_Wb * growth * linkage**2


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
        EffectParameter(
            name="offset_squared_m2",
            unit="m^2",
            bounds=(0.0, 4e-5),
            plausible=(0.0, 9e-6),
            description="Square of the lateral offset of the magnet from the coil's axis.",
        ),
        *(
            EffectParameter(
                name=f"gap_{part}",
                bounds=(0.0, 0.4),
                plausible=(0.0, 0.2),
                description="Without a magnet: growth of the largest flux linkage by a better gap in series, as a part "
                f"of it; what {course}.",
            )
            for part, course in (
                ("all", "is the same at all distances"),
                ("near", "falls most where the gap is closed"),
                ("middle", "falls most at the largest distance"),
            )
        ),
        EffectParameter(
            name="image_share",
            bounds=(-0.2, 1.0),
            plausible=(0.0, 0.8),
            description="Share of the term that applies to the attraction between magnet and core.",
            null=0.4,
            nonlinear=True,
        ),
    ),
    needs=("~distance_m", "force_N|flux_linkage_Wb|inductance_H|hall_V"),
    experiment="Move the moving part sideways in steps of half a millimetre at the smallest distance: on the axis the "
    "Hall voltage has its extremum.",
    reference="Jackson, Classical Electrodynamics (1999), section 3.7",
    coenergy=_coenergy,
    words=_words,
    calibrations=(
        Calibration(
            {"offset_squared_m2": 2e-7},
            30.0,
            "Centre the moving part on the coil's axis by a dial gauge and read how far it was off.",
        ),
    ),
)
