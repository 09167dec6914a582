"""Where a supply, or the currents of several circuits, balance the moving part's weight, and how well it is held."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from femfit.audit.conclusions import AuditFinding, Severity, words
from femfit.core.errors import DomainError
from femfit.core.numerics import FloatArray
from femfit.device.parts import REFERENCE_TEMPERATURE, copper_growth
from femfit.estimate.holding import bias_currents, holding_currents
from femfit.model.actuator_model import ActuatorModel

_HELD, _HELD_BY_SEVERAL = 101, 41
"""Distances at which the body is held; several circuits are searched for each."""

FASTEST = 0.3
"""Unstable pole times sample time that a loop can still be closed with."""


COLD_C = REFERENCE_TEMPERATURE

WARM_C = 100.0
"""Temperature of a warm coil (conventional): 80 K above 20 degC, and just within thermal class 105 of IEC 60085."""

_DISTANCES = 601


@dataclass(frozen=True)
class CarriedRange:
    """The distances at which a supply's currents can balance the weight, with the coil at one temperature."""

    coil_C: float
    voltage_max_V: float
    # What the supply gives, as far as the model goes
    current_min_A: float
    current_max_A: float
    supply_A: float  # The supply's largest current, where the model ends below it; else ``current_max_A``
    weight_N: float
    # None where the weight is carried nowhere
    low_m: float | None
    high_m: float | None
    step_m: float  # Step of the distances at which the two were found
    sprung: bool = False  # Whether springs or a load act beside the weight

    def __str__(self) -> str:
        return words("audit", "carried", self)


def carried_range(model: ActuatorModel, celsius: float = COLD_C) -> CarriedRange:
    """Where some current of the supply makes the force equal the weight."""
    circuit, motion, box = model.require_circuit(), model.require_motion(), model.validity
    ohm = circuit.resistance_ohm * float(copper_growth(celsius))
    lowest = float(np.clip(circuit.voltage_min_V / ohm, box.current_min_A, box.current_max_A))
    highest = float(np.clip(circuit.voltage_max_V / ohm, box.current_min_A, box.current_max_A))
    d = np.linspace(*model.travel_m, _DISTANCES)
    needed = motion.static_force(d)
    weight = motion.mass_kg * motion.gravity_m_s2
    ends = (lowest, *model.attracting_range(lowest, highest))  # steel is attracted by either sign of the current
    forces = [model.magnetics.force(d, np.full((len(d), 1), i)) for i in ends]
    held: FloatArray = d[(np.min(forces, axis=0) <= needed) & (np.max(forces, axis=0) >= needed)]
    low, high = (float(held[0]), float(held[-1])) if len(held) else (None, None)
    sprung = bool(motion.springs or motion.load_N)
    supply = max(circuit.voltage_max_V / ohm, highest)
    supply = supply if supply > highest * (1.0 + 1e-9) else highest
    return CarriedRange(
        celsius, circuit.voltage_max_V, lowest, highest, supply, weight, low, high, float(d[1] - d[0]), sprung
    )


def held_body(model: ActuatorModel) -> list[AuditFinding]:
    """Where the supply, or the currents of several circuits, hold the body; of one that hangs, how fast it leaves."""
    cold, bias, box, low, high = None, None, model.validity, 0.0, 0.0
    if len(box.current_limits_A) > 1:
        places = np.linspace(box.distance_min_m, box.distance_max_m, _HELD_BY_SEVERAL)
        bias = bias_currents(model, float(places[_HELD_BY_SEVERAL // 2]))
        about, numbers = "what the currents hold", dict[str, Any](bias_A=bias.tolist())
    else:
        carried = [carried_range(model, celsius) for celsius in (COLD_C, WARM_C)]
        about, numbers, cold = "what the supply carries", {"carried": carried}, carried[0]
        low, high = cold.low_m or 0.0, cold.high_m or 0.0
        places = np.zeros(0) if cold.low_m is None else np.linspace(low, high, _HELD)
    held = []
    for distance in places:
        try:
            held.append((float(distance), holding_currents(model, float(distance), bias)))
        except DomainError:
            continue
    if not held:
        return [AuditFinding("held_range", "note", about, numbers=numbers)]
    if cold is None:
        low, high = held[0][0], held[-1][0]
        numbers["low_m"] = low
    elif model.sensor is None and not model.reference_distances_m:
        return [AuditFinding("held_range", "holds", about, None, high, numbers)]
    slack = 0.0 if cold is None else 2.0 * cold.step_m
    beyond = [distance for distance in model.reference_distances_m if not low - slack <= distance <= high + slack]
    numbers["beyond_m"] = beyond
    findings = [AuditFinding("held_range", "wrong" if beyond else "holds", about, None, high, numbers)]
    distances, currents = np.array([d for d, _ in held]), np.array([i for _, i in held])
    slope = model.magnetics.force_gradient(distances, currents) - model.require_motion().static_gradient(distances)
    rate = float(np.sqrt(np.maximum(-slope, 0.0).max() / model.require_motion().mass_kg))
    severity: Severity = "holds" if rate * model.sample_time_s < FASTEST else "wrong"
    if rate > 0.0:
        findings.append(AuditFinding("sample_time", severity, "sample time", model.sample_time_s, rate))
    return findings
