"""Where a supply, or the currents of several circuits, balance the moving part's weight, and how well it is held."""

from typing import Any

import numpy as np

from femfit.audit.conclusions import AuditFinding, Severity
from femfit.core.errors import DomainError
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


def held_body(model: ActuatorModel) -> list[AuditFinding]:
    """Where the supply, or the currents of several circuits, hold the body; of one that hangs, how fast it leaves."""
    several, box = len(model.circuits) > 1, model.validity
    ends = (box.distance_min_m, box.distance_max_m) if several else model.travel_m
    places = np.linspace(*ends, _HELD_BY_SEVERAL if several else _HELD)
    bias = bias_currents(model, float(places[len(places) // 2])) if several else None
    held = []
    for distance in places.tolist():
        try:
            held.append((distance, *holding_currents(model, distance, bias)))
        except DomainError:
            continue
    rows = np.array(held, dtype=np.float64).reshape(len(held), 1 + len(model.circuits))
    if bias is not None:
        about, numbers = "what the currents hold", dict[str, Any](bias_A=bias.tolist())
    else:
        circuit, carried = model.require_circuit(), []
        for celsius in (WARM_C, COLD_C):  # below it is what a cold coil carries
            voltage = rows[:, -1] * circuit.resistance_ohm * float(copper_growth(celsius))
            reached = rows[(circuit.voltage_min_V <= voltage) & (voltage <= circuit.voltage_max_V)]
            carried.append({"coil_C": celsius, "range_m": reached[[0, -1], 0].tolist() if len(reached) else None})
        about, numbers = "what the supply carries", {"voltage_V": circuit.voltage_max_V, "carried": carried[::-1]}
        rows = reached
    if not len(rows):
        return [AuditFinding("held_range", "note", about, numbers=numbers)]
    low, high, step = float(rows[0, 0]), float(rows[-1, 0]), float(places[1] - places[0])
    if not several and model.sensor is None and not model.reference_distances_m:
        return [AuditFinding("held_range", "holds", about, None, high, numbers)]
    beyond = [distance for distance in model.reference_distances_m if not low - step <= distance <= high + step]
    numbers |= {"low_m": low, "beyond_m": beyond}
    findings = [AuditFinding("held_range", "wrong" if beyond else "holds", about, None, high, numbers)]
    distances, currents, motion = rows[:, 0], rows[:, 1:], model.require_motion()
    slope = model.magnetics.force_gradient(distances, currents) - motion.static_gradient(distances)
    rate = float(np.sqrt(np.maximum(-slope, 0.0).max() / motion.mass_kg))
    severity: Severity = "holds" if rate * model.sample_time_s < FASTEST else "wrong"
    if rate > 0.0:
        findings.append(AuditFinding("sample_time", severity, "sample time", model.sample_time_s, rate))
    return findings
