"""The effects of a device of several circuits: some are of one circuit each, some of the whole device.

What is of a circuit is named after both, as ``current_gain:lower``, and changes that circuit's current, turns or
resistance alone. What is not listed here is written for one current, and a device of several is not asked for it.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

from femfit.effects.effect import AddedEffect, Calibration, Effect

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
)

_QUANTITIES = ("current_A", "voltage_V", "flux_linkage_Wb", "inductance_H", "resistance_ohm")


def of_circuit(effect: Effect, circuit: str) -> Effect:
    """An effect of :data:`OF_EACH` as that of one circuit."""
    calibrations = tuple(
        Calibration(
            one.reads,
            one.cost,
            f"{one.instruction} (Circuit {circuit}.)",
            {_own(k, circuit): v for k, v in one.also.items()},
        )
        for one in effect.calibrations
    )
    return replace(
        effect,
        name=f"{effect.name}{SEPARATOR}{circuit}",
        of=circuit,
        symptom=f"{effect.symptom} This in circuit {circuit}.",
        parameters=tuple(replace(p, words=p.words and f"{p.words} in circuit {circuit}") for p in effect.parameters),
        needs=tuple(_need(one, circuit) for one in effect.needs),
        experiment=f"{effect.experiment} (Circuit {circuit}.)",
        calibrations=calibrations,
    )


def _own(name: str, circuit: str) -> str:
    return f"{name}{SEPARATOR}{circuit}" if name in OF_EACH else name


def _need(need: str, circuit: str) -> str:
    """A need whose columns are the circuit's own."""
    for quantity in _QUANTITIES:
        stem, _, unit = quantity.rpartition("_")
        need = need.replace(quantity, f"{stem}_{circuit}_{unit}")
    return need


def effects_of(all_effects: Mapping[str, Effect], circuits: Sequence[str]) -> dict[str, Effect]:
    """The catalogue for a device, in its order: all of it but where there are several circuits."""
    if len(circuits) < 2:
        return dict(all_effects)
    found: dict[str, Effect] = {}
    for name, effect in all_effects.items():
        if name in OF_THE_WHOLE:
            found[name] = effect
        elif name in OF_EACH:
            each = (of_circuit(effect, circuit) for circuit in circuits)
            found |= {one.name: one for one in each}
    return found


def source_scales(effects: Iterable[AddedEffect], circuits: Sequence[str]) -> list[float]:
    """What multiplies the magnets and each circuit's current where they make the field; 1 + n numbers.

    Turns that are of no circuit by name are the only one's.
    """
    scales = dict.fromkeys(("", *circuits), 1.0)
    for added in effects:
        if added.effect.name == "remanence":
            scales[""] *= 1.0 + added.parameters["remanence_error"]
        elif added.effect.name.partition(SEPARATOR)[0] == "turns":
            scales[added.effect.of or circuits[0]] *= 1.0 + added.parameters["turns_error"]
    return list(scales.values())
