"""A model with added effects: the base's parts, as the effects change them."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.core.errors import DomainError
from femfit.effects.conditions import NO_MAGNET, Conditions, Nominal
from femfit.effects.effect import AddedEffect
from femfit.effects.stages import changed_coenergy, circuit_of, moving_mass, stops_of
from femfit.effects.taylor_series import CoenergySeries, TaylorSeries
from femfit.model.actuator_model import ActuatorModel
from femfit.model.coenergy_series import ModelCoenergy
from femfit.model.coenergy_table import CoenergyTable
from femfit.model.effect_dynamics import EffectDynamics
from femfit.model.hall import HallField
from femfit.model.hall_sensor import HallSensor
from femfit.model.magnetics import Magnetics


def nominal_of(model: ActuatorModel) -> Nominal:
    """Facts of a base model by which effects scale their parameters."""
    base = model.without_effects
    domain, nan = base.validity, float("nan")
    d, i = np.meshgrid(
        np.linspace(domain.distance_min_m, domain.distance_max_m, 15),
        np.linspace(domain.current_min_A, domain.current_max_A, 15),
    )
    force, flux = base.magnetics.coenergy_derivatives(d, i, ((1, 0), (0, 1)))
    largest = [float(np.abs(values).max()) for values in (force, flux)]
    sensor, swing, per_ampere = base.sensor, nan, nan
    middle = [np.array(0.5 * (low + high)) for low, high in ((d.min(), d.max()), (i.min(), i.max()))]
    if sensor is not None:
        swing = float(np.abs(sensor.voltage(d, i) - sensor.quiescent_V).max())
        per_ampere = float(sensor.field.derivatives(*middle)[2])
    clamp = (base.circuit.voltage_min_V, base.circuit.voltage_max_V) if base.circuit else (nan,)
    return Nominal(
        distance_min_m=domain.distance_min_m,
        distance_max_m=domain.distance_max_m,
        current_min_A=domain.current_min_A,
        current_max_A=domain.current_max_A,
        force_N=largest[0],
        flux_linkage_Wb=largest[1],
        magnet_share=max(base.share_without_current(), NO_MAGNET) if base.has_magnet else 0.0,
        magnet_drawn=base.kind is not None,
        magnet_known=base.magnet_known,
        resistance_ohm=base.circuit.resistance_ohm if base.circuit else nan,
        mass_kg=base.motion.mass_kg if base.motion else nan,
        gravity_m_s2=base.motion.gravity_m_s2 if base.motion else nan,
        hall_quiescent_V=sensor.quiescent_V if sensor else nan,
        inductance_H=float(base.magnetics.inductance(*middle)),
        hall_T_per_A=per_ampere,
        hall_swing_V=swing,
        voltage_V=max(abs(v) for v in clamp),
        sample_time_s=base.sample_time_s,
        stops_m=base.motion.ends if base.motion is not None else (-np.inf, np.inf),
        springs=base.motion.push_of_springs if base.motion is not None and base.motion.springs else None,
        has_iron=base.kind is None or base.kind.fixed_iron or base.kind.moving_iron,
    )


def base_coenergy(model: ActuatorModel) -> CoenergySeries:
    """The base model's co-energy and Hall field as a series.

    Returns
    -------
    callable
        (distances, currents, A, B) -> :class:`femfit.effects.taylor_series.TaylorSeries`.
    """
    base = model.without_effects
    return ModelCoenergy(base.magnetics, base.sensor.field if base.sensor else None)


@dataclass(frozen=True, eq=False)
class EffectMagnetics(Magnetics):
    """The co-energy of a base model as effects change it, under fixed conditions."""

    series: CoenergySeries

    def _derivatives(
        self, distance: FloatArray, current: FloatArray, orders: tuple[tuple[int, int], ...]
    ) -> list[FloatArray]:
        expansion = self.series(distance, current, max(a for a, _ in orders), max(b for _, b in orders))
        return [expansion.derivative(a, b) for a, b in orders]


@dataclass(frozen=True, eq=False)
class EffectHallField(HallField):
    """The field that a Hall element at rest seems to show, as effects on field and reading change it."""

    dynamics: EffectDynamics
    # Quiescent voltage and sensitivity, by which a reading is converted to a field
    quiescent_V: float
    sensitivity_V_per_T: float

    def _partials(
        self, distance: FloatArray, current: FloatArray, orders: tuple[tuple[int, int], ...]
    ) -> list[FloatArray]:
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
    acting = tuple(added for added in effects if added.effect.coenergy is not None)
    static = tuple(added for added in acting if added.memory is None)
    read = acting or any(added.effect.readings for added in effects)
    hall_coenergy = changed_coenergy(base_coenergy(base), static, at)
    dynamics = EffectDynamics(
        motion_coenergy=CoenergyTable(
            changed_coenergy(ModelCoenergy(base.magnetics, None), static, at), at.nominal, hall=False
        ),
        hall_coenergy=CoenergyTable(hall_coenergy, at.nominal, hall=True) if acting else hall_coenergy,
        effects=effects,
        later=tuple(added for added in acting if added.memory is not None),
        at=at,
        resistance_ohm=base.circuit.resistance_ohm if base.circuit else float("nan"),
        series_H=base.circuit.inductance_H if base.circuit else 0.0,
    )
    changed = bool(acting) or dynamics.drives  # quicker from the table, even where the effects leave it alone
    circuit, motion, sensor = base.circuit, base.motion, base.sensor
    if circuit is not None:
        ohms = circuit_of(effects, np.array([circuit.resistance_ohm]), np.zeros(1), np.zeros(1), at)[0]
        circuit = replace(circuit, resistance_ohm=float(ohms[0]))
    if motion is not None:
        near, far = stops_of(effects, motion.ends, at.nominal)
        motion = replace(
            motion.with_ends(near, far),
            mass_kg=moving_mass(effects, motion.mass_kg),
        )
    return replace(
        base,
        magnetics=EffectMagnetics(changed_coenergy(dynamics.motion_coenergy, dynamics.later, at))
        if changed
        else base.magnetics,
        circuit=circuit,
        motion=motion,
        sensor=_seen_by(sensor, dynamics) if sensor and read else sensor,
        effects=effects,
        base=base,
        dynamics=dynamics,
        coil_temperature_C=model.coil_temperature_C,
        magnet_temperature_C=model.magnet_temperature_C,
    )


def _seen_by(sensor: HallSensor, dynamics: EffectDynamics) -> HallSensor:
    return replace(sensor, field=EffectHallField(dynamics, sensor.quiescent_V, sensor.sensitivity_V_per_T))
