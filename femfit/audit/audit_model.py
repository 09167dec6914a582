"""Audits a model file: signs, bounds, reciprocity, the range that its supply can hold, its sensor, single precision."""

from dataclasses import replace

import numpy as np

from femfit.audit.finding import AuditFinding
from femfit.core.arrays import FloatArray
from femfit.model.actuator_model import ActuatorModel, HallSensor
from femfit.model.bspline import TensorSpline
from femfit.model.magnetics import CoenergySpline, LawMagnetics, Magnetics

_GRID = (41, 15)
_RECIPROCITY = 1e-4
"""Of the largest k_m: central differences over a ten-thousandth of the range are better than that."""

_SINGLE = 1e-4
"""Change of the force, over its largest, that rounding the model's numbers to single precision may make."""

_OF_WEIGHT = 0.01
"""Misfit over the weight from which a held body is off by a tenth of a millimetre in a rig like the example."""

_FASTEST = 0.3
"""Unstable pole times sample time that a loop can still be closed with."""


def audit_model(model: ActuatorModel) -> list[AuditFinding]:
    """Everything that a model tells of itself.

    Parameters
    ----------
    model : ActuatorModel
        With its effects, as it runs.
    """
    box = model.validity
    d, i = (
        x.ravel()
        for x in np.meshgrid(
            np.linspace(box.distance_min_m, box.distance_max_m, _GRID[0]),
            np.linspace(box.current_min_A, box.current_max_A, _GRID[1]),
        )
    )
    findings = [*_signs(model, d, i), _reciprocity(model.magnetics, d, i), *_bounds(model), *_misfit(model)]
    findings += _single_precision(model.without_effects.magnetics, d, i)
    if model.circuit is not None and model.motion is not None:
        findings += _held(model)
    if model.sensor is not None:
        findings += _sensor(model.sensor, d, i)
    return findings


def _signs(model: ActuatorModel, d: FloatArray, i: FloatArray) -> list[AuditFinding]:
    state = model.magnetics.state(d, i)
    slope = state.motional_constant
    pushing = float(np.mean((slope <= 0.0) & (i != 0.0)))  # steel alone has dF/di = 0 without a current
    findings = []
    text = "a growing current attracts more everywhere in the box (dF/di > 0)."
    if slope.min() <= 0.0:
        text = "a growing current attracts more wherever there is one (dF/di > 0)."
    if pushing > 0.0:
        text = f"a growing current attracts less in {100 * pushing:.2g} % of the box (dF/di <= 0)."
    findings.append(AuditFinding("attraction", "note" if pushing else "holds", "force", text, None, 1.0 - pushing))
    least = float(state.inductance.min())
    text = f"the inductance is {least:.3g} to {float(state.inductance.max()):.3g} H."
    if least <= 0.0:
        text += " It must be > 0: fit to a table with flux linkage, or give --inductance-H."
    findings.append(AuditFinding("inductance", "holds" if least > 0.0 else "wrong", "flux linkage", text, None, least))
    negative = []
    if model.circuit is not None:
        span = model.circuit.voltage_max_V - model.circuit.voltage_min_V
        values = {"resistance_ohm": model.circuit.resistance_ohm, "voltage_max_V - voltage_min_V": span}
        negative += [name for name, value in values.items() if value <= 0.0]
    if model.motion is not None and model.motion.mass_kg <= 0.0:
        negative.append("mass_kg")
    return findings + [AuditFinding("positive", "wrong", name, "it must be > 0.") for name in negative]


def _reciprocity(magnetics: Magnetics, d: FloatArray, i: FloatArray) -> AuditFinding:
    """dF/di against -d(flux linkage)/dd, each by differences of the quantity itself."""
    step_d, step_i = 1e-4 * float(np.ptp(d)), 1e-4 * max(float(np.ptp(i)), 1e-6)
    inside_d, inside_i = np.clip(d, d.min() + step_d, d.max() - step_d), np.clip(i, i.min() + step_i, i.max() - step_i)
    force = (magnetics.force(inside_d, inside_i + step_i) - magnetics.force(inside_d, inside_i - step_i)) / (2 * step_i)
    flux = magnetics.flux_linkage(inside_d + step_d, inside_i) - magnetics.flux_linkage(inside_d - step_d, inside_i)
    off = float(np.abs(force + flux / (2 * step_d)).max() / max(float(np.abs(force).max()), 1e-300))
    severity = "holds" if off < _RECIPROCITY else "wrong"
    text = f"dF/di and -d(flux linkage)/dd differ by at most {off:.1g} of the largest."
    return AuditFinding("reciprocity", severity, "force and flux linkage", text, None, off)  # type: ignore[arg-type]


def _bounds(model: ActuatorModel) -> list[AuditFinding]:
    magnetics = model.without_effects.magnetics
    if not isinstance(magnetics, LawMagnetics):
        return []
    findings = []
    for c in magnetics.coefficients:
        name = f"coefficient {c.basis} i^{c.current_power}"
        low, high = c.bounds
        if not low <= c.value <= high:
            text = f"{c.value:.4g} lies outside of its bounds {low:g} to {high:g}."
            findings.append(AuditFinding("outside_bounds", "wrong", name, text, c.value))
        elif c.active:
            text = f"the fit of {c.value:.4g} ran into its {c.active} bound: the bound decides, not the data."
            findings.append(AuditFinding("active_bound", "note", name, text, c.value))
    return findings


def _misfit(model: ActuatorModel) -> list[AuditFinding]:
    misfit = model.without_effects.misfit
    if misfit is None or misfit.force_rms_of_weight is None:
        return []
    share = misfit.force_rms_of_weight
    text = f"it misses its {misfit.against} by {100 * share:.2g} % of the weight rms"
    large = share > _OF_WEIGHT
    text += ", more than a filter that should know the distance to 0.1 mm can bear." if large else "."
    return [AuditFinding("misfit", "note" if large else "holds", "fit", text, None, share)]


def _single_precision(magnetics: Magnetics, d: FloatArray, i: FloatArray) -> list[AuditFinding]:
    """How much the force changes when the model's numbers are rounded to single precision."""
    rounded = _rounded(magnetics)
    if rounded is None:
        return []
    force = magnetics.force(d, i)
    change = float(np.abs(rounded.force(d, i) - force).max() / np.abs(force).max())
    severity = "holds" if change < _SINGLE else "note"
    text = f"with its numbers in single precision the force changes by at most {change:.1g} of its largest."
    return [AuditFinding("single_precision", severity, "numbers", text, None, change)]  # type: ignore[arg-type]


def _rounded(magnetics: Magnetics) -> Magnetics | None:
    if isinstance(magnetics, LawMagnetics):
        single = tuple(replace(c, value=float(np.float32(c.value))) for c in magnetics.coefficients)
        return replace(magnetics, coefficients=single)
    if isinstance(magnetics, CoenergySpline):
        spline = magnetics.spline
        coefficients = spline.coefficients.astype(np.float32).astype(np.float64)
        rounded = TensorSpline(spline.x_knots, spline.y_knots, spline.x_degree, spline.y_degree, coefficients)
        return replace(magnetics, spline=rounded)
    return None


def _held(model: ActuatorModel) -> list[AuditFinding]:
    """Where the clamp can hold the body, the reference steps, and the speed of its instability there."""
    circuit, motion, box = model.require_circuit(), model.require_motion(), model.validity
    weight = motion.mass_kg * motion.gravity_m_s2
    lowest = max(box.current_min_A, circuit.voltage_min_V / circuit.resistance_ohm)
    highest = min(box.current_max_A, circuit.voltage_max_V / circuit.resistance_ohm)
    d = np.linspace(box.distance_min_m, box.distance_max_m, 601)
    least, most = (model.magnetics.force(d, np.full_like(d, end)) for end in (lowest, highest))
    held = d[(least <= weight) & (most >= weight)]
    about = "range that the supply can hold"
    clamp = f"{circuit.voltage_min_V:g} to {circuit.voltage_max_V:g} V"
    if not len(held):
        text = f"with {clamp} the body cannot be held anywhere in the box."
        return [AuditFinding("held_range", "note", about, text)]
    text = f"with {clamp} the body can be held from {1e3 * held[0]:.1f} to {1e3 * held[-1]:.1f} mm"
    steps = model.reference_distances_m
    beyond = [one for one in steps if not held[0] - 1e-4 <= one <= held[-1] + 1e-4]
    if beyond:
        text += f"; the reference asks for {', '.join(f'{1e3 * one:g}' for one in beyond)} mm"
    findings = [AuditFinding("held_range", "wrong" if beyond else "holds", about, text + ".", None, float(held[-1]))]
    current = np.array([_current_at(model, float(one), weight, lowest, highest) for one in held])
    rate = float(np.sqrt(np.max(np.maximum(-model.magnetics.force_gradient(held, current), 0.0)) / motion.mass_kg))
    turn = rate * model.sample_time_s
    text = f"held, the body leaves at up to {rate:.3g} rad/s, {turn:.2g} a sample."
    severity = "holds" if turn < _FASTEST else "wrong"
    about = "sample time"
    return [*findings, AuditFinding("sample_time", severity, about, text, model.sample_time_s, rate)]  # type: ignore[arg-type]


def _current_at(model: ActuatorModel, distance: float, weight: float, lowest: float, highest: float) -> float:
    i = np.linspace(lowest, highest, 201)
    return float(np.interp(weight, model.magnetics.force(np.full_like(i, distance), i), i))


def _sensor(sensor: HallSensor, d: FloatArray, i: FloatArray) -> list[AuditFinding]:
    """Whether the output stays within its range, and what the converter adds to the noise."""
    volts = sensor.voltage(d, i)
    clipped = float(np.mean((volts <= sensor.output_min_V) | (volts >= sensor.output_max_V)))
    text = f"its output goes from {float(volts.min()):.3g} to {float(volts.max()):.3g} V over the box"
    text += f" and is clipped in {100 * clipped:.2g} % of it." if clipped else ", within its range."
    findings = [AuditFinding("hall_range", "note" if clipped else "holds", "Hall output", text, None, clipped)]
    step = sensor.quantisation_step / np.sqrt(12.0)
    if sensor.noise_V > 0.0 and step > 0.0:
        text = f"the converter's step adds {1e3 * step:.2g} mV to {1e3 * sensor.noise_V:.2g} mV of noise (both rms)."
        severity = "holds" if step < sensor.noise_V else "note"
        findings.append(AuditFinding("hall_noise", severity, "Hall noise", text, sensor.noise_V, float(step)))  # type: ignore[arg-type]
    return findings
