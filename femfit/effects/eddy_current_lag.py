"""Eddy currents in the core and around it: the field follows the current late, and the motion is braked.

A closed path around the flux carries the current that its flux induces, so the core sees i - sum_k s_k x_k with
x_k' = i' - k_m v / L - x_k / tau_k: the induced current answers any change of flux, by current or by motion, and decays
with the path's own time constant. One path is a shorted ring; diffusion into a solid core is a series of them with
tau_k = tau / (2 k - 1)^2, of which the first two are kept. No effect on a static bench; an impedance shows
L (1 - sum_k s_k j w tau_k / (1 + j w tau_k)) in place of L.

References
----------
R. L. Stoll, The Analysis of Eddy Currents (Clarendon, 1974), chapter 2 (diffusion into a slab: tanh series).
H. H. Woodson and J. R. Melcher, Electromechanical Dynamics, part I (Wiley, 1968), section 2.2 (coupled windings).
"""

from collections.abc import Mapping

import numpy as np

from femfit.core.arrays import ComplexArray, FloatArray
from femfit.effects.conditions import Conditions, like
from femfit.effects.effect import Effect, EffectParameter, Memory, Parameters, States
from femfit.effects.taylor_series import CoenergySeries, TaylorSeries

_MODES = {"ring": 1.0, "diffusion": 9.0}
"""Mode -> tau over its time constant."""


def _rate(states: States, i: FloatArray, conditions: Conditions, p: Parameters) -> States:
    """Rates of the induced currents, over the largest current."""
    nominal = conditions.nominal
    change = (conditions.current_rate_A_s - conditions.motional_V / nominal.inductance_H) / nominal.peak_current_A
    return {f"eddy_{mode}": change - states[f"eddy_{mode}"] * (faster / p["time_s"]) for mode, faster in _MODES.items()}


def _lag(conditions: Conditions, p: Parameters) -> Mapping[str, tuple[float, float]]:
    return {f"eddy_{mode}": (conditions.nominal.peak_current_A * p[f"{mode}_share"], 0.0) for mode in _MODES}


def _response(frequency: FloatArray, conditions: Conditions, p: Parameters) -> Mapping[str, ComplexArray]:
    """States per ampere of a small current: s / (s + 1 / tau_k), over the largest current."""
    s = np.asarray(2j * np.pi * frequency, dtype=np.complex128)
    return {
        f"eddy_{mode}": s / (s + faster / p["time_s"]) / conditions.nominal.peak_current_A
        for mode, faster in _MODES.items()
    }


def _coenergy(
    base: CoenergySeries, d: FloatArray, i: FloatArray, n_d: int, n_i: int, conditions: Conditions, p: Parameters
) -> TaylorSeries:
    induced = np.zeros_like(i)
    for mode in _MODES:
        if p[f"{mode}_share"] and f"eddy_{mode}" in conditions.memory:
            induced = induced + p[f"{mode}_share"] * like(conditions.memory[f"eddy_{mode}"], i)
    return base(d, i - conditions.nominal.peak_current_A * induced, n_d, n_i)


def slow_lag(p: Parameters) -> float:
    """By how much the field follows a slow current late, in s."""
    return sum(p[f"{mode}_share"] * p["time_s"] / faster for mode, faster in _MODES.items())


def _share(mode: str, description: str, words: str) -> EffectParameter:
    # The winding's own leakage, here at least a twentieth, keeps the current from jumping
    return EffectParameter(
        f"{mode}_share", bounds=(0.0, 0.95), plausible=(0.0, 0.5), description=description, words=words
    )


EDDY_CURRENT_LAG = Effect(
    name="eddy_current_lag",
    symptom="Force and field follow fast changes of the current late, and the current rises faster than the model's.",
    acts_on=("magnetics",),
    parameters=(
        _share(
            "ring",
            "Part of the flux that one closed path around it delays.",
            "one closed path delays {size} of the flux",
        ),
        _share(
            "diffusion",
            "Part that the next mode of diffusion delays, nine times as fast.",
            "{size} of it follow nine times as fast",
        ),
        EffectParameter(
            name="time_s",
            unit="s",
            bounds=(1e-4, 1.0),
            plausible=(5e-4, 0.02),
            description="Time constant of the slowest path.",
            words="the time constant is {size}",
            null=3e-3,
            nonlinear=True,
        ),
    ),
    needs=("time_s|frequency_Hz", "current_A|voltage_V", "force_N|hall_V|distance_m"),
    experiment="Hold the body and step the voltage; record current and Hall voltage faster than ten times a time "
    "constant. Or read its impedance from 10 Hz to 10 kHz.",
    reference="Stoll, The Analysis of Eddy Currents (1974), chapter 2",
    coenergy=_coenergy,
    memory=Memory(
        names=tuple(f"eddy_{mode}" for mode in _MODES),
        amplitudes=tuple(f"{mode}_share" for mode in _MODES),
        spread=0.02,
        steady_state=lambda d, i, conditions, p: {f"eddy_{mode}": np.zeros_like(i) for mode in _MODES},
        rate=_rate,
        lag=_lag,
        response=_response,
    ),
)
