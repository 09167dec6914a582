"""The catalogue of effects: one tuple.

The effects of a device of several circuits: some are of one circuit each, some of the whole device.

What is of a circuit is named after both, as ``current_gain:lower``, and changes that circuit's current, turns or
resistance alone. What acts on no current any model may have, though a device of several circuits is not asked for it.

All others are written for one circuit: iron, lags, misalignment and outer fields take its current for the core's (as
``core_saturation``), temperatures follow its winding's, drivers, supply and ``motional_emf`` are of that, and
``side_pull_friction``, ``hall_coil_pickup``, ``sensor_delay`` and ``flux_integrator_drift`` see its current or flux.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import cache
from typing import cast

from femfit.core.public import require_known
from femfit.effects import circuit, friction, hall, hysteresis, iron, lags, magnet, springs, zeros_and_scales
from femfit.effects.effect import AddedEffect, Effect

SEPARATOR = ":"

OF_EACH = ("turns", "resistance", "current_offset", "current_gain")

OF_THE_WHOLE = (
    "distance_offset",
    "remanence",
    "force_offset",
    "force_gain",
    "mass_error",
    "distance_scale",
    "spring_in_force",
    "stop_position",
    "position_delay",
    "position_nonlinearity",
    "hall_offset",
    "hall_temperature",
    "hall_drift",
    "hall_saturation",
)

OF_A_CIRCUIT = ("current_A", "voltage_V", "flux_linkage_Wb", "inductance_H", "resistance_ohm")
"""Columns that each circuit has one of its own of."""


def of_circuit(effect: Effect, circuit: str) -> Effect:
    """An effect of :data:`OF_EACH` as that of one circuit."""
    calibrations = tuple(
        replace(
            each,
            instruction=f"{each.instruction} (Circuit {circuit}.)",
            also={f"{name}{SEPARATOR}{circuit}" if name in OF_EACH else name: v for name, v in each.also.items()},
        )
        for each in effect.calibrations
    )
    needs = effect.needs
    for quantity in OF_A_CIRCUIT:  # the columns are the circuit's own
        stem, _, unit = quantity.rpartition("_")
        needs = tuple(need.replace(quantity, f"{stem}_{circuit}_{unit}") for need in needs)
    return replace(
        effect,
        name=f"{effect.name}{SEPARATOR}{circuit}",
        of=circuit,
        symptom=f"{effect.symptom} This in circuit {circuit}.",
        parameters=tuple(replace(p, words=p.words and f"{p.words} in circuit {circuit}") for p in effect.parameters),
        needs=needs,
        experiment=f"{effect.experiment} (Circuit {circuit}.)",
        calibrations=calibrations,
    )


def source_scales(effects: Iterable[AddedEffect], circuits: Sequence[str]) -> list[float]:
    """What multiplies the magnets and each circuit's current where they make the field; 1 + n numbers.

    Turns that are of no circuit by name are the only one's.
    """
    scales = dict.fromkeys(("", *circuits), 1.0)
    for added in effects:
        if added.effect.name == "remanence":
            scales[""] *= 1.0 + added.parameters["remanence_error"]
        elif circuits and added.effect.name.partition(SEPARATOR)[0] == "turns":
            scales[added.effect.of or circuits[0]] *= 1.0 + added.parameters["turns_error"]
    return list(scales.values())


BUILT_IN: tuple[Effect, ...] = (
    zeros_and_scales.DISTANCE_OFFSET,
    circuit.REMANENCE,
    circuit.TURNS,
    circuit.RESISTANCE,
    zeros_and_scales.FORCE_OFFSET,
    zeros_and_scales.FORCE_GAIN,
    zeros_and_scales.CURRENT_OFFSET,
    zeros_and_scales.CURRENT_GAIN,
    zeros_and_scales.HALL_OFFSET,
    zeros_and_scales.MASS_ERROR,
    zeros_and_scales.DISTANCE_SCALE,
    springs.SPRING_IN_FORCE,
    springs.SPRING,
    springs.SPRING_PRELOAD,
    springs.SPRING_STIFFNESS,
    circuit.COIL_TEMPERATURE,
    magnet.MAGNET_TEMPERATURE,
    iron.CORE_SATURATION,
    hysteresis.HYSTERESIS,
    iron.CORE_REMANENCE,
    lags.EDDY_CURRENT_LAG,
    magnet.LATERAL_MISALIGNMENT,
    friction.COULOMB_FRICTION,
    friction.STOP_POSITION,
    springs.END_STOP_CONTACT,
    springs.CONSTANT_FORCE,
    friction.VISCOUS_FRICTION,
    friction.FLUID_DRAG,
    friction.SIDE_PULL_FRICTION,
    iron.POSITION_DEPENDENT_INDUCTANCE,
    magnet.MAGNET_DEMAGNETISATION,
    zeros_and_scales.DRIVER_GAIN,
    circuit.DRIVER_DEAD_ZONE,
    circuit.SUPPLY_SAG,
    zeros_and_scales.POSITION_DELAY,
    zeros_and_scales.POSITION_NONLINEARITY,
    lags.SENSOR_DELAY,
    hall.HALL_TEMPERATURE,
    hall.HALL_COIL_PICKUP,
    hall.HALL_DRIFT,
    hall.HALL_SATURATION,
    lags.FLUX_INTEGRATOR_DRIFT,
    magnet.EXTERNAL_FIELD,
    circuit.MOTIONAL_EMF,
)
"""The commonest cause first: where readings fit several equally well, that is the order in which they are named.

Conventional, from what workshops and benches get wrong: zeros and tolerances before scales, these before physics that a
drawing leaves out.
"""

_EARLIER_NAMES = {"base_magnet_strength": "remanence", "base_turns": "turns", "base_resistance": "resistance"}
"""As model files of earlier versions call them."""


def all_effects() -> dict[str, Effect]:
    """Every effect by its name, in the catalogue's order.

    Examples
    --------
    >>> import femfit as ff
    >>> list(ff.list_effects())[:3]
    ['distance_offset', 'remanence', 'turns']
    """
    return {effect.name: effect for effect in BUILT_IN}


def effect_by_name(name: str) -> Effect:
    """Look up an effect, or that of a circuit as ``turns:lower``."""
    effect = known_effect(_EARLIER_NAMES.get(name, name))
    require_known("Effect", [name] if effect is None else [], all_effects())
    return cast("Effect", effect)


@cache
def known_effect(name: str) -> Effect | None:
    """The effect of a name, of one circuit or of the device; None where there is none."""
    kind, _, circuit = name.partition(SEPARATOR)
    return of_circuit(effect_by_name(kind), circuit) if circuit and kind in OF_EACH else all_effects().get(name)


def of_any_device(effect: Effect) -> bool:
    """Whether models of several circuits can have it: of one, of the whole, of forces or the eddy currents alone."""
    mechanical = effect.acts_on == ("force",) and "~current_A" not in effect.needs
    of_eddies = effect.coenergy is None and (effect.impedance is not None or effect.eddy is not None)
    return bool(effect.of) or effect.name in OF_THE_WHOLE or mechanical or of_eddies


def device_effects(circuits: Sequence[str], drawn: Iterable[Effect] = ()) -> dict[str, Effect]:
    """The catalogue for a device of these circuits, in its order; of several, what they can have; then the drawn."""
    effects: dict[str, Effect] = {}
    for name, effect in all_effects().items():
        if len(circuits) < 2 or name in OF_THE_WHOLE:
            effects[name] = effect
        elif name in OF_EACH:
            effects |= {key: effect_by_name(key) for key in (f"{name}{SEPARATOR}{circuit}" for circuit in circuits)}
    return effects | {effect.name: effect for effect in drawn}
