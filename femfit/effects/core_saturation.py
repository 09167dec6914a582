"""Saturation of an iron or ferrite core that the base model takes as linear.

To first order, a change of the core's magnetic energy at fixed flux, g(Phi), changes the co-energy at fixed current by
-g. The flux through the core is proportional to the flux linkage of the winding around it, which holds the magnet's
share too, so W' -> W' - sum_n c_n |lambda / lambda_max|^n with n = 4, 6, 10: a Rayleigh-like onset, a smooth knee, a
sharp one. lambda is the base model's flux linkage.

References
----------
H. H. Woodson and J. R. Melcher, Electromechanical Dynamics, part I (Wiley, 1968), section 3.1 (energy and co-energy);
the first-order step is the Hellmann-Feynman relation of a stationary functional.
"""

from femfit.core.arrays import FloatArray
from femfit.effects.effect import Conditions, Effect, EffectParameter, Parameters
from femfit.effects.jet import CoenergyJet, Jet

_EXPONENTS = (4, 6, 10)


def _coenergy(
    base: CoenergyJet, d: FloatArray, i: FloatArray, n_d: int, n_i: int, at: Conditions, p: Parameters
) -> Jet:
    energy = base(d, i, n_d, n_i + 1)
    flux = (1.0 / at.nominal.flux_linkage_Wb) * energy.along_current()
    square = flux * flux
    fourth = square * square
    powers = {4: fourth, 6: fourth * square, 10: fourth * fourth * square}
    scale = at.nominal.flux_linkage_Wb * at.nominal.current_scale
    result = energy.truncated(n_d, n_i)
    for n in _EXPONENTS:
        amplitude = p[f"mmf_loss_{n}"]
        if amplitude:
            result = result + (-amplitude * scale / n) * powers[n]
    return result


CORE_SATURATION = Effect(
    name="core_saturation",
    symptom="Force, flux linkage and inductance fall behind the model where the flux is largest.",
    acts_on=("magnetics",),
    parameters=tuple(
        EffectParameter(
            name=f"mmf_loss_{n}",
            unit="",
            lower=0.0,
            upper=1.0,
            sane=(0.0, 0.5),
            description=f"Part of the largest ampere turns that the core takes at the largest flux, growing with its "
            f"power {n - 1}.",
        )
        for n in _EXPONENTS
    ),
    needs=("current_A", "force_N|flux_linkage_Wb|hall_V"),
    experiment="Measure at the largest current and smallest distance, at both current signs: saturation is even in "
    "the total flux, a gain error of the current is not.",
    reference="Woodson and Melcher, Electromechanical Dynamics I (1968), section 3.1",
    coenergy=_coenergy,
)
"""The core takes a part of the ampere turns that grows with a high power of the flux."""
