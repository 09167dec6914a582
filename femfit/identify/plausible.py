"""Looks at a bench table beside a model before it is compared: what is clipped, lone outliers, and wrong columns.

A column is suspected of a wrong unit or sign, of a factor, or of another zero of the distance where the readings would
then fit the model far better.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
from scipy import optimize

from femfit.core.errors import TableError
from femfit.core.numerics import BoolArray, FloatArray
from femfit.core.results import Finding
from femfit.core.sweep_columns import current_columns
from femfit.core.text import rounded
from femfit.effects.catalogue import effect_by_name
from femfit.effects.conditions import Conditions
from femfit.estimate.record_checks import suspect_settings
from femfit.identify.settings import currents_in
from femfit.identify.words import finding, sentence
from femfit.model.actuator_model import ActuatorModel
from femfit.model.hall import HallSensor
from femfit.model.magnetics import CoenergySpline
from femfit.model.readings import predict_readings
from femfit.model.several_magnetics import CoenergyMatrix
from femfit.model.validity import ValidityBox
from femfit.model.with_effects import nominal_of
from femfit.tables.measurement import BenchTable, Measurement
from femfit.tables.outliers import without_outliers
from femfit.tables.units import LEAST_READINGS, OTHER_SIGN, common_factors, other_sign, suspicion

CLEARLY, WELL = 0.2, 0.3
"""Assumed: a suspicion must leave less than these parts of the misfit as it stands, and of the readings' own spread."""

WRONG_FACTOR = 1.5
"""Assumed: a factor nearer to 1 is a tolerance of the drawing, which the diagnosis names."""

EXACTLY = 0.05
"""Assumed: the part of the misfit that a wrong column leaves; an effect that resembles a factor leaves more."""

BEYOND_MOUNTING = 1.2
"""Assumed: times the usual range of the effect distance_offset from which a shift is a wrong zero and no mounting."""

LARGEST_SHIFT, SHIFTS = 0.5, 41
"""Assumed: part of the travel up to which the zero of the distance is looked for, and at how many places."""

NOTHING_LEFT = 1e9
"""Numerical: left where too few rows remain, so that no such shift is taken."""

KEPT_ROWS = 0.7
"""Assumed: part of the rows that must lie in the validity domain after a shift."""

DOMAIN_SLACK = 0.02
"""Assumed: by how much of its width a validity domain may be left; a stage's zero error at the border of the sweep."""


Predict = Callable[[FloatArray, FloatArray], Mapping[str, FloatArray]]


def suspected_zero(
    model: ActuatorModel, d: FloatArray, i: FloatArray, reads: Mapping[str, FloatArray], predict: Predict
) -> Finding | None:
    """Suspect that the distance is counted from another place than the electromagnet's face."""
    box, of_the_circuit = model.without_effects.validity, {"voltage_V", "resistance_ohm"}
    travel = box.distance_max_m - box.distance_min_m
    reads = {name: read for name, read in reads.items() if name not in of_the_circuit and np.isfinite(read).any()}
    # A shift meets a few settings whatever is wrong
    if not reads or len(np.unique(np.column_stack([d, i]), axis=0)) < LEAST_READINGS:
        return None
    low, high = box.distance_min_m - DOMAIN_SLACK * travel, box.distance_max_m + DOMAIN_SLACK * travel
    recorded, usual = (d >= low) & (d <= high), predict(d, i)
    # Of readings and predictions together: readings alone may be constant, as in hovering
    together = {name: np.append(read, usual[name][recorded]) for name, read in reads.items()}
    spreads = pd.DataFrame(together).std(ddof=0).clip(lower=np.finfo(float).tiny)

    def misfit(rows: BoolArray, predicted: Mapping[str, FloatArray]) -> float:
        """The largest root mean square error of a channel, over its spread."""
        errors = pd.DataFrame({name: read[rows] - predicted[name] for name, read in reads.items()})
        return float(np.nan_to_num(((errors**2).mean() ** 0.5 / spreads).max()))

    def left(shift: float) -> float:
        inside = (d + shift >= low) & (d + shift <= high)
        if inside.mean() < KEPT_ROWS or (recorded & ~inside).any():
            return NOTHING_LEFT
        return misfit(inside, predict(d[inside] + shift, i[inside]))

    before = misfit(np.ones(len(d), dtype=bool), usual)
    largest, step = LARGEST_SHIFT * travel, 2.0 * LARGEST_SHIFT * travel / (SHIFTS - 1)
    best = min(np.linspace(-largest, largest, SHIFTS).tolist(), key=left)
    minimum = optimize.minimize_scalar(left, bounds=(best - step, best + step), method="bounded")
    shift = float(minimum.x)
    usual_range = max(abs(end) for end in effect_by_name("distance_offset").parameters[0].plausible)
    if abs(shift) < BEYOND_MOUNTING * usual_range or not minimum.fun < min(WELL, EXACTLY * before):
        return None
    return finding("suspected-zero", "distance_m", shift, shift=shift)


def plausible_table(model: ActuatorModel, table: BenchTable) -> BenchTable:
    """Set aside what contradicts the model's sensors or all neighbours, and suspect wrong units and signs."""
    doubted = {finding.column for finding in table.findings if finding.code == "suspected-unit"}
    suspected = [finding for finding in suspect_units(model, table) if finding.column not in doubted]
    rows, clipped = table.rows, list[Finding]()
    if model.sensor is not None and "hall_V" in table.channels:
        sensor, values = model.sensor, rows["hall_V"].to_numpy()
        ended = at_ends_of_range(sensor, values)
        if count := int(ended.sum()):
            low, high = sensor.output_min_V, sensor.output_max_V
            slack = DOMAIN_SLACK * (high - low)
            beyond = int(np.sum((values < low - slack) | (values > high + slack)))
            facts: dict[str, Any] = {"low": low, "high": high, "beyond": beyond}
            facts |= {"least": float(np.nanmin(values)), "most": float(np.nanmax(values))}
            clipped.append(finding("clipped", "hall_V", float(count), readings=count, **facts))
            rows = rows.assign(hall_V=np.where(ended, np.nan, values))
    table = replace(table, rows=rows, findings=(*table.findings, *suspected, *clipped))
    if suspected or doubted:
        return table
    # Neighbours are sought over distance and one current
    if len(current_columns(model.current_names)) > 1 or "frequency_Hz" in table.given:
        return table
    placed = (rows["distance_m"].notna() & rows["current_A"].notna()).to_numpy()
    d, i = (rows[name].to_numpy()[placed] for name in ("distance_m", "current_A"))
    predicted = _predictor(model, table.channels)(d, i)
    full = pd.DataFrame(predicted, index=np.flatnonzero(placed)).reindex(range(len(rows)))
    return without_outliers(table, {str(name): values.to_numpy() for name, values in full.items()})


def suspect_units(model: ActuatorModel, table: BenchTable) -> list[Finding]:
    """Find units, signs, factors and a zero of the distance that make the table fit the model far better.

    There is one finding a column, and each names what would be wrong by how much.
    """
    rows = table.rows
    d, i = rows["distance_m"].to_numpy(), currents_in(model, rows)
    placed = np.isfinite(d) & np.isfinite(i).reshape(len(d), -1).all(axis=1)
    d, i, rows = d[placed], i[placed], rows[placed]
    if len(d) < LEAST_READINGS:
        return []
    settings = suspect_settings(model, d, i, current_columns(model.current_names))
    if settings:
        return settings
    frequency = rows["frequency_Hz"].to_numpy() if "frequency_Hz" in table.given else np.nan
    predict = _predictor(model, table.channels, frequency)
    usual, turned = predict(d, i), predict(d, -i)
    reads, turning = {name: rows[name].to_numpy() for name in table.channels if name in usual}, []
    for name, read in reads.items():  # whether turning the current round would be seen in a channel
        here = np.isfinite(read)
        change = (turned[name] - usual[name])[here]
        if here.sum() >= LEAST_READINGS and float(np.std(change)) > WELL * float(np.std(read[here])):
            turning.append(name)
    if turning and all(_explains(reads[name], usual[name], turned[name]) for name in turning):
        return [other_sign(f"{', '.join(turning)} would then fit the model")]
    suspected = [_suspected_channel(model, name, read, usual[name]) for name, read in reads.items()]
    if not any(suspected):
        runs = [(number, (rows["run"] == number).to_numpy()) for number in rows["run"].unique().tolist()]
        suspected = [
            _suspected_channel(model, name, np.where(of_run, read, np.nan), usual[name], number)
            for name, read in reads.items()
            for number, of_run in runs
        ]
    if not any(suspected) and "frequency_Hz" not in table.given:
        suspected = [suspected_zero(model, d, i, reads, predict)]
    return list(filter(None, suspected))


def _suspected_channel(
    model: ActuatorModel, name: str, read: FloatArray, usual: FloatArray, run: float | None = None
) -> Finding | None:
    """A unit, a sign or a factor by which all readings of a channel differ from the model's; of a run no factor."""
    base = model.without_effects  # whose factor is one that no tolerance of a drawing makes
    zero = base.sensor.quiescent_V if name == "hall_V" and base.sensor is not None else 0.0
    here = np.isfinite(read) & np.isfinite(usual)
    square = float(np.sum((usual - zero)[here] ** 2))
    factor = float((read - zero)[here] @ (usual - zero)[here]) / square if square > 0.0 else None
    for words, candidate in _candidates(name, usual, model.sensor).items():
        if _explains(read, usual, candidate):
            why = "it would then fit the model"
            if name != "hall_V" and factor:
                why = f"it is {rounded(factor)} times the model's, and would then fit"
            if run is None and words.startswith("in ") and " " not in words[3:]:
                return suspicion(name, words[3:], why)
            return finding("suspected-unit", name, name=name, other=words, why=why, run=run)
    if factor is None or run is not None or 1.0 / WRONG_FACTOR < abs(factor) < WRONG_FACTOR:
        return None
    if not _explains(read, usual, zero + factor * (usual - zero), EXACTLY, np.inf):
        return None
    ohms = None if base.circuit is None else base.circuit.resistance_ohm
    return finding("suspected-scale", name, factor, name=name, factor=factor, resistance_ohm=ohms)


def _predictor(model: ActuatorModel, channels: tuple[str, ...], frequency: FloatArray | float = np.nan) -> Predict:
    conditions = Conditions(nominal_of(model), frequency_Hz=frequency)
    return lambda d, i: predict_readings(model, d, i, conditions, channels=channels)


def _candidates(name: str, predicted: FloatArray, sensor: HallSensor | None) -> dict[str, FloatArray]:
    """What a channel would read if something usual were wrong with it."""
    result = {"of the other sign": -predicted}
    if name == "hall_V" and sensor is not None:
        signal, turned = predicted - sensor.quiescent_V, 2.0 * sensor.quiescent_V - predicted
        field = signal / sensor.sensitivity_V_per_T
        result = {
            "of the other polarity": np.clip(turned, sensor.output_min_V, sensor.output_max_V),
            "without its quiescent voltage": signal,
            "a field in T": field,
            "a field in mT": 1e3 * field,
            "a field in gauss": 1e4 * field,
        }
    for unit, factor in common_factors(name).items():
        result |= {f"in {unit}": predicted / factor, f"in {unit} and {OTHER_SIGN}": -predicted / factor}
    return result


def _explains(
    read: FloatArray, usual: FloatArray, candidate: FloatArray, of_misfit: float = CLEARLY, of_spread: float = WELL
) -> bool:
    """Whether a candidate leaves less than these parts of the misfit as it stands, and of the readings' spread."""
    here = np.isfinite(read)
    if here.sum() < LEAST_READINGS:
        return False
    misfit, before = (float(np.sqrt(np.mean((read - values)[here] ** 2))) for values in (candidate, usual))
    spread = float(np.std(read[here]))
    return misfit < of_misfit * before and (np.isinf(of_spread) or misfit < of_spread * spread)


def at_ends_of_range(sensor: HallSensor, volts: FloatArray) -> BoolArray:
    """Hall voltages within a step of the converter, or a thousandth where there is none, of an end of the output."""
    step = sensor.quantisation_step or 1e-3 * (sensor.output_max_V - sensor.output_min_V)
    return np.asarray((volts <= sensor.output_min_V + step) | (volts >= sensor.output_max_V - step))


def within_domain(model: ActuatorModel, distance: FloatArray, current: FloatArray) -> BoolArray:
    """Where a model may be compared with a bench: its validity domain, a little beyond, and what is exact beyond.

    A co-energy of second degree in the current can be carried on to any current, unless the drawing's iron saturates;
    there only the distances are limited.

    It is false where either setting is not a number.
    """
    base = model.without_effects
    box, magnetics = base.validity, base.magnetics
    slack = DOMAIN_SLACK * (box.distance_max_m - box.distance_min_m)
    inside = (distance >= box.distance_min_m - slack) & (distance <= box.distance_max_m + slack)
    quadratic = isinstance(magnetics, CoenergyMatrix) or (
        isinstance(magnetics, CoenergySpline)
        and (magnetics.spline.y_degree <= 2 and len(np.unique(magnetics.spline.y_knots)) == 2)
    )
    if quadratic and not (base.kind and base.kind.saturates):
        return np.asarray(inside & np.isfinite(current).reshape(len(inside), -1).all(axis=1))
    return np.asarray(inside & within_currents(box, current))


def within_currents(box: ValidityBox, current: FloatArray) -> BoolArray:
    """Which currents a model was fitted to, with a little beyond."""
    columns, limits = current.reshape(len(current), -1), box.column_limits_A
    slack = DOMAIN_SLACK * np.ptp(limits, axis=1)
    return np.asarray(((columns >= limits[:, 0] - slack) & (columns <= limits[:, 1] + slack)).all(axis=1))


def require_known_settings(model: ActuatorModel, measured: Measurement) -> None:
    """Refuse an error of distance or current that was declared as large as the model's whole range of it."""
    box = model.without_effects.validity
    ranges = (box.distance_max_m - box.distance_min_m, *np.ptp(box.column_limits_A, axis=1).tolist())
    for name, width in zip(("distance_m", *current_columns(model.current_names)), ranges, strict=True):
        error = measured.declared_noise.get(name, 0.0)
        if error > width > 0.0:
            raise TableError(sentence("refusals", "whole_range", name, width, error))


def nothing_in_domain(model: ActuatorModel, source: str, distance: FloatArray, current: FloatArray) -> str:
    """Say where the model holds, where readings outside of it are, and what their units may be."""
    box, names = model.without_effects.validity, current_columns(model.current_names)
    columns = current.reshape(len(distance), -1).T
    currents = zip(names, box.column_limits_A.tolist(), columns, strict=True)
    suspected = suspect_settings(model, distance, current, names)
    return sentence("refusals", "outside", source, box, distance, currents, suspected)
