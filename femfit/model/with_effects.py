"""A model with added effects: the base's parts, as the effects change them."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.effects.effect import AddedEffect, Coenergy, Conditions, Nominal, Parameters
from femfit.effects.jet import CoenergyJet, Jet
from femfit.model.actuator_model import ActuatorModel
from femfit.model.hall import HallField
from femfit.model.magnetics import Magnetics


def nominal_of(model: ActuatorModel) -> Nominal:
    """Facts of a base model by which effects scale their parameters.

    Parameters
    ----------
    model : ActuatorModel
        The base.

    Returns
    -------
    Nominal
        Largest force and flux linkage over 15 x 15 points of the validity box.
    """
    base = model.base or model
    box, nan = base.validity, float("nan")
    d, i = np.meshgrid(
        np.linspace(box.distance_min_m, box.distance_max_m, 15), np.linspace(box.current_min_A, box.current_max_A, 15)
    )
    force, flux = base.magnetics.coenergy_derivatives(d, i, ((1, 0), (0, 1)))
    sensor, swing, per_ampere = base.sensor, nan, nan
    middle = [np.array(0.5 * (low + high)) for low, high in ((d.min(), d.max()), (i.min(), i.max()))]
    if sensor is not None:
        swing = float(np.abs(sensor.voltage(d, i) - sensor.quiescent_V).max())
        per_ampere = float(sensor.field.derivatives(*middle)[2])
    clamp = (base.circuit.voltage_min_V, base.circuit.voltage_max_V) if base.circuit else (nan,)
    return Nominal(
        distance_min_m=box.distance_min_m,
        distance_max_m=box.distance_max_m,
        current_min_A=box.current_min_A,
        current_max_A=box.current_max_A,
        force_N=float(np.abs(force).max()),
        flux_linkage_Wb=float(np.abs(flux).max()),
        resistance_ohm=base.circuit.resistance_ohm if base.circuit else nan,
        mass_kg=base.motion.mass_kg if base.motion else nan,
        gravity_m_s2=base.motion.gravity_m_s2 if base.motion else nan,
        hall_sensitivity_V_per_T=sensor.sensitivity_V_per_T if sensor else nan,
        hall_quiescent_V=sensor.quiescent_V if sensor else nan,
        hall_min_V=sensor.output_min_V if sensor else nan,
        hall_max_V=sensor.output_max_V if sensor else nan,
        inductance_H=float(base.magnetics.inductance(*middle)),
        hall_T_per_A=per_ampere,
        hall_swing_V=swing,
        voltage_V=max(abs(v) for v in clamp),
    )


def base_jet(model: ActuatorModel) -> CoenergyJet:
    """The base model's co-energy and Hall field as a series.

    Parameters
    ----------
    model : ActuatorModel
        Of which the base counts.

    Returns
    -------
    callable
        (distances, currents, A, B) -> :class:`femfit.effects.jet.Jet`.
    """
    base = model.base or model

    def evaluate(distance: FloatArray, current: FloatArray, in_distance: int, in_current: int) -> Jet:
        orders = tuple((a, b) for a in range(in_distance + 1) for b in range(in_current + 1))
        factorials = np.cumprod(np.maximum(np.arange(max(in_distance, in_current) + 1.0), 1.0))
        result = np.zeros((2, in_distance + 1, in_current + 1, len(distance)))
        field = base.sensor.field.partials(distance, current, orders) if base.sensor else None
        for k, ((a, b), value) in enumerate(
            zip(orders, base.magnetics.coenergy_derivatives(distance, current, orders), strict=True)
        ):
            result[0, a, b] = value / (factorials[a] * factorials[b])
            if field is not None:
                result[1, a, b] = field[k] / (factorials[a] * factorials[b])
        return Jet(result)

    return evaluate


def changed_jet(inner: CoenergyJet, effects: Iterable[AddedEffect], at: Conditions) -> CoenergyJet:
    """The co-energy as effects change it, the first named innermost.

    Parameters
    ----------
    inner : callable
        The base's.
    effects : iterable of AddedEffect
        Those without a ``coenergy`` are passed over.
    at : Conditions
        Of the points.

    Returns
    -------
    callable
        As ``inner``.
    """
    for added in effects:
        if added.effect.coenergy is not None:
            inner = _wrapped(inner, added.effect.coenergy, added.parameters, at)
    return inner


def _wrapped(inner: CoenergyJet, act: Coenergy, parameters: Parameters, at: Conditions) -> CoenergyJet:
    def evaluate(distance: FloatArray, current: FloatArray, in_distance: int, in_current: int) -> Jet:
        return act(inner, distance, current, in_distance, in_current, at, parameters)

    return evaluate


@dataclass(frozen=True, eq=False)
class EffectMagnetics(Magnetics):
    """The co-energy of a base model as effects change it, under fixed conditions.

    Parameters
    ----------
    jet : callable
        As from :func:`changed_jet`.
    """

    jet: CoenergyJet

    def _derivatives(
        self, distance: FloatArray, current: FloatArray, orders: tuple[tuple[int, int], ...]
    ) -> list[FloatArray]:
        series = self.jet(distance, current, max(a for a, _ in orders), max(b for _, b in orders))
        return [series.derivative(a, b) for a, b in orders]


@dataclass(frozen=True, eq=False)
class EffectHallField(HallField):
    """The field at the Hall element as effects change it, under fixed conditions.

    Parameters
    ----------
    jet : callable
        As from :func:`changed_jet`.
    """

    jet: CoenergyJet

    def _partials(
        self, distance: FloatArray, current: FloatArray, orders: tuple[tuple[int, int], ...]
    ) -> list[FloatArray]:
        series = self.jet(distance, current, max(a for a, _ in orders), max(b for _, b in orders))
        return [series.derivative(a, b, 1) for a, b in orders]


def with_effects(model: ActuatorModel, effects: Iterable[AddedEffect]) -> ActuatorModel:
    """A model with effects in place of those that it has.

    Parameters
    ----------
    model : ActuatorModel
        Of which the base counts.
    effects : iterable of AddedEffect
        In the order of adding; empty for the base itself.

    Returns
    -------
    ActuatorModel
        Magnetics, circuit, motion and sensor as the effects change them at the model's temperatures.
    """
    effects, base = tuple(effects), model.base or model
    if not effects:
        return base
    at = Conditions(
        nominal_of(base), coil_temperature_C=model.coil_temperature_C, magnet_temperature_C=model.magnet_temperature_C
    )
    jet = changed_jet(base_jet(base), effects, at)
    changed = any(added.effect.coenergy for added in effects)
    circuit, motion, sensor = base.circuit, base.motion, base.sensor
    for added in effects:
        if circuit and added.effect.circuit:
            resistance = added.effect.circuit(
                np.array([circuit.resistance_ohm]), np.zeros(1), np.zeros(1), at, added.parameters
            )[0]
            circuit = replace(circuit, resistance_ohm=float(resistance[0]))
        if motion and added.effect.mass:
            motion = replace(motion, mass_kg=added.effect.mass(motion.mass_kg, added.parameters))
    return replace(
        base,
        magnetics=EffectMagnetics(jet) if changed else base.magnetics,
        circuit=circuit,
        motion=motion,
        sensor=replace(sensor, field=EffectHallField(jet)) if sensor and changed else sensor,
        effects=effects,
        base=base,
        coil_temperature_C=model.coil_temperature_C,
        magnet_temperature_C=model.magnet_temperature_C,
    )
