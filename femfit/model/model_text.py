"""A model in a few lines: what it is, how far it is from its table, where it holds, what it has."""

from typing import TYPE_CHECKING

import numpy as np

from femfit.core.text import amount, amount_range, counted
from femfit.model.magnetics import LawMagnetics
from femfit.model.network_magnetics import FORMULA, NETWORK, NetworkMagnetics

if TYPE_CHECKING:
    from femfit.model.actuator_model import ActuatorModel
    from femfit.model.eddy_currents import EddyCurrents
    from femfit.model.validity import Misfit


def model_lines(model: "ActuatorModel") -> list[str]:
    """The lines that a printed model shows."""
    lines = fit_lines(model)
    if model.effects:
        lines.append(f"effects: {', '.join(added.effect.name for added in model.effects)}")
    motion, sensor = model.motion, model.sensor
    circuits = [
        f"{amount(one.resistance_ohm, 'ohm', 3)} on {one.voltage_min_V:g} to {one.voltage_max_V:g} V"
        + (f", {amount(one.inductance_H, 'H', 3)} in series" if one.inductance_H else "")
        for one in model.circuits
    ]
    parts = {
        "circuit": "; ".join(circuits),
        "motion": motion and f"moving mass {amount(motion.mass_kg, 'kg', 3)}",
        "sensor": sensor and f"Hall element of {amount(sensor.sensitivity_V_per_T, 'V/T', 3)}",
    }
    lines += [f"{name}: {text or 'none'}" for name, text in parts.items()]
    if model.eddy is not None:
        lines.append(eddy_line(model, model.eddy))
    return [*lines, f"sample time {amount(model.sample_time_s, 's')}"]


def eddy_line(model: "ActuatorModel", eddy: "EddyCurrents") -> str:
    """How many states, their time constants while nothing changes the circuits' currents, and how true they are."""
    windings, n = model.windings, len(eddy.circuits)
    d = np.linspace(model.validity.distance_min_m, model.validity.distance_max_m, 9)
    own = windings.magnetics.inductance(d, np.zeros((9, n + eddy.count)))[:, n:, n:]
    root = np.sqrt(eddy.resistances_ohm)
    times = np.linalg.eigvalsh(own / (root[:, None] * root))
    text = f"eddy currents: {counted(eddy.count, 'state')}, {amount_range(times.min(), times.max(), 's', 2)}"
    if eddy.bias is not None:
        least, most = eddy.bias.current_A.min(axis=0), eddy.bias.current_A.max(axis=0)
        about = [amount_range(float(a), float(b), "A") for a, b in zip(least, most, strict=True)]
        text += f", linearised at {' and '.join(about)}"
    if eddy.error is None:
        return text
    low, high = amount(eddy.error.frequency_min_Hz, "Hz"), amount(eddy.error.frequency_max_Hz, "Hz")
    kinds = ("impedance", eddy.error.impedance), ("force", eddy.error.force), ("Hall field", eddy.error.hall)
    off = [f"{amount(one, '', 2)} of its {name}" for name, one in kinds if one is not None]
    text = f"{text}; from {low} to {high} off the field by at most {', '.join(off)}"
    parts = (("inductance", eddy.error.static_inductance), ("dF/di", eddy.error.static_force))
    static = [f"{name} by {amount(off, '', 2)}" for name, off in parts if off is not None and off > eddy.error.largest]
    return f"{text}, beside a static model that misses the {' and the '.join(static)}" if static else text


def fit_lines(model: "ActuatorModel") -> list[str]:
    """What it is, its misfit where that is known, and its validity domain."""
    base, domain = model.without_effects, model.validity
    law = base.magnetics.law if isinstance(base.magnetics, LawMagnetics) else None
    known = (
        [f"{counted(len(base.drawn), 'number')} of the drawing with what each of them changes"] if base.drawn else []
    )
    kind = f"law {law.name}, {law.formula}" if law else "co-energy"
    if isinstance(base.magnetics, NetworkMagnetics):
        kind = f"law {NETWORK}, {FORMULA}"
    lines = [f"{model.name}: {kind}"]
    if base.misfit is not None:
        lines += [f"it misses its table of {counted(base.misfit.rows, 'point')} by", *misfit_lines(base.misfit)]
    valid = f"valid from {1e3 * domain.distance_min_m:.4g} to {1e3 * domain.distance_max_m:.4g} mm"
    if len(domain.current_limits_A) > 1:
        each = zip(base.current_names, domain.current_limits_A.tolist(), strict=True)
        ranges = ", ".join(f"{name} {low + 0.0:.4g} to {high + 0.0:.4g} A" for name, (low, high) in each)
        return [*lines, f"{valid} and {ranges}{', or all of them reversed' if domain.mirrored else ''}"]
    if not domain.current_limits_A.any():  # a pair of magnets
        return [*lines, valid, *known]
    return [*lines, f"{valid} and {domain.current_min_A + 0.0:.4g} to {domain.current_max_A + 0.0:.4g} A", *known]


def misfit_lines(misfit: "Misfit") -> list[str]:
    """A line for each quantity that the table has."""
    weight = "" if misfit.force_rms_of_weight is None else f", {100 * misfit.force_rms_of_weight:.3g} % of the weight"
    lines = [
        (
            f"  force        {_share(misfit.force_share)} ({amount(misfit.force_rms_N, 'N', 3)} rms, "
            f"{amount(misfit.force_max_N, 'N', 3)} at most{weight})"
        )
    ]
    if misfit.flux_linkage_rms_Wb is not None:
        lines.append(
            f"  flux linkage {_share(misfit.flux_linkage_share)} ({amount(misfit.flux_linkage_rms_Wb, 'Wb', 3)} rms)"
        )
    if misfit.inductance_rms_H is not None:
        lines.append(
            f"  inductance   {_share(misfit.inductance_share)} ({amount(misfit.inductance_rms_H, 'H', 3)} rms)"
        )
    return lines


def _share(share: float | None) -> str:
    return "" if share is None else amount(share, "")
