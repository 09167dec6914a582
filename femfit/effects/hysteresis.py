"""The core's magnetisation lags behind the current: a loop between rising and falling current.

The core acts as if the current were i - sum_r w_r z_r with states that saturate as the current moves on (Dahl;
Coleman and Hodgdon): dz_r/di = (1 - sign(di) z_r) / r, for three radii r. Weights of either sign together make loops
that are narrow at their tips, as Rayleigh's. What lags are the walls that the current moves to and fro; a large current
leaves none of them behind, so that z_r fades as phi(i) = sech^2(f i / i_max), the slope of a magnetisation
tanh(f i / i_max): dz_r = phi (di - |di| z_r / phi) / r + z_r (phi' / phi) di. A loop whose width changes with the flux
as well has a part that goes with it: W' -> W' - z t lambda^2 / 2.

A bench table gives the order of its readings, and so the path of the current through all turning points of a run. It
does not say what was before: the current may have been cycled, or the core demagnetised. Where the order is not known,
z_r is that of a slow cycle between two turning points.

References
----------
P. R. Dahl, AIAA Journal 14 (1976) 1675; B. D. Coleman and M. L. Hodgdon, Int. J. Engineering Science 24 (1986) 897;
D. C. Jiles and D. L. Atherton, J. Magnetism and Magnetic Materials 61 (1986) 48: what lags is the irreversible part.
"""

from collections.abc import Mapping

import numpy as np

from femfit.core.graph import Expression, is_number, slope
from femfit.core.numerics import BoolArray, FloatArray
from femfit.core.text import amount
from femfit.effects.conditions import Conditions, Nominal, like
from femfit.effects.effect import Coenergy, Effect, EffectPoint, Memory, Parameters, States, parameter_of

_RADII = {"small": 0.04, "medium": 0.15, "large": 0.5}
"""Over the span of the box's currents."""

_TAPERED = "medium"


def _span(nominal: Nominal) -> float:
    return nominal.current_max_A - nominal.current_min_A


def _left(i: FloatArray, conditions: Conditions, p: Parameters) -> FloatArray:
    """Part phi = sech^2 of the lagging walls that a current leaves behind."""
    # By the decaying exponential: cosh overflows where a filter tries a current far outside
    decay = np.exp(-2.0 * np.abs(p["fade"] * i / conditions.nominal.peak_current_A))
    return 4.0 * decay / (1.0 + decay) ** 2


def _steady_state(d: FloatArray, i: FloatArray, conditions: Conditions, p: Parameters) -> Mapping[str, FloatArray]:
    """z_r along the path that the readings took, or on a slow cycle."""
    fade = _left(i, conditions, p)
    if not conditions.recalled:
        return {f"hysteresis_{name}": fade * z for name, z in _cycle(i, conditions).items()}
    result = {}
    for name in _RADII:
        cycled, virgin = (like(conditions.recalled[f"hysteresis_{name}_{start}"], i) for start in ("cycled", "virgin"))
        result[f"hysteresis_{name}"] = fade * (cycled + p["virgin"] * (virgin - cycled))
    return result


def _cycle(i: FloatArray, conditions: Conditions) -> Mapping[str, FloatArray]:
    """On the branches of a slow cycle z_r / phi = 1 - (1 + z_t) exp(-(i - i_1) / r) rising, z_t = tanh(span / 2 r)."""
    low, high = (like(turn, i) for turn in conditions.current_turn_A)
    branch, span = like(conditions.branch, i), _span(conditions.nominal)
    result = {}
    for name, radius in _RADII.items():
        width = radius * span
        tip = np.tanh((high - low) / (2.0 * width))
        way = np.where(branch > 0, i - low, high - i)
        result[name] = branch * (1.0 - (1.0 + tip) * np.exp(-np.maximum(way, 0.0) / width))
    return result


def _recall(current: FloatArray, begins: BoolArray, nominal: Nominal) -> Mapping[str, FloatArray]:
    """z_r / phi after each reading, of a core that was cycled before each run, and of one that was demagnetised."""
    names, radius = list(_RADII), np.maximum(np.array([*_RADII.values()]) * _span(nominal), 1e-300)
    ends = np.append(np.flatnonzero(begins)[1:], len(current))
    states = np.empty((len(current), 2, len(radius)))

    def moved(z: FloatArray, way: FloatArray) -> FloatArray:
        return np.asarray(np.sign(way) - (np.sign(way) - z) * np.exp(-np.abs(way) / radius))

    for first, end in zip(np.flatnonzero(begins), ends, strict=True):
        run = current[first:end]
        # After many cycles z = -tanh(span / 2 r) at the lowest current
        z = np.stack([-np.tanh(np.ptp(run) / (2.0 * radius)), 0.0 * radius])
        z = states[first] = moved(z, run[0] - np.array([[run.min()], [0.0]]))
        for k in range(first + 1, end):
            z = states[k] = moved(z, current[k] - current[k - 1])
    return {
        f"hysteresis_{name}_{start}": states[:, way, k]
        for k, name in enumerate(names)
        for way, start in enumerate(("cycled", "virgin"))
    }


def _rate(states: States, i: FloatArray, conditions: Conditions, p: Parameters) -> States:
    fade, steep = _left(i, conditions, p), p["fade"] / conditions.nominal.peak_current_A
    current_rate = like(conditions.current_rate_A_s, i)
    fading = 2.0 * steep * np.tanh(steep * i) * current_rate
    result = {}
    for name, radius in _RADII.items():
        z = states[f"hysteresis_{name}"]
        moving = (fade * current_rate - np.abs(current_rate) * z) / (radius * _span(conditions.nominal))
        # A filter's state may stand where no current can have brought it: that part does not grow back
        result[f"hysteresis_{name}"] = moving - fading * np.clip(z, -fade, fade)
    return result


def _coenergy(base: Coenergy, point: EffectPoint) -> Expression:
    states, nominal = point.conditions.memory, point.nominal
    if not all(f"hysteresis_{name}" in states for name in _RADII):
        return base(point.d, point.i, point.h)
    lag = nominal.peak_current_A * sum(point.p[f"width_{name}"] * states[f"hysteresis_{name}"] for name in _RADII)
    energy = base(point.d, point.i - lag, point.h)
    if not is_number(point.p["hall_share"], 1.0):
        inside = point.i - point.p["hall_share"] * lag
        energy = base(point.d, point.i - lag, 0.0) + base(point.d, inside, point.h) - base(point.d, inside, 0.0)
    if is_number(point.p["taper"], 0.0):
        return energy
    linkage = slope(lambda i: base(point.d, i, point.p["hall_share"] * point.h), point.i - lag)
    taper = nominal.peak_current_A * point.p["taper"] / nominal.flux_linkage_Wb * states[f"hysteresis_{_TAPERED}"]
    return energy - 0.5 * taper * linkage**2


def _words(p: Parameters, nominal: Nominal) -> list[str]:
    """Both branches of the largest cycle differ by twice the lag in its middle."""
    middle = 0.5 * (nominal.current_min_A + nominal.current_max_A)
    largest = Conditions(nominal, branch=1.0, current_turn_A=(nominal.current_min_A, nominal.current_max_A))
    states = _steady_state(np.zeros(1), np.full(1, middle), largest, p)
    lag = sum(p[f"width_{name}"] * float(states[f"hysteresis_{name}"][0]) for name in _RADII)
    wide = amount(2.0 * abs(lag) * nominal.peak_current_A, "A")
    return [f"rising and falling current differ as if it were {wide} apart"]


HYSTERESIS = Effect(
    name="hysteresis",
    symptom="Force, flux linkage and Hall voltage differ between rising and falling current and meet at the ends.",
    parameters=(
        *(
            parameter_of(
                f"width_{name}",
                limits=(-radius, -0.5 * radius, 0.5 * radius, radius),
                description=f"Half width of the loop as a part of the largest current, reached over {radius:g} of the "
                "currents' span.",
                scale="peak_current_A",
            )
            for name, radius in _RADII.items()
        ),
        parameter_of(
            "taper",
            limits=(-0.2, -0.08, 0.08, 0.2),
            description="Growth of the half width from no flux to the largest, as a part of the largest current.",
            scale="peak_current_A",
        ),
        parameter_of(
            "hall_share",
            limits=(-1.0, 0.0, 1.5, 3.0),
            description="Loop at the Hall element over that of the flux, both relative to the current's part.",
            usual=1.0,
        ),
        parameter_of(
            "fade",
            limits=(0.0, 0.0, 4.0, 6.0),
            description="Largest current over the current at which 58 % of the lag have gone.",
            usual=0.0,
        ),
        parameter_of(
            "virgin",
            limits=(0.0, 0.0, 1.0, 1.0),
            description="0 where the current was cycled before each run of a bench table, 1 where the core was "
            "demagnetised.",
            usual=0.0,
        ),
    ),
    needs=("~current_A", "~branch", "force_N|flux_linkage_Wb|hall_V"),
    experiment="Cycle the current slowly up and down at one distance and read both branches.",
    reference="Dahl, AIAA Journal 14 (1976) 1675; Coleman and Hodgdon (1986); Jiles and Atherton (1986)",
    coenergy=_coenergy,
    words=_words,
    memory=Memory(
        names=tuple(f"hysteresis_{name}" for name in _RADII),
        amplitudes=(*(f"width_{name}" for name in _RADII), "taper"),
        spread=0.5,
        steady_state=_steady_state,
        recall=_recall,
        rate=_rate,
    ),
)
