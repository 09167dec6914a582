"""Saturation of an iron or ferrite core that the base model takes as linear.

The core's saturating part takes a part of the ampere turns that grows with a high power of its flux. With x the flux of
that part, y what is left of it and k its self-inductance, all relative, the co-energy falls by
G(x) = min over y of g(y) + (x - y)^2 / 2k, g(y) = sum_n c_n |y|^n / n: the first term is what the part stores,
the second what its demagnetising field withdraws, so a knee at large flux limits y instead of growing without end.
For small c this is g(x), the change of energy at fixed flux.

x follows the flux linkage of the winding around the core, lambda = (part of the current) + (part of the magnet). The
magnet's flux does not pass the core in the same way as the coil's, nor does the field at the Hall element depend on the
saturating part as the flux linkage does; both have a share of their own.

The core keeps a flux when the current is gone: W'(d, i) -> W'(d, i + i_r), without a voltage across the winding.

Steel that was magnetised acts as a further winding whose ampere turns are its coercive field times its length; over a
path with a gap they change little until the current is turned round (a loop that follows it is ``hysteresis``).

The moving part conducts flux better than the model has it, so the inductance grows as it comes near.

W' -> W' + (i^2 / 2) dL(d), with dL falling as a power of the distance: slowly for a wide part near the core, as (1/d)^6
for a small part far away, whose moment grows with the coil's field there and is seen through the same field. The field
at the Hall element changes by the same path: i -> i + share h (dB/di) / L, relatively 20 to 40 times as much as the
flux of a coil whose own flux hardly reaches the moving part.

References
----------
H. H. Woodson and J. R. Melcher, Electromechanical Dynamics, part I (Wiley, 1968), section 3.1 (energy and co-energy).
J. J. Moreau, Bulletin de la Societe Mathematique de France 93 (1965) 273: the envelope G and its derivatives.
"""

from math import perm

import numpy as np

from femfit.core.numerics import FloatArray
from femfit.core.text import amount
from femfit.effects.conditions import Conditions, Nominal
from femfit.effects.effect import Calibration, Effect, EffectParameter, Parameters
from femfit.effects.taylor_series import CoenergySeries, TaylorSeries, current_series, distance_series

_EXPONENTS = (3, 6, 32)
"""A soft onset (Rayleigh), a round knee, a sharp one."""
_ITERATIONS = 60
_ROUNDING = 1e-14


def _coenergy(
    base: CoenergySeries, d: FloatArray, i: FloatArray, n_d: int, n_i: int, conditions: Conditions, p: Parameters
) -> TaylorSeries:
    energy = base(d, i, n_d, n_i + 1)
    amplitudes = {n: p[f"mmf_loss_{n}"] for n in _EXPONENTS if p[f"mmf_loss_{n}"]}
    result = energy.truncated(n_d, n_i)
    if not amplitudes:
        return result
    linkage = energy.along_current().coefficients
    linkage[0, :, 0] += (p["magnet_share"] - 1.0) * base(d, np.zeros_like(i), n_d, 1).coefficients[0, :, 1]
    linkage[1] *= p["hall_share"]
    flux = (1.0 / conditions.nominal.flux_linkage_Wb) * TaylorSeries(linkage)
    lost = flux.compose(_envelope(flux.value, amplitudes, _own_inductance(conditions.nominal), n_d + n_i + 1))
    return result - conditions.nominal.flux_linkage_Wb * conditions.nominal.peak_current_A * lost


def _own_inductance(nominal: Nominal) -> float:
    """The saturating part's self-inductance, relative to the largest flux over the largest current."""
    return nominal.inductance_H * nominal.peak_current_A / nominal.flux_linkage_Wb


def _envelope(x: FloatArray, amplitudes: dict[int, float], own: float, order: int) -> list[FloatArray]:
    """G(x) and its derivatives up to an order of at most 5, for own self-inductance k.

    With y = x - k g'(y): G' = g'(y), and every further derivative in x is that in y over q = 1 + k g''(y).
    """
    y = _kept(x, amplitudes, own)
    g = [_power_sum(y, amplitudes, k) for k in range(max(order, 1) + 1)]
    q = 1.0 + own * _power_sum(y, amplitudes, 2)
    result = [g[0] + 0.5 * own * g[1] ** 2, g[1]]
    if order >= 2:
        result.append(g[2] / q)
    if order >= 3:
        result.append(g[3] / q**3)
    if order >= 4:
        result.append((g[4] - 3.0 * own * g[3] ** 2 / q) / q**4)
    if order >= 5:
        result.append((g[5] - 10.0 * own * g[3] * g[4] / q + 15.0 * own**2 * g[3] ** 3 / q**2) / q**5)
    return result


def _power_sum(y: FloatArray, amplitudes: dict[int, float], derivative: int) -> FloatArray:
    """A derivative of sum_n c_n |y|^n / n."""
    total, size = np.zeros_like(y), np.abs(y)
    for n, amplitude in amplitudes.items():
        total += amplitude * (perm(n, derivative) / n) * size ** max(n - derivative, 0)
    return total * np.sign(y) if derivative % 2 else total


def _kept(x: FloatArray, amplitudes: dict[int, float], own: float) -> FloatArray:
    """The y with y + k g'(y) = x: monotonic, so Newton's method within a shrinking bracket finds it."""
    low, high = np.minimum(x, 0.0), np.maximum(x, 0.0)
    y = x.copy()
    for _ in range(_ITERATIONS):
        excess = y + own * _power_sum(y, amplitudes, 1) - x
        high, low = np.where(excess > 0.0, y, high), np.where(excess < 0.0, y, low)
        step = y - excess / (1.0 + own * _power_sum(y, amplitudes, 2))
        inside = (step >= low) & (step <= high)
        new = np.where(inside, step, 0.5 * (low + high))
        if np.all(np.abs(new - y) <= _ROUNDING * np.abs(x)):
            return new
        y = new
    return y


def _words(p: Parameters, nominal: Nominal) -> list[str]:
    """The slope of the envelope at the largest flux is the part of the largest ampere-turns that is lost there."""
    amplitudes = {n: p[f"mmf_loss_{n}"] for n in _EXPONENTS if p[f"mmf_loss_{n}"]}
    lost = _envelope(np.ones(1), amplitudes, _own_inductance(nominal), 1)[1]
    return [f"the core loses {amount(float(lost[0]), '')} of its ampere-turns at the largest flux"]


CORE_SATURATION = Effect(
    name="core_saturation",
    symptom="Force, flux linkage and inductance fall behind the model where the flux is largest.",
    acts_on=("magnetics",),
    parameters=(
        *(
            EffectParameter(
                name=f"mmf_loss_{n}",
                bounds=(0.0, upper),
                plausible=(0.0, usual),
                description="Part of the largest ampere turns that the core takes at the largest flux, growing with "
                f"its power {n - 1}.",
            )
            for n, usual, upper in zip(_EXPONENTS, (0.3, 1.0, 10.0), (10.0, 100.0, 1000.0), strict=True)
        ),
        EffectParameter(
            name="magnet_share",
            bounds=(0.0, 2.0),
            plausible=(0.65, 1.25),
            description="How far the magnet's flux passes the saturating part, against the coil's.",
            null=0.85,
            nonlinear=True,
        ),
        EffectParameter(
            name="hall_share",
            bounds=(-2.0, 4.0),
            plausible=(-0.5, 1.5),
            description="Loss of field at the Hall element over the loss of flux linkage, both relative.",
            null=0.5,
            nonlinear=True,
        ),
    ),
    needs=("~current_A", "force_N|flux_linkage_Wb|inductance_H|hall_V"),
    experiment="Measure at the largest current and smallest distance, at both current signs: saturation is even in "
    "the total flux, a gain error of the current is not.",
    reference="Woodson and Melcher, Electromechanical Dynamics I (1968), section 3.1",
    coenergy=_coenergy,
    words=_words,
)


CORE_REMANENCE = Effect(
    name="core_remanence",
    symptom="Force and flux linkage remain without current, and differ between the two signs of a current.",
    acts_on=("magnetics",),
    parameters=(
        EffectParameter(
            "mmf",
            bounds=(-1.0, 1.0),
            plausible=(-0.05, 0.05),
            description="Ampere turns that the core keeps, as a part of those of the largest current.",
            words="the core keeps a flux as {signed} in the winding would drive it",
            scale="peak_current_A",
        ),
    ),
    needs=("force_N|flux_linkage_Wb|inductance_H", "iron"),
    experiment="Demagnetise the core by a slowly falling alternating current, and measure again.",
    reference="Bozorth, Ferromagnetism (1993), chapter 19 (remanence of a circuit with a gap)",
    coenergy=lambda base, d, i, n_d, n_i, conditions, p: base(
        d, i + p["mmf"] * conditions.nominal.peak_current_A, n_d, n_i
    ),
    calibrations=(
        Calibration(
            {"mmf": 2e-3},
            30.0,
            "Read the field at the core's face without current, before and after demagnetising it.",
        ),
    ),
)


_POWERS = (1, 3, 6)


def _coenergy_of_position_dependent_inductance(
    base: CoenergySeries, d: FloatArray, i: FloatArray, n_d: int, n_i: int, conditions: Conditions, p: Parameters
) -> TaylorSeries:
    distance = distance_series(d / conditions.nominal.distance_min_m, n_d, n_i).scaled(
        distance=1.0 / conditions.nominal.distance_min_m
    )
    increase = 0.0 * distance
    for power in _POWERS:
        amplitude = p[f"increase_{power}"] * conditions.nominal.inductance_H
        value = distance.value
        falls = [amplitude * np.prod(-power - np.arange(k)) * value ** (-power - k) for k in range(n_d + 1)]
        increase = increase + distance.compose(falls)
    current = current_series(i, n_d, n_i)
    if np.isfinite(conditions.nominal.hall_T_per_A):
        current.coefficients[1, 0, 0] = (
            p["hall_share"] * conditions.nominal.hall_T_per_A / conditions.nominal.inductance_H
        )
    return base(d, i, n_d, n_i) + 0.5 * (current * current * increase)


def _words_of_position_dependent_inductance(p: Parameters, nominal: Nominal) -> list[str]:
    increase = sum(p[f"increase_{power}"] for power in _POWERS)
    sense = "larger" if increase >= 0.0 else "smaller"
    return [f"the inductance is {amount(abs(increase), '')} {sense} at the smallest distance"]


POSITION_DEPENDENT_INDUCTANCE = Effect(
    name="position_dependent_inductance",
    symptom="At small distances flux linkage and force have a further part: one in step with the current, the other "
    "with its square.",
    acts_on=("magnetics",),
    parameters=(
        *(
            EffectParameter(
                name=f"increase_{power}",
                bounds=(-0.5, 5.0),
                plausible=(-0.05, 0.5),
                description="Increase of the inductance at the smallest distance, as a part of the model's, falling "
                f"with the power {power} of the distance.",
                scale="inductance_H",
            )
            for power in _POWERS
        ),
        EffectParameter(
            name="hall_share",
            bounds=(-10.0, 200.0),
            plausible=(0.0, 40.0),
            description="Change of the coil's field at the Hall element over that of its flux, both relative.",
            null=20.0,
            nonlinear=True,
        ),
    ),
    needs=("~distance_m", "~current_A|inductance_H", "force_N|flux_linkage_Wb|inductance_H"),
    experiment="Measure the inductance with a small alternating current at several distances, or the force at both "
    "signs of the current: the further part is even in it.",
    reference="Woodson and Melcher, Electromechanical Dynamics I (1968), section 3.1",
    coenergy=_coenergy_of_position_dependent_inductance,
    words=_words_of_position_dependent_inductance,
)
