"""A model with added effects: the base's parts, as the effects change them.

Of several circuits a number of turns scales its circuit's current in W' and, as a derivative of the one W', the flux
linkage with it. Where nothing saturates W' is a quadratic form of (1, i_1 .. i_n), and a remanence scales the 1.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from femfit.core.errors import DomainError, MissingPartError
from femfit.core.numerics import FloatArray
from femfit.device.electrics import Circuit
from femfit.effects.catalogue import OF_THE_WHOLE, source_scales
from femfit.effects.conditions import NO_MAGNET, Conditions, Nominal
from femfit.effects.effect import AddedEffect, Effect
from femfit.effects.stages import changed_coenergy, circuit_of, moving_mass, stops_of
from femfit.effects.taylor_series import CoenergySeries, TaylorSeries
from femfit.model.actuator_model import ActuatorModel
from femfit.model.coenergy_table import CoenergyTable, ModelCoenergy
from femfit.model.eddy_currents import EddyCurrents
from femfit.model.effect_dynamics import EffectDynamics
from femfit.model.hall import OneCurrentField
from femfit.model.magnetics import Magnetics, OneCurrentMagnetics, Orders
from femfit.model.sensed_effects import hall_as_read, hall_with_effects, pickups_with_effects
from femfit.model.several_magnetics import CoenergyMatrix, CoenergyTensor


def nominal_of(model: ActuatorModel) -> Nominal:
    """Facts of a base model by which effects scale their parameters."""
    base = model.without_effects
    domain, nan = base.validity, float("nan")
    d, i = domain.grid(15, 15, several=5)
    force, flux = base.magnetics.force(d, i), base.magnetics.flux_linkage(d, i)
    largest = [float(np.abs(values).max(initial=0.0)) for values in (force, flux)]
    limits = domain.current_limits_A if len(domain.current_limits_A) else np.zeros((1, 2))
    middle = np.array(0.5 * (d.min() + d.max())), domain.current_limits_A.mean(axis=1)
    inductance = base.magnetics.inductance(*middle)
    circuit, sensor, swing, per_ampere = next(iter(base.circuits), None), base.sensor, nan, nan
    if sensor is not None:
        swing = float(np.abs(sensor.output(d, i) - sensor.quiescent_V).max())
        per_ampere = float(sensor.field.derivatives(*middle)[2][:1].sum())
    clamp = (circuit.voltage_min_V, circuit.voltage_max_V) if circuit else (nan,)
    return Nominal(
        distance_min_m=domain.distance_min_m,
        distance_max_m=domain.distance_max_m,
        current_min_A=float(limits[:, 0].min()),
        current_max_A=float(limits[:, 1].max()),
        force_N=largest[0],
        flux_linkage_Wb=largest[1],
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
        circuits=base.circuit_names if len(limits) > 1 else (),
        magnets_apart=not isinstance(base.magnetics, CoenergyTensor),
        drawn=tuple(one.effect for one in base.drawn),
        has_iron=base.kind is None or base.kind.fixed_iron or base.kind.moving_iron,
    )


def base_coenergy(model: ActuatorModel) -> ModelCoenergy:
    """The base model's co-energy and Hall field as a series.

    Returns
    -------
    callable
        (distances, currents, A, B) -> :class:`femfit.effects.taylor_series.TaylorSeries`.
    """
    base = model.without_effects
    return ModelCoenergy(base.magnetics, base.sensor.field if base.sensor else None)


@dataclass(frozen=True, eq=False)
class EffectMagnetics(OneCurrentMagnetics):
    """The co-energy of a base model as effects change it, under fixed conditions."""

    series: CoenergySeries

    def _derivatives(self, distance: FloatArray, current: FloatArray, orders: Orders) -> list[FloatArray]:
        expansion = self.series(distance, current, max(a for a, _ in orders), max(b for _, b in orders))
        return [expansion.derivative(a, b) for a, b in orders]


@dataclass(frozen=True, eq=False)
class EffectHallField(OneCurrentField):
    """The field that a Hall element at rest seems to show, as effects on field and reading change it."""

    dynamics: EffectDynamics
    # Quiescent voltage and sensitivity, by which a reading is converted to a field
    quiescent_V: float
    sensitivity_V_per_T: float

    def _partials(self, distance: FloatArray, current: FloatArray, orders: Orders) -> list[FloatArray]:
        series = changed_coenergy(self.dynamics.hall_coenergy, self.dynamics.later, self.dynamics.at)(
            distance, current, max(a for a, _ in orders), max(b for _, b in orders)
        )
        if not any(added.effect.readings for added in self.dynamics.effects):
            return [series.derivative(a, b, 1) for a, b in orders]
        return [self._of_reading(series, distance, current, order) for order in orders]

    def _of_reading(
        self, series: TaylorSeries, distance: FloatArray, current: FloatArray, order: tuple[int, int]
    ) -> FloatArray:
        """The reading, or its first derivative by the chain rule with a central difference of the sensor alone."""
        field = series.derivative(0, 0, 1)
        if order == (0, 0):
            return self._apparent(field, distance, current)
        if sum(order) > 1:
            raise DomainError(
                "A Hall reading under effects has no derivatives of second order; use those of its field."
            )
        slope, steps = series.derivative(*order, 1), (1e-6 * order[0], 1e-5 * order[1])
        scale = max(steps)
        ends = [
            self._apparent(field + s * scale * slope, distance + s * steps[0], current + s * steps[1])
            for s in (1.0, -1.0)
        ]
        return np.asarray((ends[0] - ends[1]) / (2.0 * scale))

    def _apparent(self, field: FloatArray, distance: FloatArray, current: FloatArray) -> FloatArray:
        volts = self.quiescent_V + self.sensitivity_V_per_T * field
        read = self.dynamics.read(volts, distance, current, self.dynamics.at)
        return np.asarray((read - self.quiescent_V) / self.sensitivity_V_per_T)


def with_effects(model: ActuatorModel, effects: Iterable[AddedEffect]) -> ActuatorModel:
    """A model with effects in place of those that it has."""
    effects, base = tuple(effects), model.without_effects
    if not effects:
        return base
    at = Conditions(
        nominal_of(base),
        coil_temperature_C=model.coil_temperature_C,
        magnet_temperature_C=model.magnet_temperature_C,
        running=True,
    )
    motion = base.motion
    if motion is not None:
        near, far = stops_of(effects, motion.ends, at.nominal)
        motion = replace(motion.with_ends(near, far), mass_kg=moving_mass(effects, motion.mass_kg))
    ohms = [float(resistance_of(circuit, effects, np.zeros(1), at)[0]) for circuit in base.circuits]
    changed = replace(
        base,
        circuits=tuple(replace(one, resistance_ohm=r) for one, r in zip(base.circuits, ohms, strict=True)),
        motion=motion,
        other_sensors=pickups_with_effects(base.other_sensors, effects, base.circuit_names),
        eddy=eddy_with_sources(base, effects),
        effects=effects,
        base=base,
        conditions=at,
        coil_temperature_C=model.coil_temperature_C,
        magnet_temperature_C=model.magnet_temperature_C,
    )
    if at.nominal.circuits:
        _require_of_circuits(base, effects)
        sensor = hall_as_read(hall_with_effects(base.sensor, effects, base.circuit_names), effects, at)
        return replace(changed, magnetics=with_sources(base, effects), sensor=sensor)
    return _at_work(changed, base, at)


def _at_work(changed: ActuatorModel, base: ActuatorModel, at: Conditions) -> ActuatorModel:
    """The model of one current with what its effects make of co-energy and Hall field, and at work in motion."""
    effects, coenergy = changed.effects, base_coenergy(base)
    acting = tuple(added for added in effects if added.effect.coenergy is not None)
    static = tuple(added for added in acting if added.memory is None)
    hall_coenergy = changed_coenergy(coenergy, static, at)
    moving = changed_coenergy(ModelCoenergy(coenergy.magnetics, None), static, at)
    dynamics = EffectDynamics(
        motion_coenergy=CoenergyTable(moving, at.nominal, hall=False) if static else moving,
        hall_coenergy=CoenergyTable(hall_coenergy, at.nominal, hall=True) if acting else hall_coenergy,
        effects=effects,
        later=tuple(added for added in acting if added.memory is not None),
        at=at,
        resistance_ohm=base.circuit.resistance_ohm if base.circuit else float("nan"),
        series_H=base.circuit.inductance_H if base.circuit else 0.0,
        eddy=changed.eddy,
    )
    magnetics, sensor = base.magnetics, base.sensor
    if acting:
        magnetics = EffectMagnetics(changed_coenergy(dynamics.motion_coenergy, dynamics.later, at))
    if sensor is not None and (acting or any(added.effect.readings for added in effects)):
        field = EffectHallField(dynamics, sensor.quiescent_V, sensor.sensitivity_V_per_T)
        sensor = replace(sensor, field=field)
    return replace(changed, magnetics=magnetics, sensor=sensor, dynamics=dynamics)


def _require_of_circuits(base: ActuatorModel, effects: tuple[AddedEffect, ...]) -> None:
    """Refuse effects that are written for one current."""
    unknown = [added.effect.name for added in effects if not _of_circuits(added.effect)]
    unseen = [one.key for one in base.drawn if one.at_rest and one.key in unknown]
    if unseen:
        raise MissingPartError(
            f"{', '.join(unseen)} changes force and flux linkage as well as impedances, which model {base.name!r} of "
            "several circuits does not take up. femfit calibrate finds the number and writes the drawing, to be swept."
        )
    if unknown:
        raise MissingPartError(
            f"The effects {', '.join(unknown)} are of a device with one circuit; model {base.name!r} has "
            f"{len(base.circuits)}. Take them out of its file."
        )


def _of_circuits(effect: Effect) -> bool:
    """Whether an effect is one that several circuits can have: theirs, the device's, or of the eddy currents alone."""
    of_eddies = effect.coenergy is None and (effect.impedance is not None or effect.eddy is not None)
    return bool(effect.of) or effect.name in OF_THE_WHOLE or of_eddies


def with_sources(base: ActuatorModel, effects: Sequence[AddedEffect]) -> Magnetics:
    """The co-energy of several circuits as effects scale magnets and turns: W'(d, s_1 i_1 .. s_n i_n)."""
    magnetics = base.magnetics
    assert isinstance(magnetics, CoenergyMatrix | CoenergyTensor)  # noqa: S101  there are no others of several circuits
    scales = np.array(source_scales(effects, magnetics.names))
    if isinstance(magnetics, CoenergyMatrix):
        first, second = np.triu_indices(len(scales))
        return replace(magnetics, coefficients=magnetics.coefficients * (scales[first] * scales[second]))
    if scales[0] != 1.0:
        raise MissingPartError(
            f"A remanence scales the magnets' part of a co-energy; in that of model {base.name!r}, whose iron "
            "saturates, it does not stand apart. Take remanence out of the model's effects."
        )
    knots = tuple(one / scale for one, scale in zip(magnetics.current_knots_A, scales[1:], strict=True))
    return replace(magnetics, current_knots_A=knots)


def eddy_with_sources(base: ActuatorModel, effects: Sequence[AddedEffect]) -> EddyCurrents | None:
    """The eddy currents of a base model beside magnets, turns and conductivities that effects scale."""
    if base.eddy is None:
        return None
    magnets, *currents = source_scales(effects, base.eddy.circuits)
    found = base.eddy
    if any(scale != 1.0 for scale in (magnets, *currents)):
        found = found.scaled(magnets, np.array(currents))
    for one in effects:
        if one.effect.eddy is not None:
            found = replace(found, resistances_ohm=found.resistances_ohm * one.effect.eddy(one.parameters))
    return found


def resistance_of(
    circuit: Circuit, effects: Iterable[AddedEffect], current: FloatArray, conditions: Conditions
) -> FloatArray:
    """Resistance in ohm of a circuit at its currents, as its own effects change it."""
    own = [added for added in effects if added.effect.of in ("", circuit.name)]
    ohms, _ = circuit_of(
        own, np.full_like(current, circuit.resistance_ohm), np.zeros_like(current), current, conditions
    )
    return ohms
