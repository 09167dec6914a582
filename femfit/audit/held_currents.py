"""Where the currents of several circuits can hold the body, as an audit says it."""

import numpy as np

from femfit.audit.conclusions import AuditFinding, Severity
from femfit.core.amount import amount
from femfit.core.errors import DomainError
from femfit.filters.holding import bias_currents, holding_currents
from femfit.model.actuator_model import ActuatorModel

_DISTANCES = 41

FASTEST = 0.3
"""Unstable pole times sample time that a loop can still be closed with."""


def held_by_several(model: ActuatorModel) -> list[AuditFinding]:
    """The distances at which some currents of the validity domain balance what pulls, and how fast the body leaves."""
    box, motion = model.validity, model.require_motion()
    about, held = "what the currents hold", []
    distances = np.linspace(box.distance_min_m, box.distance_max_m, _DISTANCES)
    bias = bias_currents(model, float(distances[_DISTANCES // 2]))
    for distance in distances:
        try:
            held.append((distance, holding_currents(model, float(distance), bias)))
        except DomainError:
            continue
    near = f"about a bias of {', '.join(amount(float(one), 'A') for one in bias)}"
    if not held:
        text = f"no currents {near} balance weight, springs and load anywhere."
        return [AuditFinding("held_range", "note", about, text)]
    low, high = held[0][0], held[-1][0]
    text = f"currents {near} hold the body from {amount(low, 'm', 3)} to {amount(high, 'm', 3)}."
    beyond = [one for one in model.reference_distances_m if not low <= one <= high]
    if beyond:
        text = f"{text[:-1]}; the reference asks for {', '.join(amount(one, 'm', 3) for one in beyond)}."
    found = [AuditFinding("held_range", "wrong" if beyond else "holds", about, text, None, high)]
    at, currents = np.array([d for d, _ in held]), np.array([i for _, i in held])
    slope = model.magnetics.slopes_of_circuits(at, currents).force_gradient - motion.static_gradient(at)
    rate = float(np.sqrt(np.maximum(-slope, 0.0).max() / motion.mass_kg))
    if rate > 0.0:
        turn = rate * model.sample_time_s
        text = f"held, the body leaves at up to {amount(rate, '1/s')}, {turn:.2g} a sample.".replace("1/s", "rad/s")
        severity: Severity = "holds" if turn < FASTEST else "wrong"
        found.append(AuditFinding("sample_time", severity, "sample time", text, model.sample_time_s, rate))
    return found
