"""What comes late, or drifts since it was reset.

``eddy_current_lag``
    Eddy currents in the core and around it: the field follows the current late, and the motion is braked. A closed path
    around the flux carries the current that its flux induces, so the core sees i - sum_k s_k x_k with
    x_k' = i' - k_m v / L - x_k / tau_k: the induced current answers any change of flux, by current or by motion, and
    decays with the path's own time constant. One path is a shorted ring; diffusion into a solid core is a series of
    them with tau_k = tau / (2 k - 1)^2, of which the first two are kept. No effect on a static bench; an impedance
    shows L (1 - sum_k s_k j w tau_k / (1 + j w tau_k)) in place of L.

``sensor_delay``
    The Hall reading is late: a filter before the converter, the conversion itself, a bus. To first order the reading
    belongs to the distance d - tau v and the current i - tau i'. What knows no voltage knows no i'; there the current
    less its own lag stands for it, a state with the time constant tau, or one sample where tau is shorter.

``flux_integrator_drift``
    The fluxmeter's integrator drifts from the start of each run, when it was reset.

References
----------
R. L. Stoll, The Analysis of Eddy Currents (Clarendon, 1974), chapter 2 (diffusion into a slab: tanh series).
H. H. Woodson and J. R. Melcher, Electromechanical Dynamics, part I (Wiley, 1968), section 2.2 (coupled windings).
"""

import numpy as np

from femfit.core.graph import Expression
from femfit.core.numerics import FloatArray
from femfit.effects.conditions import Conditions, like
from femfit.effects.effect import (
    Calibration,
    Coenergy,
    Effect,
    EffectPoint,
    Memory,
    Parameters,
    States,
    current_lag,
    effect_of,
    in_channel,
    parameter_of,
)

_MODES = {"ring": 1.0, "diffusion": 9.0}
"""Mode -> tau over its time constant."""


def _rate(states: States, i: FloatArray, conditions: Conditions, p: Parameters) -> States:
    """Rates of the induced currents, over the largest current."""
    nominal = conditions.nominal
    change = (conditions.current_rate_A_s - conditions.motional_V / nominal.inductance_H) / nominal.peak_current_A
    return {f"eddy_{mode}": change - states[f"eddy_{mode}"] * (faster / p["time_s"]) for mode, faster in _MODES.items()}


def _coenergy(base: Coenergy, point: EffectPoint) -> Expression:
    induced = sum(point.p[f"{mode}_share"] * point.conditions.memory.get(f"eddy_{mode}", 0.0) for mode in _MODES)
    return base(point.d, point.i - point.nominal.peak_current_A * induced, point.h)


EDDY_CURRENT_LAG = Effect(
    name="eddy_current_lag",
    symptom="Force and field follow fast changes of the current late, and the current rises faster than the model's.",
    parameters=(
        # The winding's own leakage, here at least a twentieth, keeps the current from jumping
        parameter_of(
            "ring_share",
            limits=(0.0, 0.0, 0.5, 0.95),
            description="Part of the flux that one closed path around it delays.",
            words="one closed path delays {size} of the flux",
        ),
        parameter_of(
            "diffusion_share",
            limits=(0.0, 0.0, 0.5, 0.95),
            description="Part that the next mode of diffusion delays, nine times as fast.",
            words="{size} of it follow nine times as fast",
        ),
        parameter_of(
            "time_s",
            limits=(1e-4, 5e-4, 0.02, 1.0),
            description="Time constant of the slowest path.",
            words="the time constant is {size}",
            usual=3e-3,
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
        steady_state=lambda d, i, conditions, p: {f"eddy_{mode}": 0.0 * i for mode in _MODES},
        rate=_rate,
        # What of the flux does not follow a small current: the sum of s_k s / (s + 1 / tau_k)
        response=lambda s, p: sum(s * p[f"{mode}_share"] / (s + fast / p["time_s"]) for mode, fast in _MODES.items()),
    ),
)


def _hall_point(point: EffectPoint) -> tuple[FloatArray, FloatArray]:
    delay = point.p["delay_s"]
    if "delay_lag" in point.conditions.memory:
        lag = point.nominal.peak_current_A * like(point.conditions.memory["delay_lag"], point.i)
        late = delay / np.maximum(delay, point.nominal.sample_time_s) * lag
    else:
        late = delay * like(point.conditions.current_rate_A_s, point.i)
    return point.d - delay * point.velocity, point.i - late


SENSOR_DELAY = effect_of(
    name="sensor_delay",
    symptom="The Hall voltage follows distance and current late; at rest it is right.",
    parameter="delay_s",
    limits=(0.0, 0.0, 5e-3, 0.05),
    description="Age of what a reading shows.",
    words="the Hall reading is {size} late",
    needs=("time_s", "hall_V", "current_A|voltage_V|distance_m"),
    experiment="Feed a step from a signal generator in the Hall element's place, and record step and reading on one "
    "clock.",
    reference="Astrom and Wittenmark, Computer-Controlled Systems (1997), section 2.3 (delays)",
    hall_point=_hall_point,
    memory=current_lag(
        "delay_lag", "delay_s", 0.02, lambda nominal, p: np.maximum(p["delay_s"], nominal.sample_time_s)
    ),
    read=(5e-5, 40.0),
)


def _drifted(flux: FloatArray, point: EffectPoint) -> FloatArray:
    """With what an integrated offset, and one that drifts itself over the campaign, have become since the run's start.

    Of the offset o + o' T at the time T of the campaign, the integral from a run's start T_0 to T_0 + t is
    o t + o' (t^2 + 2 T_0 t) / 2.
    """
    time = point.conditions.time_s / 1000.0
    start = point.conditions.elapsed / 1000.0 - time
    drift = point.p["ramp"] * time + point.p["bend"] * time * (time + 2.0 * start)
    return flux + point.nominal.flux_linkage_Wb * drift


FLUX_INTEGRATOR_DRIFT = Effect(
    name="flux_integrator_drift",
    symptom="The flux linkage wanders off from the start of each run; force and Hall voltage do not.",
    parameters=(
        parameter_of(
            "ramp",
            limits=(-100.0, -0.5, 0.5, 100.0),
            description="Drift over the first 1000 readings (or seconds), as a part of the largest flux linkage.",
            words="the fluxmeter drifts by {signed} in 1000 readings or seconds",
            scale="flux_linkage_Wb",
        ),
        parameter_of(
            "bend",
            limits=(-100.0, -0.5, 0.5, 100.0),
            description="What it grows by in that time, as the offset itself drifts from run to run.",
            words="its drift grows by {signed} in the first 1000 readings or seconds",
            scale="flux_linkage_Wb",
        ),
    ),
    needs=("flux_linkage_Wb", "~order|~time_s"),
    experiment="Leave everything still and read the fluxmeter for as long as a run takes.",
    reference="Fiorillo, Characterization and Measurement of Magnetic Materials (2004), section 5.1",
    readings=in_channel("flux_linkage_Wb", _drifted),
    calibrations=(Calibration({"ramp": 1e-3, "bend": 1e-3}, 60.0),),
)
