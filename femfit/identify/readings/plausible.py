"""A bench table beside a model, before it is compared: clipped readings, lone outliers, units and signs suspected."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import pandas as pd

from femfit.core.arrays import BoolArray, FloatArray
from femfit.core.constants import GRAVITY
from femfit.effects.conditions import Conditions
from femfit.model.actuator_model import ActuatorModel, HallSensor
from femfit.model.readings import predict_readings
from femfit.model.with_effects import nominal_of
from femfit.tables.measurement import BenchTable
from femfit.tables.measurement_checks import without_outliers

Predict = Callable[[FloatArray, FloatArray], Mapping[str, FloatArray]]

SUSPECTED = " seems to be "
"""In every sentence that suspects a unit or a sign, and in no other: what a reader must know first."""

_LEAST_READINGS = 8
_CLEARLY, _WELL = 0.2, 0.3
"""A suspicion must leave less than these parts of the misfit as it stands, and of the readings' own spread."""

_MM, _INCH = 1e-3, 25.4e-3

_FACTORS: dict[str, dict[float, str]] = {
    "force_N": {
        1e3: "in mN",
        1e6: "in uN",
        1.0 / GRAVITY: "in kgf",
        1e3 / GRAVITY: "in gf (gram-force)",
        1.0 / 4.4482216: "in lbf",
        16.0 / 4.4482216: "in ozf",
    },
    "flux_linkage_Wb": {1e3: "in mWb", 1e6: "in uWb", 1e8: "in maxwell"},
    "hall_V": {1e3: "in mV"},
    "voltage_V": {1e3: "in mV"},
}
_SETTINGS: dict[str, dict[float, str]] = {
    "distance_m": {_MM: "in mm", 1e-2: "in cm", 1e-6: "in um", _INCH: "in inches"},
    "current_A": {1e-3: "in mA", -1.0: "of the other sign (positive current attracts)"},
}


def plausible_table(model: ActuatorModel, table: BenchTable) -> BenchTable:
    """A table with what contradicts the model's sensors or all neighbours set aside, and wrong units suspected.

    Returns
    -------
    BenchTable
        With a sentence for everything that was set aside or is suspected.
    """
    rows, findings = table.rows, suspect_units(model, table)
    if model.sensor is not None and "hall_V" in table.channels:
        rows, said = _within_rails(rows, model.sensor)
        findings += said
    if findings:
        return replace(table, rows=rows, findings=(*table.findings, *findings))
    placed = (rows["distance_m"].notna() & rows["current_A"].notna()).to_numpy()
    predicted = _predictor(model)(rows["distance_m"].to_numpy()[placed], rows["current_A"].to_numpy()[placed])
    for name in (name for name in table.channels if name in predicted):
        residual = np.full(len(rows), np.nan)
        residual[placed] = rows[name].to_numpy()[placed] - predicted[name]
        values, said = without_outliers(rows, name, residual)
        rows, findings = rows.assign(**{name: values}), findings + said
    return replace(table, rows=rows, findings=(*table.findings, *findings))


def suspect_units(model: ActuatorModel, table: BenchTable) -> list[str]:
    """Units and signs of columns that would make the table fit the model far better.

    Returns
    -------
    list of str
        One plain sentence a column; none where all are as they should be.
    """
    rows = table.rows
    d, i = rows["distance_m"].to_numpy(), rows["current_A"].to_numpy()
    placed = np.isfinite(d) & np.isfinite(i)
    d, i, rows = d[placed], i[placed], rows[placed]
    if len(d) < _LEAST_READINGS:
        return []
    settings = [*_outside(model, d, "distance_m"), *_outside(model, i, "current_A")]
    if settings:
        return settings
    predict = _predictor(model)
    usual, turned = predict(d, i), predict(d, -i)
    names = [name for name in table.channels if name in usual]
    turning = [name for name in names if _changes(rows[name].to_numpy(), usual[name], turned[name])]
    if turning and all(_explains(rows[name].to_numpy(), usual[name], turned[name]) for name in turning):
        return [f"current_A{SUSPECTED}{_SETTINGS['current_A'][-1.0]}: {', '.join(turning)} would then fit the model."]
    findings = []
    for name in names:
        for words, candidate in _candidates(name, usual[name], model.sensor).items():
            if _explains(rows[name].to_numpy(), usual[name], candidate):
                findings.append(f"{name}{SUSPECTED}{words}: it would then fit the model. Convert the column.")
                break
    return findings


def _predictor(model: ActuatorModel) -> Predict:
    at = Conditions(nominal_of(model))
    base = model.without_effects
    return lambda d, i: predict_readings(base, d, i, at, ())


def _outside(model: ActuatorModel, values: FloatArray, name: str) -> list[str]:
    """A setting that lies outside of the model's range, and inside once its unit is taken for another."""
    box = model.without_effects.validity
    ends = {
        "distance_m": (box.distance_min_m, box.distance_max_m),
        "current_A": (box.current_min_A, box.current_max_A),
    }
    low, high = ends[name]
    slack = 0.05 * (high - low)

    def inside(x: FloatArray) -> BoolArray:
        return np.asarray((x >= low - slack) & (x <= high + slack))

    for factor, words in _SETTINGS[name].items():
        now, then = inside(values), inside(factor * values)
        either = now & then  # no current is none in any unit
        if now[~either].sum() < 0.2 * len(values) and then.mean() > 0.8 and (then & ~now).sum() >= _LEAST_READINGS:
            return [
                f"{name}{SUSPECTED}{words}: few rows lie in the model's range, but then they would. Convert the column."
            ]
    return []


def _candidates(name: str, predicted: FloatArray, sensor: HallSensor | None) -> dict[str, FloatArray]:
    """What a channel would read if something usual were wrong with it."""
    result = {"of the other sign": -predicted}
    if name == "hall_V" and sensor is not None:
        field = (predicted - sensor.quiescent_V) / sensor.sensitivity_V_per_T
        result = {
            "of the other polarity": np.clip(
                2.0 * sensor.quiescent_V - predicted, sensor.output_min_V, sensor.output_max_V
            ),
            "without its quiescent voltage": predicted - sensor.quiescent_V,
            "a field in T": field,
            "a field in mT": 1e3 * field,
            "a field in gauss": 1e4 * field,
        }
    for factor, words in _FACTORS[name].items():
        result[words] = factor * predicted
        result[f"{words} and of the other sign"] = -factor * predicted
    return result


def _explains(read: FloatArray, usual: FloatArray, candidate: FloatArray) -> bool:
    """Whether a candidate leaves far less than the prediction as it stands, and little of the readings' spread."""
    here = np.isfinite(read)
    if here.sum() < _LEAST_READINGS:
        return False
    read, usual, candidate = read[here], usual[here], candidate[here]
    left = float(np.sqrt(np.mean((read - candidate) ** 2)))
    spread = float(np.std(read))
    return left < _CLEARLY * float(np.sqrt(np.mean((read - usual) ** 2))) and left < _WELL * spread


def _changes(read: FloatArray, usual: FloatArray, turned: FloatArray) -> bool:
    """Whether turning the current round would be seen in a channel."""
    here = np.isfinite(read)
    if here.sum() < _LEAST_READINGS:
        return False
    return float(np.std((turned - usual)[here])) > _WELL * float(np.std(read[here]))


def _within_rails(rows: pd.DataFrame, sensor: HallSensor) -> tuple[pd.DataFrame, list[str]]:
    """The Hall output without readings at the ends of its range, where it was clipped."""
    step = sensor.quantisation_step or 1e-3 * (sensor.output_max_V - sensor.output_min_V)
    values = rows["hall_V"].to_numpy()
    clipped = (values <= sensor.output_min_V + step) | (values >= sensor.output_max_V - step)
    if not clipped.any():
        return rows, []
    count = int(clipped.sum())
    text = (
        f"{count} reading{'s' * (count > 1)} of hall_V at the ends of the output's range ({sensor.output_min_V:g} to "
    )
    text += f"{sensor.output_max_V:g} V) {'were' if count > 1 else 'was'} set aside: there it is clipped."
    return rows.assign(hall_V=np.where(clipped, np.nan, values)), [text]
