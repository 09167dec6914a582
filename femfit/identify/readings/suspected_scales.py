"""What a whole channel is wrong by: a factor, the weight of the moving part, or the zero of the distance."""

from collections.abc import Callable, Mapping

import numpy as np
from scipy import optimize

from femfit.core.numerics import BoolArray, FloatArray
from femfit.core.results import Finding
from femfit.core.text import amount, rounded
from femfit.effects.catalogue import effect_by_name
from femfit.identify.constants import (
    BEYOND_MOUNTING,
    DOMAIN_SLACK,
    EXACTLY,
    KEPT_ROWS,
    LARGEST_SHIFT,
    NOTHING_LEFT,
    SAME_READING,
    SHIFTS,
    WELL,
    WRONG_FACTOR,
)
from femfit.model.actuator_model import ActuatorModel
from femfit.tables.units import LEAST_READINGS

Predict = Callable[[FloatArray, FloatArray], Mapping[str, FloatArray]]

_CAUSES = {
    "force_N": "a unit, a lever of the scale, or one half of a symmetric drawing",
    "inductance_H": "the number of turns, a unit, or a bridge's frequency at which eddy currents lower it",
    "flux_linkage_Wb": "the number of turns, or the flux of one turn",
    "hall_V": "the sensitivity of the Hall element, or its place",
}


def suspected_dead(name: str, read: FloatArray, usual: FloatArray) -> Finding | None:
    """Suspect a channel that reads one value while the model's changes by more than a part of it."""
    values, predicted = read[np.isfinite(read)], usual[np.isfinite(read)]
    if len(values) < LEAST_READINGS or np.ptp(values) > SAME_READING * np.abs(values).max():
        return None
    if not float(np.std(predicted)) > WELL * abs(float(values[0])):
        return None
    low, high = (amount(float(end), name) for end in (predicted.min(), predicted.max()))
    weight = ", or a weight held in balance" if name == "force_N" and values[0] else ""
    text = (
        f"{name} reads {amount(float(values[0]), name)} in all {len(values)} rows, where the model's goes from {low} "
        f"to {high}: a dead channel{weight}."
    )
    return Finding("suspected-dead", "warning", text, "Check the sensor and its cable.", float(values[0]), name)


def suspected_factor(model: ActuatorModel, name: str, read: FloatArray, usual: FloatArray) -> Finding | None:
    """Suspect a factor that no tolerance of a drawing makes."""
    sensor, circuit = model.sensor, model.circuit
    zero = sensor.quiescent_V if name == "hall_V" and sensor is not None else 0.0
    factor = ratio(read - zero, usual - zero)
    if factor is None or 1.0 / WRONG_FACTOR < abs(factor) < WRONG_FACTOR:
        return None
    if not _exactly(read, usual, zero + factor * (usual - zero)):
        return None
    cause = _CAUSES.get(name, "")
    if name in {"voltage_V", "resistance_ohm"} and circuit is not None:
        ohms = amount(factor * circuit.resistance_ohm, "ohm")
        cause = f"a resistance of {ohms} instead of {amount(circuit.resistance_ohm, 'ohm')}, with leads or a resistor"
    text = f"{name} is {rounded(factor)} times the model's at every setting: {cause or 'a unit'}."
    return Finding("suspected-scale", "warning", text, "Correct the column or the drawing.", factor, name)


def suspected_weight(model: ActuatorModel, name: str, read: FloatArray, usual: FloatArray) -> Finding | None:
    """Suspect that a scale shows the moving part's weight beside the force, or had it taken off."""
    if name != "force_N" or model.motion is None:
        return None
    weight = abs(model.motion.mass_kg * model.motion.gravity_m_s2)
    for sign, words, remedy in ((1.0, "more", "Subtract it."), (-1.0, "less", "Add it.")):
        if weight > 0.0 and _exactly(read, usual, usual + sign * weight):
            text = (
                f"force_N is {words} than the model's by the weight of the moving part, {amount(weight, 'N')}, at "
                "every setting: it is the force of a scale, not that of the actuator."
            )
            return Finding("suspected-weight", "warning", text, remedy, sign * weight, name)
    return None


def suspected_zero(
    model: ActuatorModel, d: FloatArray, i: FloatArray, reads: Mapping[str, FloatArray], predict: Predict
) -> Finding | None:
    """Suspect that the distance is counted from another place than the electromagnet's face."""
    box = model.without_effects.validity
    travel = box.distance_max_m - box.distance_min_m
    of_the_circuit = {"voltage_V", "resistance_ohm"}
    reads = {name: read for name, read in reads.items() if name not in of_the_circuit and np.isfinite(read).any()}
    if not reads:
        return None

    slack = DOMAIN_SLACK * travel
    recorded = _inside(d, box.distance_min_m - slack, box.distance_max_m + slack)
    usual = predict(d, i)
    scale = {name: _spread(read, usual[name][recorded]) for name, read in reads.items()}
    before = max(_left(read, usual[name], scale[name]) for name, read in reads.items())

    def left(shift: float) -> float:
        inside = _inside(d + shift, box.distance_min_m - slack, box.distance_max_m + slack)
        if inside.mean() < KEPT_ROWS or (recorded & ~inside).any():
            return NOTHING_LEFT
        usual = predict(d[inside] + shift, i[inside])
        return max(_left(read[inside], usual[name], scale[name]) for name, read in reads.items())

    shifts = np.linspace(-LARGEST_SHIFT, LARGEST_SHIFT, SHIFTS) * travel
    best = float(shifts[np.argmin([left(float(shift)) for shift in shifts])])
    step = float(shifts[1] - shifts[0])
    found = optimize.minimize_scalar(left, bounds=(best - step, best + step), method="bounded")
    shift = float(found.x)
    usual_range = max(abs(end) for end in effect_by_name("distance_offset").parameters[0].plausible)
    if abs(shift) < BEYOND_MOUNTING * usual_range or not found.fun < min(WELL, EXACTLY * before):
        return None
    text = (
        f"distance_m seems to be counted from another place: with {amount(shift, 'distance_m')} added to each distance "
        "the readings would fit the model."
    )
    remedy = "Count distances from the electromagnet's face to the nearest face of the moving part."
    return Finding("suspected-zero", "warning", text, remedy, shift, "distance_m")


def _exactly(read: FloatArray, usual: FloatArray, candidate: FloatArray) -> bool:
    here = np.isfinite(read)
    if here.sum() < LEAST_READINGS:
        return False
    before, after = (float(np.sum((read - values)[here] ** 2)) for values in (usual, candidate))
    return after < EXACTLY**2 * before


def ratio(read: FloatArray, usual: FloatArray) -> float | None:
    """How many times the prediction the readings are, by least squares; None where nothing is predicted."""
    here = np.isfinite(read) & np.isfinite(usual)
    square = float(usual[here] @ usual[here])
    return float(read[here] @ usual[here]) / square if square > 0.0 else None


def _inside(distance: FloatArray, low: float, high: float) -> BoolArray:
    return np.asarray((distance >= low) & (distance <= high))


def _spread(read: FloatArray, usual: FloatArray) -> float:
    """Standard deviation of readings and predictions together: readings alone may be constant, as in hovering."""
    return max(float(np.nanstd(np.append(read, usual))), float(np.finfo(float).tiny))


def _left(read: FloatArray, usual: FloatArray, scale: float) -> float:
    """Root mean square of what a prediction leaves of the readings, over their scale."""
    here = np.isfinite(read)
    return float(np.sqrt(np.mean((read - usual)[here] ** 2))) / scale if here.any() else 0.0
