"""Checks of a model as its file holds it: misfit, signs, the range that its supply can hold, its sensor."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from femfit.audit.conclusions import Audit, AuditFinding, Severity
from femfit.core.errors import DomainError, ModelFileError, TableError
from femfit.core.numerics import FloatArray
from femfit.core.results import listing
from femfit.core.sweep_columns import current_columns
from femfit.device.electrics import where_clipped
from femfit.device.parts import REFERENCE_TEMPERATURE, copper_growth
from femfit.estimate.holding import bias_currents, holding_currents
from femfit.fit.constants import DOMAIN_GRID, POOR_POINT
from femfit.fit.ranking import is_coarse, misfit_to_rows
from femfit.fit.rows import FitRows, rms, rows_of_table
from femfit.model.actuator_model import ActuatorModel
from femfit.model.hall import HallSensor
from femfit.model.json_file import read_model
from femfit.model.magnetics import LawMagnetics
from femfit.model.sensors import HALL, reading_of
from femfit.tables.sweep_table import TABLE_STEM, current_names, read_sweep_table

_LARGE_MISFIT = 0.1
"""Share of a quantity's rms from which a model that misses its table by it is wrong; conventional."""

_MOSTLY = 0.5
"""Part of a table's rows within the model's domain below which it is not the model's own; conventional."""


def audit_model(model: ActuatorModel | str | Path, table: str | Path | None = None) -> Audit:
    """Check a model on its own, and against the sweep table that it was fitted to where that is at hand.

    Without a table it is the one in the model file's directory. Rows outside of the model's domain do not count.
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
    d, i = model.validity.grid(*DOMAIN_GRID)
    findings += [*_misfit(model, rows, d, i), *_between_points(model)]
    if model.has_winding:
        findings += _signs(model, d, i)
    findings += _bounds(model)
    if model.circuits and model.motion is not None:
        findings += held_body(model)
    if model.sensor is not None:
        findings += _hall(model.sensor, reading_of(model, HALL).rounding, d, i)
    return Audit(tuple(findings))


def _rows_of(path: Path, model: ActuatorModel) -> FitRows:
    table, names = read_sweep_table(path), current_columns(model.current_names)
    columns = current_names(table.rows)
    if columns != names:
        raise TableError(
            f"{path} must have the current of each circuit of the model ({listing(names)}); it has "
            f"{listing(columns)}. Give the table that the model was fitted to."
        )
    rows = rows_of_table(table, kind=model.kind)
    inside = model.validity.contains(rows.distance, rows.circuit_currents[:, : len(model.validity.current_limits_A)])
    within = rows.take(inside)
    if np.mean(inside) < _MOSTLY or not within.force.any():
        raise TableError(
            f"{path} must have most of its rows, and forces, where the model holds; {int(inside.sum())} of "
            f"{len(inside)} rows are. Give the table that the model was fitted to."
        )
    return within


def _between_points(model: ActuatorModel) -> list[AuditFinding]:
    """What is to be expected between the points of its sweep of a co-energy that saturates."""
    between = model.misfit and model.misfit.between
    if not between or between.inductance_share is None:
        return []
    severity: Severity = "note" if is_coarse(between) else "stated"
    largest = max(between.force_share, between.inductance_share)
    return [AuditFinding("missed_between", severity, "co-energy", None, largest, asdict(between))]


def _misfit(model: ActuatorModel, rows: FitRows | None, d: FloatArray, i: FloatArray) -> list[AuditFinding]:
    """How far the model is from its table: recomputed where that is at hand, else as the file states it.

    As rms over the quantities' rms; in files that do not state these, over that of the model itself. Of several
    circuits also at the point of the table whose force it misses most, beside that force.
    """
    base, findings = model.without_effects, []
    misfit = base.misfit if rows is None else misfit_to_rows(base, rows)
    if misfit is None:
        return []
    quantities = {
        "force": (misfit.force_share, misfit.force_rms_N, base.magnetics.force),
        "flux linkage": (misfit.flux_linkage_share, misfit.flux_linkage_rms_Wb, base.magnetics.flux_linkage),
        "inductance": (misfit.inductance_share, misfit.inductance_rms_H, base.magnetics.inductance),
    }
    for about, (stated, error, quantity) in quantities.items():
        if error is not None and (stated is not None or quantity(d, i).size):  # a pair of magnets links no flux
            share = error / max(rms(quantity(d, i)), 1e-300) if stated is None else stated
            right: Severity = "stated" if rows is None else "holds"
            numbers = {"against": misfit.against if rows is None else None}
            severity = "wrong" if share > _LARGE_MISFIT else right
            findings.append(AuditFinding("misfit", severity, about, None, share, numbers))
    if rows is not None and rows.several:
        force = base.magnetics.force(rows.distance, rows.circuit_currents)
        missed = np.abs(force - rows.force) / rows.force_scale
        k = int(np.argmax(missed))
        place = {"distance_m": float(rows.distance[k]), "currents_A": rows.circuit_currents[k].tolist()}
        severity = "wrong" if missed[k] > _LARGE_MISFIT else "note" if missed[k] > POOR_POINT else "holds"
        point: dict[str, Any] = {"share": float(missed[k]), **place}
        findings.append(AuditFinding("point_misfit", severity, "force", float(rows.force[k]), float(force[k]), point))
    return findings


def _signs(model: ActuatorModel, d: FloatArray, i: FloatArray) -> list[AuditFinding]:
    state, several, findings = model.magnetics.state(d, i), i.shape[1] > 1, []
    if not several:
        # Without a magnet a current of either sign attracts
        slope = state.motional_constant[:, 0] * (1.0 if model.has_magnet else np.sign(i[:, 0]))
        pushing = float(np.mean((slope <= 0.0) & (i[:, 0] != 0.0)))  # steel alone has dF/di = 0 without a current
        severity: Severity = "note" if pushing else "holds"
        everywhere = {"everywhere": bool(slope.min() > 0.0)}
        findings.append(AuditFinding("attraction", severity, "force", None, 1.0 - pushing, everywhere))
    # Whether the currents have energy, whatever they are
    least = float(np.linalg.eigvalsh(state.inductance).min())
    diagonal = np.diagonal(state.inductance, axis1=1, axis2=2)
    numbers = {"several": several, "least_H": float(diagonal.min()), "largest_H": float(diagonal.max())}
    about, severity = "flux linkages" if several else "flux linkage", "holds" if least > 0.0 else "wrong"
    return [*findings, AuditFinding("inductance", severity, about, None, least, numbers)]


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
    volts, where = sensor.output(d, i), where_clipped(sensor, d, field)
    clipped = float(np.mean((volts <= sensor.output_min_V) | (volts >= sensor.output_max_V)))
    numbers = {"output_V": (float(volts.min()), float(volts.max())), "clipped_where": where}
    findings = [AuditFinding("hall_range", "note" if clipped else "holds", "Hall output", None, clipped, numbers)]
    if sensor.noise_V > 0.0 and rounding > 0.0:
        severity: Severity = "holds" if rounding < sensor.noise_V else "note"
        findings.append(AuditFinding("hall_noise", severity, "Hall noise", sensor.noise_V, rounding))
    return findings


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
