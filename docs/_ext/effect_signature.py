"""The signature of an effect: what it changes of every reading over the distances and currents of a model."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from femfit.core.numerics import FloatArray
from femfit.device.mechanics import Spring, Stop
from femfit.effects.catalogue import effect_by_name
from femfit.effects.conditions import REFERENCE_TEMPERATURE_C, Conditions
from femfit.effects.effect import AddedEffect, Effect, Memory, Parameters
from femfit.effects.friction import REST
from femfit.effects.stages import recorded
from femfit.model.actuator_model import ActuatorModel
from femfit.model.dynamics import state_derivative
from femfit.model.readings import predict_readings
from femfit.model.with_effects import nominal_of, with_effects

_TYPICAL = 0.3
"""Amplitude of a drawn effect, as a part of the further end of its plausible range."""

_WARMER_C = {"coil_temperature_C": 30.0, "magnet_temperature_C": 15.0}
_READINGS = 100.0
"""Readings since the start of the run, for drifts."""
_SPEED_M_S, _SWING_S = 0.1, 0.02
"""Speed of the body where it moves; the current then runs through its whole range in this time."""


@dataclass(frozen=True, eq=False)
class Signature:
    """Readings without an effect, and what it changes of them, over n distances and m currents.

    Parameters
    ----------
    plain, change : mapping of str to array, shape (n, m)
        Per channel, in the unit that its name ends in: ``force_N``, ``flux_linkage_Wb``, ``hall_V``, ``voltage_V`` of a
        body at rest, or ``force_N``, ``acceleration_m_s2``, ``current_rate_A_s``, ``hall_V`` of one that moves.
    conditions : str
        One sentence: at rest or moving, warm or cold.
    """

    effect: Effect
    parameters: Parameters
    distance_m: FloatArray
    current_A: FloatArray
    plain: Mapping[str, FloatArray]
    change: Mapping[str, FloatArray]
    conditions: str

    @property
    def visible(self) -> tuple[str, ...]:
        """Channels that the effect changes by more than rounding."""
        return tuple(
            name
            for name, change in self.change.items()
            if np.nanmax(np.abs(change)) > 1e-9 * np.nanmax(np.abs(self.plain[name]))
        )


def effect_signature(
    model: ActuatorModel,
    effect: str | Effect,
    *,
    parameters: Parameters | None = None,
    distances: int = 25,
    currents: int = 15,
) -> Signature:
    """What an effect changes of the readings of a model, over its validity domain.

    Returns
    -------
    Signature
        Of a slow bench with warm parts and rising current; of a body that falls away at 0.1 m/s while the current
        rises, where the effect shows in motion alone.
    """
    effect = effect_by_name(effect) if isinstance(effect, str) else effect
    values = effect.null() | dict(typical_parameters(effect) if parameters is None else parameters)
    added, base, box = AddedEffect(effect, values), model.without_effects, model.validity
    drawn = ""
    if "spring" in effect.needs and base.motion is not None:
        base, drawn = _with_spring(base), " A spring is drawn."
    distance = np.linspace(box.distance_min_m, box.distance_max_m, distances)
    current = np.linspace(box.current_min_A, box.current_max_A, currents)
    d, i = (x.ravel() for x in np.meshgrid(distance, current, indexing="ij"))
    resting = "stop" in effect.needs
    moving = any("time_s" in need.split("|") for need in effect.needs) and not resting
    if resting:
        base = _with_stops(base)
    conditions = _conditions(base, moving)
    read = _moving_readings if moving else _readings_on_stops if resting else _resting_readings
    plain, changed = (read(base, d, i, conditions, one) for one in (AddedEffect(effect, effect.null()), added))
    shape = (distances, currents)
    return Signature(
        effect=effect,
        parameters=values,
        distance_m=distance,
        current_A=current,
        plain={name: value.reshape(shape) for name, value in plain.items()},
        change={name: (changed[name] - plain[name]).reshape(shape) for name in plain},
        conditions=(
            f"The body falls away at {_SPEED_M_S:g} m/s and the current rises by {np.ptp(current) / _SWING_S:.3g} A/s."
            if moving
            else "The body rests on stops at both ends of its travel."
            if resting
            else f"At rest, the current rising, the winding {_WARMER_C['coil_temperature_C']:.0f} K and a magnet "
            f"{_WARMER_C['magnet_temperature_C']:.0f} K warm, after {_READINGS:.0f} readings of a run."
        )
        + drawn,
    )


def _with_spring(base: ActuatorModel) -> ActuatorModel:
    """The model with a spring as stiff as its force falls over the range, for effects of a spring that is drawn."""
    motion = base.require_motion()
    weight = motion.mass_kg * abs(motion.gravity_m_s2)
    stroke = base.validity.distance_max_m - base.validity.distance_min_m
    spring = Spring(weight / stroke, weight, base.validity.distance_max_m)
    return replace(base, motion=replace(motion, springs=(spring,)))


def _with_stops(base: ActuatorModel) -> ActuatorModel:
    """The model with stops at both ends of its range, for effects of a stop that is drawn."""
    box = base.validity
    near, far = Stop(box.distance_min_m), Stop(box.distance_max_m)
    return replace(base, motion=replace(base.require_motion(), near_stop=near, far_stop=far))


def _readings_on_stops(
    base: ActuatorModel, d: FloatArray, i: FloatArray, conditions: Conditions, added: AddedEffect
) -> dict[str, FloatArray]:
    """The distance that is recorded on the stop that is nearer to each point."""
    near, far = base.require_motion().ends
    return recorded([added], {REST: np.where(d - near < far - d, near, far)}, d, i, conditions)


def typical_parameters(effect: Effect) -> dict[str, float]:
    """Parameters of a size that is met: every amplitude at three tenths of the further end of its plausible range."""
    return {p.name: p.null + _TYPICAL * (max(p.plausible, key=abs) - p.null) for p in effect.amplitudes}


def _conditions(base: ActuatorModel, moving: bool) -> Conditions:
    box = base.validity
    return Conditions(
        nominal_of(base),
        branch=1.0,
        coil_temperature_C=REFERENCE_TEMPERATURE_C + _WARMER_C["coil_temperature_C"],
        magnet_temperature_C=REFERENCE_TEMPERATURE_C + _WARMER_C["magnet_temperature_C"],
        time_s=_READINGS,
        elapsed=_READINGS,
        velocity_m_s=_SPEED_M_S if moving else 0.0,
        current_rate_A_s=(box.current_max_A - box.current_min_A) / _SWING_S if moving else 0.0,
        current_turn_A=(box.current_min_A, box.current_max_A),
    )


def _resting_readings(
    base: ActuatorModel, d: FloatArray, i: FloatArray, conditions: Conditions, added: AddedEffect
) -> dict[str, FloatArray]:
    """Readings at rest of a model with one effect."""
    return predict_readings(base, d, i, conditions, [added])


def _moving_readings(
    base: ActuatorModel, d: FloatArray, i: FloatArray, conditions: Conditions, added: AddedEffect
) -> dict[str, FloatArray]:
    """Force, acceleration, rate of the current at the voltage that the plain model needs, and Hall reading."""
    velocity, rate = np.full_like(d, _SPEED_M_S), np.full_like(d, float(conditions.current_rate_A_s))
    motional = base.magnetics.motional_constant(d, i[:, None])[:, 0] * velocity
    conditions = replace(conditions, motional_V=motional)
    memory = added.memory
    if memory is not None:
        states = _settled(memory, i, conditions, added.parameters)
        conditions = replace(conditions, memory=states)
    else:
        states = {}
    read = predict_readings(base, d, i, conditions, [added])
    result = {"force_N": read["force_N"]}
    if base.motion is not None and base.circuit is not None:
        voltage = base.circuit.resistance_ohm * i + base.inductance(d, i, extrapolate=True) * rate - motional
        changed = with_effects(base, [added])
        state = np.stack([d, velocity, i, *(states[name] for name in changed.memory_names)], axis=-1)
        slope = state_derivative(changed, state, voltage)
        result |= {"acceleration_m_s2": slope[:, 1], "current_rate_A_s": slope[:, 2]}
    return result | {name: read[name] for name in ("hall_V",) if name in read}


def _settled(memory: Memory, i: FloatArray, conditions: Conditions, p: Parameters) -> dict[str, FloatArray]:
    """States after a long time at a constant rate, each linear in itself: z' = b - a z = 0."""
    zero, one = ({name: np.full_like(i, value) for name in memory.names} for value in (0.0, 1.0))
    at_zero, at_one = (memory.rate(z, i, conditions, p) for z in (zero, one))
    return {name: at_zero[name] / (at_zero[name] - at_one[name]) for name in memory.names}
