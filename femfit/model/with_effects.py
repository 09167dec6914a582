"""A model with added effects: the base's parts, as the effects change them.

An effect on a recorded channel says which distance and current body and winding have where these were recorded; a
sensor of a model reads what is recorded, so that it undoes the same effects.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from casadi import SX

from femfit.core.errors import MissingPartError, UsageError
from femfit.core.graph import Expression, slope
from femfit.core.numerics import FloatArray
from femfit.device.electrics import Circuit
from femfit.effects.catalogue import of_any_device, source_scales
from femfit.effects.conditions import NO_MAGNET, TEMPERATURES, Conditions, Nominal
from femfit.effects.effect import AddedEffect, Coenergy
from femfit.effects.stages import changed_by, changed_coenergy, circuit_of, recorded, true_setting
from femfit.model.eddy_currents import EddyCurrents, EddyForms
from femfit.model.hall import HallField
from femfit.model.magnetics import Magnetics
from femfit.model.several_magnetics import CoenergyTensor

if TYPE_CHECKING:
    from femfit.model.actuator_model import ActuatorModel


def nominal_of(model: "ActuatorModel") -> Nominal:
    """Facts of a base model by which effects scale their parameters."""
    base = model.without_effects
    domain, nan = base.validity, float("nan")
    d, i = domain.grid(15, 15, several=5)
    limits = domain.current_limits_A if len(domain.current_limits_A) else np.zeros((1, 2))
    middle = np.array(0.5 * (d.min() + d.max())), domain.current_limits_A.mean(axis=1)
    inductance = base.magnetics.inductance(*middle)
    circuit, sensor, swing, per_ampere = next(iter(base.circuits), None), base.sensor, nan, nan
    if sensor is not None:
        swing = float(np.abs(sensor.output(d, i) - sensor.quiescent_V).max())
        per_ampere = float(sensor.field.derivatives(*middle)[2][:1].sum())
    clamp = (circuit.voltage_min_V, circuit.voltage_max_V) if circuit else (nan,)
    if circuit and not np.isfinite(clamp).all():
        clamp = (circuit.resistance_ohm * float(np.abs(limits).max()),)
    return Nominal(
        distance_min_m=domain.distance_min_m,
        distance_max_m=domain.distance_max_m,
        current_min_A=float(limits[:, 0].min()),
        current_max_A=float(limits[:, 1].max()),
        force_N=base.peaks[0],
        flux_linkage_Wb=base.peaks[1],
        magnet_share=max(base.share_without_current(), NO_MAGNET) if base.has_magnet else 0.0,
        magnet_drawn=base.kind is not None,
        magnet_known=base.magnet_known,
        resistance_ohm=circuit.resistance_ohm if circuit else nan,
        mass_kg=base.motion.mass_kg if base.motion else nan,
        gravity_m_s2=base.motion.gravity_m_s2 if base.motion else nan,
        hall_quiescent_V=sensor.quiescent_V if sensor else nan,
        inductance_H=float(inductance[:1, :1].sum()),
        hall_T_per_A=per_ampere,
        hall_swing_V=swing,
        voltage_V=max(abs(v) for v in clamp),
        sample_time_s=base.sample_time_s,
        voltage_driver=circuit is None or circuit.drive.kind == "voltage",
        stops_m=base.motion.ends if base.motion is not None else (-np.inf, np.inf),
        springs=base.motion.energy_of_springs if base.motion is not None and base.motion.springs else None,
        push_of_springs=base.motion.push_of_springs if base.motion is not None else np.zeros_like,
        circuits=base.circuit_names if len(limits) > 1 else (),
        magnets_apart=not isinstance(base.magnetics, CoenergyTensor),
        drawn=tuple(added.effect for added in base.drawn),
        has_iron=base.kind is None or base.kind.fixed_iron or base.kind.moving_iron,
    )


def coenergy_of(model: "ActuatorModel") -> Coenergy:
    """W'(d, i, h) of a model's magnetics and of the field at its Hall element, without effects."""
    base = model.without_effects
    field = None if base.sensor is None else base.sensor.field

    def coenergy(d: Expression, i: Expression, h: Expression) -> Expression:
        point = SX(d), SX(i)
        value = base.magnetics.expression(*point)
        return value if field is None else value + h * field.expression(*point)

    return coenergy


@dataclass(frozen=True, eq=False)
class EffectMagnetics(Magnetics):
    """The co-energy of a base model as effects change it, under fixed conditions."""

    base: "ActuatorModel"
    effects: tuple[AddedEffect, ...]
    conditions: Conditions

    def changed(self, memory: Mapping[str, SX]) -> Coenergy:
        """W'(d, i, h) where the states of effects are these."""
        conditions = replace(self.conditions, memory=memory)
        return changed_coenergy(coenergy_of(self.base), self.effects, conditions)

    def with_memory(self, memory: Mapping[str, SX]) -> Callable[[SX, SX], SX]:
        """W' of an expression's distance and currents where the states of effects are these."""
        coenergy = self.changed(memory)
        return lambda d, i: SX(coenergy(d, i, 0.0))

    def expression(self, distance: SX, currents: SX) -> SX:
        """W' of an expression's distance and currents, all states at rest."""
        return self.with_memory({})(distance, currents)


@dataclass(frozen=True, eq=False)
class EffectHallField(HallField):
    """The field that a Hall element at rest seems to show, as effects on field and reading change it."""

    magnetics: EffectMagnetics

    def with_memory(self, memory: Mapping[str, SX]) -> Callable[[SX, SX], SX]:
        """The field itself, dW'/dh."""
        coenergy = self.magnetics.changed(memory)
        return lambda d, i: slope(lambda h: coenergy(d, i, h), 0.0)

    def expression(self, distance: SX, currents: SX) -> SX:
        """B_z of an expression's distance and currents."""
        sensor, magnetics = self.magnetics.base.require_sensor(), self.magnetics
        volts = sensor.quiescent_V + sensor.sensitivity_V_per_T * self.with_memory({})(distance, currents)
        first = currents[0] if currents.numel() else SX(0.0)
        read = recorded(magnetics.effects, {"hall_V": volts}, distance, first, magnetics.conditions)["hall_V"]
        return (read - sensor.quiescent_V) / sensor.sensitivity_V_per_T


def with_effects(model: "ActuatorModel", effects: Iterable[AddedEffect]) -> "ActuatorModel":
    """A model with effects in place of those that it has."""
    effects, base = tuple(effects), model.without_effects
    if not effects:
        return base
    _require_known(base, effects)
    temperatures = {name: getattr(model, name) for name in TEMPERATURES}
    conditions = Conditions(nominal_of(base), **temperatures, running=True)
    motion = base.motion
    if motion is not None:
        near, far = changed_by(effects, "ends", motion.ends, conditions.nominal)
        motion = replace(motion.with_ends(near, far), mass_kg=changed_by(effects, "mass", motion.mass_kg))
    ohms = [float(resistance_of(circuit, effects, np.zeros(1), conditions)[0]) for circuit in base.circuits]
    magnetics, sensor = EffectMagnetics(base, effects, conditions), base.sensor
    magnetic = any(added.effect.coenergy is not None for added in effects)
    if sensor is not None and (magnetic or any(added.effect.readings for added in effects)):
        sensor = replace(sensor, field=EffectHallField(magnetics))
    return replace(
        base,
        magnetics=magnetics if magnetic else base.magnetics,
        circuits=tuple(replace(circuit, resistance_ohm=r) for circuit, r in zip(base.circuits, ohms, strict=True)),
        motion=motion,
        sensor=sensor,
        eddy=eddy_with_sources(base, effects),
        effects=effects,
        base=base,
        conditions=conditions,
        **temperatures,
    )


def with_parts(model: "ActuatorModel", **parts: Any) -> "ActuatorModel":
    """A model with other parts of its base, on which its effects act."""
    temperatures = {name: getattr(model, name) for name in TEMPERATURES}
    return with_effects(replace(model.without_effects, **(temperatures | parts)), model.effects)


def _require_known(base: "ActuatorModel", effects: tuple[AddedEffect, ...]) -> None:
    """Refuse an effect twice, those of no circuit or written for one current, and magnets that do not stand apart."""
    names, circuits = [added.effect.name for added in effects], base.current_names
    if twice := {name for name in names if names.count(name) > 1}:
        raise UsageError(
            f"An effect must act once; instead received {', '.join(sorted(twice))} twice. Give it its parameters once."
        )
    several = circuits if len(circuits) > 1 else ()
    if strange := [added.effect.name for added in effects if added.effect.of and added.effect.of not in several]:
        raise MissingPartError(
            f"Effects must be of circuits of model {base.name!r}, which has {', '.join(circuits) or 'none'}; instead "
            f"received {', '.join(strange)}. {'Name one of them' if several else 'Leave the name of a circuit out'}."
        )
    if isinstance(base.magnetics, CoenergyTensor) and "remanence" in names:
        raise MissingPartError(
            f"A remanence scales the magnets' part of a co-energy; in that of model {base.name!r}, whose iron "
            "saturates, it does not stand apart. Take remanence out of the model's effects."
        )
    if several and (unknown := [added.effect.name for added in effects if not of_any_device(added.effect)]):
        raise MissingPartError(
            f"Effects of the current of one circuit can be no part of model {base.name!r}, which has "
            f"{len(base.circuits)}: {', '.join(unknown)}. Take them out of its effects."
        )


def eddy_with_sources(base: "ActuatorModel", effects: Sequence[AddedEffect]) -> EddyCurrents | None:
    """The eddy currents of a base model beside magnets, turns and conductivities that effects scale."""
    if base.eddy is None:
        return None
    (magnets, *currents), eddy = source_scales(effects, base.eddy.circuits), base.eddy
    if any(scale != 1.0 for scale in (magnets, *currents)):
        eddy = eddy.scaled(magnets, np.array(currents))
    factor = changed_by(effects, "eddy", 1.0)
    # Itself where nothing changes it: what was made of its splines stays
    return eddy if factor == 1.0 else replace(eddy, resistances_ohm=factor * eddy.resistances_ohm)


def patterns_with_sources(base: "ActuatorModel", effects: Sequence[AddedEffect], distance: SX) -> EddyForms | None:
    """The patterns of :func:`eddy_with_sources` at an expression's distance, parameters being expressions as well."""
    if base.eddy is None:
        return None
    factor = changed_by(effects, "eddy", 1.0)
    return base.eddy.patterns(distance, source_scales(effects, base.eddy.circuits)[1:], factor)


def resistance_of(
    circuit: Circuit, effects: Iterable[AddedEffect], current: Expression, conditions: Conditions
) -> Expression:
    """Resistance in ohm of a circuit at its current, as its own effects change it."""
    acting, none = [added for added in effects if added.effect.of in ("", circuit.name)], 0.0 * current
    return circuit_of(acting, circuit.resistance_ohm + none, none, current, conditions)[0]


def true_setting_of(
    model: "ActuatorModel", distance: FloatArray, currents: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Distance (...) and currents (..., n) that body and windings have where these were recorded, at rest."""
    if model.conditions is None:
        return distance, currents
    return true_setting(model.effects, distance, currents, model.conditions)
