"""The core's magnetisation lags behind the current: a loop between rising and falling current.

The core acts as if the current were i - sum_r w_r z_r with states that saturate as the current moves on (Dahl;
Coleman and Hodgdon): dz_r/di = (1 - sign(di) z_r) / r, for three radii r. On a slow cycle between two turning points
z_r has a closed form, which a bench reading takes; where the branch is unknown, z = 0. Weights of either sign together
make loops that are narrow at their tips, as Rayleigh's. A loop whose width changes along the current has parts that go
with the flux: W' -> W' - z (w_1 lambda^2 / 2 + w_2 lambda^3 / 3). A core that saturates both ways lags most in between.

References
----------
P. R. Dahl, AIAA Journal 14 (1976) 1675; B. D. Coleman and M. L. Hodgdon, Int. J. Engineering Science 24 (1986) 897.
"""

from collections.abc import Mapping

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.effects.conditions import Conditions, like
from femfit.effects.effect import Effect, EffectParameter, Memory, Parameters
from femfit.effects.jet import CoenergyJet, Jet

_RADII = {"small": 0.04, "medium": 0.15, "large": 0.5}
"""Over the span of the box's currents."""

_TAPERED = "medium"


def _states(i: FloatArray, at: Conditions) -> Mapping[str, FloatArray]:
    """z_r on the branches of a slow cycle: 1 - (1 + z_t) exp(-(i - i_1)/r) while rising, z_t = tanh(span / 2 r)."""
    low, high = (like(turn, i) for turn in at.current_turn_A)
    branch, span = like(at.branch, i), at.nominal.current_max_A - at.nominal.current_min_A
    result = {}
    for name, part in _RADII.items():
        radius = part * span
        tip = np.tanh((high - low) / (2.0 * radius))
        way = np.where(branch > 0, i - low, high - i)
        result[f"hysteresis_{name}"] = branch * (1.0 - (1.0 + tip) * np.exp(-np.maximum(way, 0.0) / radius))
    return result


def _rest(d: FloatArray, i: FloatArray, at: Conditions, p: Parameters) -> Mapping[str, FloatArray]:
    return _states(i, at)


def _rate(
    states: Mapping[str, FloatArray],
    d: FloatArray,
    v: FloatArray,
    i: FloatArray,
    current_rate: FloatArray,
    at: Conditions,
    p: Parameters,
) -> Mapping[str, FloatArray]:
    span = at.nominal.current_max_A - at.nominal.current_min_A
    return {
        f"hysteresis_{name}": (current_rate - np.abs(current_rate) * states[f"hysteresis_{name}"]) / (part * span)
        for name, part in _RADII.items()
    }


def _lag(at: Conditions, p: Parameters) -> Mapping[str, tuple[float, float, float]]:
    scale, flux = at.nominal.current_scale, at.nominal.flux_linkage_Wb
    growth = {_TAPERED: (scale * p["taper"] / flux, scale * p["bulge"] / flux**2)}
    return {f"hysteresis_{name}": (scale * p[f"width_{name}"], *growth.get(name, (0.0, 0.0))) for name in _RADII}


def _coenergy(
    base: CoenergyJet, d: FloatArray, i: FloatArray, n_d: int, n_i: int, at: Conditions, p: Parameters
) -> Jet:
    remembered = all(f"hysteresis_{name}" in at.memory for name in _RADII)
    states = {name: like(value, i) for name, value in at.memory.items()} if remembered else _states(i, at)
    lag = at.nominal.current_scale * sum(p[f"width_{name}"] * states[f"hysteresis_{name}"] for name in _RADII)
    tapered = p["taper"] != 0.0 or p["bulge"] != 0.0
    energy = base(d, i - lag, n_d, n_i + tapered)
    coefficients = energy.truncated(n_d, n_i).coefficients.copy()
    if p["hall_share"] != 1.0:
        coefficients[1] = base(d, i - p["hall_share"] * lag, n_d, n_i).coefficients[1]
    if not tapered:
        return Jet(coefficients)
    linkage = energy.along_current().coefficients.copy()
    linkage[1] *= p["hall_share"]
    flux = Jet(linkage)
    square, lagging = flux * flux, states[f"hysteresis_{_TAPERED}"] * at.nominal.current_scale
    taper, bulge = (p[name] / at.nominal.flux_linkage_Wb**k * lagging for k, name in ((1, "taper"), (2, "bulge")))
    return Jet(coefficients) - (taper / 2.0) * square - (bulge / 3.0) * (square * flux)


HYSTERESIS = Effect(
    name="hysteresis",
    symptom="Force, flux linkage and Hall voltage differ between rising and falling current and meet at the ends.",
    acts_on=("magnetics",),
    parameters=(
        *(
            EffectParameter(
                name=f"width_{name}",
                unit="",
                # A state that turns faster than the current would reverse the core's permeability
                lower=-part,
                upper=part,
                sane=(-0.5 * part, 0.5 * part),
                description=f"Half width of the loop as a part of the largest current, reached over {part:g} of the "
                "currents' span.",
                of="current_scale",
            )
            for name, part in _RADII.items()
        ),
        EffectParameter(
            name="taper",
            unit="",
            lower=-0.2,
            upper=0.2,
            sane=(-0.08, 0.08),
            description="Growth of the half width from no flux to the largest, as a part of the largest current.",
            of="current_scale",
        ),
        EffectParameter(
            name="bulge",
            unit="",
            lower=-0.2,
            upper=0.2,
            sane=(-0.08, 0.08),
            description="The same for flux of either sign; negative where the loop is widest without flux.",
            of="current_scale",
        ),
        EffectParameter(
            name="hall_share",
            unit="",
            lower=-1.0,
            upper=3.0,
            sane=(0.0, 1.5),
            description="Loop at the Hall element over that of the flux, both relative to the current's part.",
            null=1.0,
            shape=True,
        ),
    ),
    needs=("~current_A", "~branch", "force_N|flux_linkage_Wb|hall_V"),
    experiment="Cycle the current slowly up and down at one distance and read both branches.",
    reference="Dahl, AIAA Journal 14 (1976) 1675; Coleman and Hodgdon (1986)",
    coenergy=_coenergy,
    memory=Memory(
        names=tuple(f"hysteresis_{name}" for name in _RADII),
        amplitudes=(*(f"width_{name}" for name in _RADII), "taper", "bulge"),
        spread=0.5,
        rest=_rest,
        rate=_rate,
        lag=_lag,
    ),
)
"""W'(d, i) -> W'(d, i - lag), the lag a state of its own."""
