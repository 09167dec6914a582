"""Checks of a model as its file holds it: misfit, circuit, signs, the range that its supply can hold, its sensor."""

from pathlib import Path

import numpy as np

from femfit.audit.carried import held_body
from femfit.audit.conclusions import Audit, AuditFinding, Severity
from femfit.core.errors import ModelFileError, TableError
from femfit.core.numerics import FloatArray
from femfit.core.results import listing
from femfit.core.sweep_columns import current_columns
from femfit.core.text import amount
from femfit.device.electrics import where_clipped
from femfit.fit.constants import POOR_POINT
from femfit.fit.ranking import misfit_to_rows
from femfit.fit.rows import FitRows, rms, rows_of_table
from femfit.model.actuator_model import ActuatorModel
from femfit.model.hall import HallSensor
from femfit.model.json_file import read_model
from femfit.model.magnetics import LawMagnetics, Magnetics
from femfit.model.sensors import HALL, reading_of
from femfit.model.validity import Misfit
from femfit.tables.sweep_table import TABLE_STEM, current_names, read_sweep_table

_GRID = (41, 15)

_EACH = 5
"""Currents of each of several circuits."""

_LARGE_MISFIT = 0.1
"""Share of a quantity's rms from which a model that misses its table by it is wrong; conventional."""

_RMS = {"force": "force_rms_N", "flux linkage": "flux_linkage_rms_Wb", "inductance": "inductance_rms_H"}

_ROUNDING = 1e-9
"""What reading a file back may change, as a part of a quantity's rms."""

_STATED = 1.1
"""Misfit over the one that the file states from which the file contradicts itself; as in a fit."""

_RECIPROCITY = 1e-4
"""Tolerance of k_m, as a part of the largest dF/di; derived: central differences over a ten-thousandth of the range are
better than that."""


def audit_model(model: ActuatorModel | str | Path, table: str | Path | None = None) -> Audit:
    """Check a model on its own, and against the sweep table that it was fitted to where that is at hand.

    Without a table it is the one in the model file's directory, if its distances and currents lie within the model's.
    """
    rows, findings = None, []
    if not isinstance(model, ActuatorModel):
        path = Path(model)
        if path.suffix != ".json":
            raise ModelFileError(f"An audit needs a model file (.json); instead received {path}.")
        model = read_model(path)
        if table is None:
            beside = any((path.parent / f"{TABLE_STEM}{suffix}").is_file() for suffix in (".parquet", ".csv"))
            try:
                rows = _rows_of(path.parent, model) if beside else None
            except TableError as error:
                findings.append(AuditFinding("table", "note", "table", numbers={"cause": str(error)}))
    if table is not None:
        rows = _rows_of(Path(table), model)
    d, i = model.validity.grid(*_GRID, several=_EACH)
    findings += [*_misfit(model, rows, d, i), *_positive(model)]
    if rows is not None and rows.several:
        findings.append(_worst_point(model, rows))
    if model.has_winding:
        findings += [*_signs(model, d, i), _reciprocity(model.magnetics, d, i)]
    findings += _bounds(model)
    if model.circuits and model.motion is not None and not any(finding.code == "positive" for finding in findings):
        findings += held_body(model)
    if model.sensor is not None:
        findings += _hall(model.sensor, reading_of(model, HALL).rounding, d, i)
    return Audit(tuple(findings))


def _rows_of(path: Path, model: ActuatorModel) -> FitRows:
    motion = model.without_effects.motion
    table, names = read_sweep_table(path), current_columns(model.current_names)
    columns = current_names(table.rows)
    if columns != names:
        raise TableError(
            f"{path} must have the current of each circuit of the model ({listing(names)}); it has "
            f"{listing(columns)}. Give the table that the model was fitted to."
        )
    mass, gravity = (motion.mass_kg, motion.gravity_m_s2) if motion else (None, 0.0)
    rows = rows_of_table(table, mass, gravity, model.kind)
    _require_within(rows, model, path)
    return rows


def _require_within(rows: FitRows, model: ActuatorModel, table: str | Path) -> None:
    """Refuse a table of another device: one without force, or that goes where the model does not hold, to rounding."""
    if not rows.force.any():
        raise TableError(f"{table} must have forces; all are 0 N. Give the table that the model was fitted to.")
    box = model.validity
    limits = np.array([(box.distance_min_m, box.distance_max_m), *box.current_limits_A])
    if rows.several:  # currents of one sign may hold for the other one
        limits[1:] = np.abs(limits[1:]).max(axis=1, keepdims=True) * (-1.0, 1.0)
    values = np.column_stack([rows.distance, rows.circuit_currents[:, : len(box.current_limits_A)]])
    more = _ROUNDING * np.ptp(limits, axis=1)
    for (low, high), beyond, column, unit in zip(limits, more, values.T, ("m", *"A" * (len(limits) - 1)), strict=True):
        if column.min() < low - beyond or column.max() > high + beyond:
            raise TableError(
                f"{table} goes from {amount(float(column.min()), unit, 3)} to {amount(float(column.max()), unit, 3)}; "
                f"the model holds from {amount(float(low), unit, 3)} to {amount(float(high), unit, 3)}. Give the table "
                "that it was fitted to."
            )


def _worst_point(model: ActuatorModel, rows: FitRows) -> AuditFinding:
    """The point of the table whose force several circuits' co-energy misses most, beside that force."""
    force = model.without_effects.magnetics.force(rows.distance, rows.circuit_currents)
    missed = np.abs(force - rows.force) / rows.force_scale
    k = int(np.argmax(missed))
    numbers = {
        "share": float(missed[k]),
        "distance_m": float(rows.distance[k]),
        "currents_A": rows.circuit_currents[k].tolist(),
    }
    severity: Severity = "wrong" if missed[k] > _LARGE_MISFIT else "note" if missed[k] > POOR_POINT else "holds"
    return AuditFinding("point_misfit", severity, "force", float(rows.force[k]), float(force[k]), numbers)


def _misfit(model: ActuatorModel, rows: FitRows | None, d: FloatArray, i: FloatArray) -> list[AuditFinding]:
    """How far the model is from its table: recomputed where that is at hand, else as the file states it."""
    base = model.without_effects
    stated = base.misfit
    misfit = stated
    if rows is not None:
        misfit = misfit_to_rows(base, rows)
    if misfit is None:
        return []
    against, findings = {"against": misfit.against if rows is None else None}, []
    shares = _shares(misfit, base.magnetics, d, i)
    for about, share in shares.items():
        right: Severity = "holds" if rows is not None else "stated"
        severity = "wrong" if share > _LARGE_MISFIT else right
        findings.append(AuditFinding("misfit", severity, about, None, share, against))
    if rows is None or stated is None:
        return findings
    for about, name in _RMS.items():
        stated_rms, rms_now = getattr(stated, name), getattr(misfit, name)
        if (
            stated_rms is not None
            and rms_now is not None
            and rms_now > _STATED * stated_rms + _ROUNDING * rms_now / shares[about]
        ):
            quantity = f"stated misfit of the {about}"
            findings.append(AuditFinding("stated_misfit", "wrong", quantity, stated_rms, rms_now, {"unit": name}))
    return findings


def _shares(misfit: Misfit, magnetics: Magnetics, d: FloatArray, i: FloatArray) -> dict[str, float]:
    """Rms misfits over the quantities' rms; in files that do not state these, over that of the model itself."""
    quantities = {
        "force": (misfit.force_share, misfit.force_rms_N, magnetics.force),
        "flux linkage": (misfit.flux_linkage_share, misfit.flux_linkage_rms_Wb, magnetics.flux_linkage),
        "inductance": (misfit.inductance_share, misfit.inductance_rms_H, magnetics.inductance),
    }
    return {
        about: error / max(rms(quantity(d, i)), 1e-300) if share is None else share
        for about, (share, error, quantity) in quantities.items()
        if error is not None and (share is not None or quantity(d, i).size)  # a pair of magnets links no flux
    }


def _signs(model: ActuatorModel, d: FloatArray, i: FloatArray) -> list[AuditFinding]:
    state = model.magnetics.state(d, i)
    if i.shape[1] > 1:
        # Whether the currents of several circuits have energy, whatever they are
        least = float(np.linalg.eigvalsh(state.inductance).min())
        diagonal = np.diagonal(state.inductance, axis1=1, axis2=2)
        numbers = {"several": True, "least_H": float(diagonal.min()), "largest_H": float(diagonal.max())}
        severity: Severity = "holds" if least > 0.0 else "wrong"
        return [AuditFinding("inductance", severity, "flux linkages", None, least, numbers)]
    slope = state.motional_constant[:, 0]
    pushing = float(np.mean((slope <= 0.0) & (i[:, 0] != 0.0)))  # steel alone has dF/di = 0 without a current
    severity = "note" if pushing else "holds"
    everywhere = {"everywhere": bool(slope.min() > 0.0)}
    attraction = AuditFinding("attraction", severity, "force", None, 1.0 - pushing, everywhere)
    least = float(state.inductance.min())
    numbers = {"several": False, "least_H": least, "largest_H": float(state.inductance.max())}
    severity = "holds" if least > 0.0 else "wrong"
    return [attraction, AuditFinding("inductance", severity, "flux linkage", None, least, numbers)]


def _positive(model: ActuatorModel) -> list[AuditFinding]:
    """What must be above zero in circuit and motion."""
    negative = []
    for circuit in model.circuits:
        of = f" of {circuit.name}" if len(model.circuits) > 1 else ""
        span = circuit.voltage_max_V - circuit.voltage_min_V
        values = {"resistance_ohm": circuit.resistance_ohm, "voltage_max_V - voltage_min_V": span}
        negative += [f"{name}{of}" for name, value in values.items() if value <= 0.0]
    if model.motion is not None and model.motion.mass_kg <= 0.0:
        negative.append("mass_kg")
    return [AuditFinding("positive", "wrong", name) for name in negative]


def _reciprocity(magnetics: Magnetics, d: FloatArray, i: FloatArray) -> AuditFinding:
    """dF/di against -d(flux linkage)/dd, each by differences of the quantity itself."""
    step_d, step_i = 1e-4 * float(np.ptp(d)), 1e-4 * (float(np.ptp(i)) or 1.0)
    inside_d, inside_i = np.clip(d, d.min() + step_d, d.max() - step_d), np.clip(i, i.min() + step_i, i.max() - step_i)
    directions = step_i * np.eye(i.shape[1])
    slopes = [magnetics.force(inside_d, inside_i + s) - magnetics.force(inside_d, inside_i - s) for s in directions]
    force = np.stack(slopes, axis=-1) / (2 * step_i)
    flux = magnetics.flux_linkage(inside_d + step_d, inside_i) - magnetics.flux_linkage(inside_d - step_d, inside_i)
    flux = flux / (2 * step_d)
    off = float(np.abs(force + flux).max() / max(float(np.abs(force).max()), 1e-300))
    severity: Severity = "holds" if off < _RECIPROCITY else "wrong"
    return AuditFinding("reciprocity", severity, "force and flux linkage", None, off)


def _bounds(model: ActuatorModel) -> list[AuditFinding]:
    magnetics = model.without_effects.magnetics
    if not isinstance(magnetics, LawMagnetics):
        return []
    findings = []
    for c in magnetics.coefficients:
        name = f"coefficient {c.basis} i^{c.current_power}"
        if not c.bounds[0] <= c.value <= c.bounds[1]:
            findings.append(AuditFinding("outside_bounds", "wrong", name, c.value, numbers={"bounds": c.bounds}))
        elif c.active:
            findings.append(AuditFinding("active_bound", "note", name, c.value, numbers={"bound": c.active}))
    return findings


def _hall(sensor: HallSensor, rounding: float, d: FloatArray, i: FloatArray) -> list[AuditFinding]:
    """Whether the output stays within its range, and what the converter adds to the noise."""
    field = sensor.field.field(d, i)
    volts, where = sensor.output(d, i), where_clipped(sensor, d, i, field)
    clipped = float(np.mean((volts <= sensor.output_min_V) | (volts >= sensor.output_max_V)))
    numbers = {"output_V": (float(volts.min()), float(volts.max())), "clipped_where": where}
    findings = [AuditFinding("hall_range", "note" if clipped else "holds", "Hall output", None, clipped, numbers)]
    if sensor.noise_V > 0.0 and rounding > 0.0:
        severity: Severity = "holds" if rounding < sensor.noise_V else "note"
        findings.append(AuditFinding("hall_noise", severity, "Hall noise", sensor.noise_V, rounding))
    return findings
