"""Where a supply, or the currents of several circuits, balance the moving part's weight, and how well it is held."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from femfit.audit.conclusions import AuditFinding, Severity, words
from femfit.core.errors import DomainError
from femfit.core.numerics import FloatArray
from femfit.device.parts import REFERENCE_TEMPERATURE, copper_growth
from femfit.estimate.holding import bias_currents, holding_currents
from femfit.model.actuator_model import ActuatorModel

_HELD_CURRENTS_DISTANCES = 41

FASTEST = 0.3
"""Unstable pole times sample time that a loop can still be closed with."""


def held_by_several(model: ActuatorModel) -> list[AuditFinding]:
    """The distances at which some currents of the validity domain balance what pulls, and how fast the body leaves."""
    box, motion = model.validity, model.require_motion()
    about, held = "what the currents hold", []
    distances = np.linspace(box.distance_min_m, box.distance_max_m, _HELD_CURRENTS_DISTANCES)
    bias = bias_currents(model, float(distances[_HELD_CURRENTS_DISTANCES // 2]))
    for distance in distances:
        try:
            held.append((distance, holding_currents(model, float(distance), bias)))
        except DomainError:
            continue
    numbers = {"bias_A": bias.tolist()}
    if not held:
        return [AuditFinding("held_range", "note", about, numbers=numbers)]
    low, high = float(held[0][0]), float(held[-1][0])
    beyond = [distance for distance in model.reference_distances_m if not low <= distance <= high]
    findings = [_held_range(about, numbers | {"low_m": low}, beyond, high)]
    places, currents = np.array([d for d, _ in held]), np.array([i for _, i in held])
    slope = model.magnetics.force_gradient(places, currents) - motion.static_gradient(places)
    rate = float(np.sqrt(np.maximum(-slope, 0.0).max() / motion.mass_kg))
    return [*findings, _sample_time(rate, model.sample_time_s)] if rate > 0.0 else findings


def _held_range(about: str, numbers: Mapping[str, Any], beyond: list[float], high: float) -> AuditFinding:
    """The range in which the body is held, wrong where reference distances lie beyond it."""
    return AuditFinding(
        "held_range", "wrong" if beyond else "holds", about, None, high, {**numbers, "beyond_m": beyond}
    )


def _sample_time(rate: float, sample_time_s: float) -> AuditFinding:
    """How fast the held body leaves its place, in rad/s, against the sample time."""
    severity: Severity = "holds" if rate * sample_time_s < FASTEST else "wrong"
    return AuditFinding("sample_time", severity, "sample time", sample_time_s, rate)


COLD_C = REFERENCE_TEMPERATURE

WARM_C = 100.0
"""Temperature of a warm coil (conventional): 80 K above 20 degC, and just within thermal class 105 of IEC 60085."""

_DISTANCES = 601

_OFF_PLACE = 0.01
"""Part of the stroke by which the force's misfit may move the place where a body is held; conventional."""


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
    """What the supply can carry; of a body that is meant to hang, also its place and the speed of its instability."""
    carried = [carried_range(model, celsius) for celsius in (COLD_C, WARM_C)]
    about = "what the supply carries"
    numbers = {"carried": carried}
    hangs = model.sensor is not None or bool(model.reference_distances_m)
    cold = carried[0]
    if cold.low_m is None or cold.high_m is None:
        return [AuditFinding("held_range", "note", about, numbers=numbers)]
    if not hangs:
        return [AuditFinding("held_range", "holds", about, None, cold.high_m, numbers)]
    slack = 2.0 * cold.step_m
    beyond = [
        distance
        for distance in model.reference_distances_m
        if not cold.low_m - slack <= distance <= cold.high_m + slack
    ]
    findings = [_held_range(about, numbers, beyond, cold.high_m)]
    held = np.linspace(cold.low_m, cold.high_m, 101)
    current = np.array([_current_at(model, float(distance), cold) for distance in held])
    fall = np.maximum(-model.magnetics.force_gradient(held, current[:, None]), 0.0)
    rate = float(np.sqrt(fall.max() / model.require_motion().mass_kg))
    findings.append(_sample_time(rate, model.sample_time_s))
    misfit = model.without_effects.misfit
    if misfit is not None and np.median(fall) > 0.0:
        off = misfit.force_rms_N / float(np.median(fall))
        stroke = float(np.ptp(model.travel_m))
        severity: Severity = "note" if off > _OFF_PLACE * stroke else "holds"
        findings.append(AuditFinding("held_place", severity, "held body", None, off, {"share_of_stroke": off / stroke}))
    return findings


def _current_at(model: ActuatorModel, distance: float, carried: CarriedRange) -> float:
    # Steel alone pulls least without current
    ends = np.array([carried.current_min_A, min(max(0.0, carried.current_min_A), carried.current_max_A)])
    least = ends[np.argmin(model.magnetics.force(np.full(2, distance), ends[:, None]))]
    i = np.linspace(least, carried.current_max_A, 201)
    needed = float(model.require_motion().static_force(np.asarray(distance)))
    return float(np.interp(needed, model.magnetics.force(np.full_like(i, distance), i[:, None]), i))
