"""What an iron or ferrite core, or a moving part, does beside a base model that takes it as linear.

``core_saturation``
    The core's saturating part takes a part of the ampere turns that grows with a high power of its flux: it stores
    g(y) = sum_n c_n |y|^n / n at the flux y and lies in series with all the rest, which stores y^2 / 2k with the
    winding's inductance k at this distance. The co-energy of both, max over y of y i - y^2 / 2k - g(y), is less than
    without the part by G(x) = min over y of g(y) + (x - y)^2 / 2k, with x = k i the flux without it, all relative: a
    knee at large flux limits y instead of growing without end. For small c this is g(x), the change of energy at fixed
    flux.

    x follows the flux linkage of the winding around the core, lambda = (part of the current) + (part of the magnet).
    The magnet's flux does not pass the core in the same way as the coil's, nor does the field at the Hall element
    depend on the saturating part as the flux linkage does; both have a share of their own.

``core_remanence``
    The core keeps a flux when the current is gone: W'(d, i) -> W'(d, i + i_r), without a voltage across the winding.
    Steel that was magnetised acts as a further winding whose ampere turns are its coercive field times its length; over
    a path with a gap they change little until the current is turned round (a loop that follows it is ``hysteresis``).

``position_dependent_inductance``
    The moving part conducts flux better than the model has it, so the inductance grows as it comes near:
    W' -> W' + (i^2 / 2) dL(d), with dL falling as a power of the distance: slowly for a wide part near the core, as
    (1/d)^6 for a small part far away, whose moment grows with the coil's field there and is seen through the same
    field. The field at the Hall element changes by the same path: i -> i + share h (dB/di) / L, relatively 20 to 40
    times as much as the flux of a coil whose own flux hardly reaches the moving part.

References
----------
H. H. Woodson and J. R. Melcher, Electromechanical Dynamics, part I (Wiley, 1968), section 3.1 (energy and co-energy).
J. J. Moreau, Bulletin de la Societe Mathematique de France 93 (1965) 273: the envelope G and its derivatives.
"""

from collections.abc import Mapping
from math import perm

import casadi as ca
import numpy as np
from casadi import SX

from femfit.core.graph import Expression, GraphFunction, building, is_number, settled, slope
from femfit.core.text import amount
from femfit.effects.conditions import Nominal
from femfit.effects.effect import Coenergy, Effect, EffectPoint, Parameters, effect_of, parameter_of

_EXPONENTS = (3, 6, 32)
"""A soft onset (Rayleigh), a round knee, a sharp one."""

_ITERATIONS = 12
"""Numerical: Newton's steps from above, which converge to rounding for all amplitudes within their bounds."""


def _coenergy(base: Coenergy, point: EffectPoint) -> Expression:
    nominal, p = point.nominal, point.p

    def linkage(current: Expression, hall: Expression) -> Expression:
        return slope(lambda i: base(point.d, i, hall), current)

    flux = linkage(point.i, p["hall_share"] * point.h) + (p["magnet_share"] - 1.0) * linkage(0.0 * point.i, 0.0)
    amplitudes = {n: p[f"mmf_loss_{n}"] for n in _EXPONENTS if not is_number(p[f"mmf_loss_{n}"], 0.0)}
    if not amplitudes:
        return base(point.d, point.i, point.h)
    share = np.maximum(slope(lambda i: linkage(i, point.h), point.i) / nominal.inductance_H, _LEAST_INDUCTANCE)
    lost = _envelope(flux / nominal.flux_linkage_Wb, amplitudes, share * _own_inductance(nominal))
    return base(point.d, point.i, point.h) - nominal.flux_linkage_Wb * nominal.peak_current_A * lost


_LEAST_INDUCTANCE = 0.01
"""Numerical: over the largest one; a force law's co-energy has next to none."""


def _own_inductance(nominal: Nominal) -> float:
    """The largest inductance, relative to the largest flux over the largest current."""
    return nominal.inductance_H * nominal.peak_current_A / nominal.flux_linkage_Wb


def _envelope(x: SX, amplitudes: Mapping[int, Expression], linear: Expression) -> SX:
    """G(x) for the inductance k = ``own``.

    With a y that is constant but for two steps of Newton's, y is exact up to its third derivative, and G, which is
    least in y, up to its seventh.
    """
    size = np.abs(x)
    y: Expression = size
    for n, amplitude in amplitudes.items():  # each part alone takes no more than all: Newton starts above
        y = np.minimum(y, (size / (linear * amplitude + _NONE)) ** (1.0 / (n - 1)))
    for _ in range(_ITERATIONS):
        y = _nearer(y, size, amplitudes, linear)
    y = settled(y)
    for _ in range(2):
        y = _nearer(y, size, amplitudes, linear)
    return _power_sum(y, amplitudes, 0) + (size - y) ** 2 / (2.0 * linear)


_NONE = 1e-300
"""Numerical: in place of an amplitude of nought in a quotient."""


def _nearer(y: Expression, x: Expression, amplitudes: Mapping[int, Expression], linear: Expression) -> Expression:
    """One step of Newton's on y + k g'(y) = x, whose left side is convex for positive y."""
    excess = y + linear * _power_sum(y, amplitudes, 1) - x
    return y - excess / (1.0 + linear * _power_sum(y, amplitudes, 2))


def _power_sum(y: Expression, amplitudes: Mapping[int, Expression], derivative: int) -> Expression:
    """A derivative of g(y) = sum_n c_n y^n / n for y >= 0."""
    return sum(c * (perm(n, derivative) / n) * y ** (n - derivative) for n, c in amplitudes.items())


def _words(p: Parameters, nominal: Nominal) -> list[str]:
    """The slope of the envelope at the largest flux is the part of the largest ampere-turns that is lost there."""
    amplitudes = {n: p[f"mmf_loss_{n}"] for n in _EXPONENTS}
    with building():
        lost = GraphFunction([], slope(lambda x: _envelope(x, amplitudes, _own_inductance(nominal)), 1.0))
    return [f"the core loses {amount(float(lost().item()), '')} of its ampere-turns at the largest flux"]


CORE_SATURATION = Effect(
    name="core_saturation",
    symptom="Force, flux linkage and inductance fall behind the model where the flux is largest.",
    parameters=(
        *(
            parameter_of(
                f"mmf_loss_{n}",
                limits=(0.0, 0.0, usual, upper),
                description="Part of the largest ampere turns that the core takes at the largest flux, growing with "
                f"its power {n - 1}.",
            )
            for n, usual, upper in zip(_EXPONENTS, (0.3, 1.0, 10.0), (10.0, 100.0, 1000.0), strict=True)
        ),
        parameter_of(
            "magnet_share",
            limits=(0.0, 0.65, 1.25, 2.0),
            description="How far the magnet's flux passes the saturating part, against the coil's.",
            usual=0.85,
        ),
        parameter_of(
            "hall_share",
            limits=(-2.0, -0.5, 1.5, 4.0),
            description="Loss of field at the Hall element over the loss of flux linkage, both relative.",
            usual=0.5,
        ),
    ),
    needs=("~current_A", "force_N|flux_linkage_Wb|inductance_H|hall_V"),
    experiment="Measure at the largest current and smallest distance, at both current signs: saturation is even in "
    "the total flux, a gain error of the current is not.",
    reference="Woodson and Melcher, Electromechanical Dynamics I (1968), section 3.1",
    coenergy=_coenergy,
    words=_words,
)


CORE_REMANENCE = effect_of(
    name="core_remanence",
    symptom="Force and flux linkage remain without current, and differ between the two signs of a current.",
    parameter="mmf",
    limits=(-1.0, -0.05, 0.05, 1.0),
    description="Ampere turns that the core keeps, as a part of those of the largest current.",
    words="the core keeps a flux as {signed} in the winding would drive it",
    scale="peak_current_A",
    needs=("force_N|flux_linkage_Wb|inductance_H", "iron"),
    experiment="Read the field at the core's face without current, before and after a slowly falling alternating "
    "current has demagnetised it.",
    reference="Bozorth, Ferromagnetism (1993), chapter 19 (remanence of a circuit with a gap)",
    coenergy=lambda base, point: base(point.d, point.i + point.p["mmf"] * point.nominal.peak_current_A, point.h),
    read=(2e-3, 30.0),
)


_POWERS = (1, 3, 6)


def _coenergy_of_position_dependent_inductance(base: Coenergy, point: EffectPoint) -> Expression:
    nominal = point.nominal
    # Of distances of nought and less, where no face is: from one travel behind the nearest
    behind = 0.0 if nominal.distance_min_m > 0.0 else nominal.travel_m - nominal.distance_min_m
    nearness = (nominal.distance_min_m + behind) / (point.d + behind)
    increase = nominal.inductance_H * sum(point.p[f"increase_{power}"] * nearness**power for power in _POWERS)
    current = point.i
    if np.isfinite(nominal.hall_T_per_A):
        current = point.i + point.h * (point.p["hall_share"] * nominal.hall_T_per_A / nominal.inductance_H)
    return base(point.d, point.i, point.h) + 0.5 * ca.sumsqr(current) * increase


def _words_of_position_dependent_inductance(p: Parameters, nominal: Nominal) -> list[str]:
    increase = sum(p[f"increase_{power}"] for power in _POWERS)
    sense = "larger" if increase >= 0.0 else "smaller"
    return [f"the inductance is {amount(abs(increase), '')} {sense} at the smallest distance"]


POSITION_DEPENDENT_INDUCTANCE = Effect(
    name="position_dependent_inductance",
    symptom="At small distances flux linkage and force have a further part: one in step with the current, the other "
    "with its square.",
    parameters=(
        *(
            parameter_of(
                f"increase_{power}",
                limits=(-0.5, -0.05, 0.5, 5.0),
                description="Increase of the inductance at the smallest distance, as a part of the model's, falling "
                f"with the power {power} of the distance; where that may be 0 or less, counted from one travel behind "
                "the nearest.",
                scale="inductance_H",
            )
            for power in _POWERS
        ),
        parameter_of(
            "hall_share",
            limits=(-10.0, 0.0, 40.0, 200.0),
            description="Change of the coil's field at the Hall element over that of its flux, both relative.",
            usual=20.0,
        ),
    ),
    needs=("~distance_m", "~current_A|inductance_H", "force_N|flux_linkage_Wb|inductance_H"),
    experiment="Measure the inductance with a small alternating current at several distances, or the force at both "
    "signs of the current: the further part is even in it.",
    reference="Woodson and Melcher, Electromechanical Dynamics I (1968), section 3.1",
    coenergy=_coenergy_of_position_dependent_inductance,
    words=_words_of_position_dependent_inductance,
)
