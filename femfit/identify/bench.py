"""Places a measurement beside a model: a bench table by its rows, a record over time by its windows.

Of a bench table these are the readings that can be compared, and what the effects need to know of each row.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from femfit.core.errors import TableError
from femfit.core.numerics import BoolArray, FloatArray
from femfit.core.results import Finding
from femfit.core.sweep_columns import current_columns
from femfit.effects.catalogue import all_effects
from femfit.effects.conditions import Conditions, Nominal
from femfit.effects.effect import AddedEffect
from femfit.identify.constants import IN_ORDER, MOST_ROWS
from femfit.identify.impedance import near_bias, weighed_by_magnitude
from femfit.identify.observations import TEMPERATURES, Observations, Stacking, circumstances, model_tolerance
from femfit.identify.plausible import (
    nothing_in_domain,
    plausible_table,
    require_known_settings,
    within_currents,
    within_domain,
)
from femfit.identify.series.observations import series_observations
from femfit.identify.settings import averaged, currents_in, with_currents
from femfit.identify.words import finding, sentence
from femfit.model.actuator_model import ActuatorModel
from femfit.model.readings import Parameter, Point, readings_by, setting_slopes
from femfit.model.with_effects import nominal_of
from femfit.tables.header import parts_of
from femfit.tables.measurement import STILL_CURRENT, BenchTable, Measurement, TimeSeries
from femfit.tables.measurement_file import read_measurement


def bench_observations(model: ActuatorModel, table: BenchTable) -> Observations:
    """Place a bench table beside a model: the rows in its validity domain, and the channels that it predicts."""
    table = with_currents(model, table)
    inside, findings = _comparable(model, table)
    measured, declared = table.rows[inside].reset_index(drop=True), table.declared_noise
    covariates, point = _point(model, measured)
    reading, nominal = readings_by(point, (), table.channels), point.conditions.nominal
    channels = tuple(name for name in table.channels if name in reading and measured[name].notna().any())
    if not channels:
        raise TableError(sentence("refusals", "no_channel", table.source, list(reading)))
    rows = {name: np.flatnonzero(np.isfinite(measured[name].to_numpy())) for name in channels}
    weighing = weighed_by_magnitude(point, channels, declared)
    stacked = Stacking(rows, {name: weight[rows[name]] for name, weight in weighing.weight.items()})
    slope, curvature, *by_current = stacked(setting_slopes(point, channels)).T
    if nominal.springs is not None and "force_N" in channels:
        unexplained = measured["force_N"].to_numpy() - reading["force_N"][0]
        if np.nansum((unexplained + nominal.push_of_springs(point.distance)) ** 2) < np.nansum(unexplained**2):
            findings.append(finding("drawn-spring", "force_N"))  # the sensor may carry the spring
    own_misfit, everywhere = model_tolerance(model), np.ones(len(measured))
    tolerance = {name: own_misfit.get(parts_of(name)[0], 0.0) * everywhere for name in channels}
    settings = "distance_m", *current_columns(model.current_names)
    uncertain = [along * declared.get(name, 0.0) for name, along in zip(settings, (slope, *by_current), strict=False)]
    return Observations(
        channels=channels,
        channel=stacked.channel,
        row=np.concatenate(list(rows.values())),
        value=stacked({name: measured[name].to_numpy(dtype=np.float64) for name in channels}),
        covariates=covariates,
        given=table.given,
        prediction=_BenchPrediction(point, stacked),
        distance_slope=slope,
        distance_curvature=curvature,
        nominal=nominal,
        declared_noise={**declared, **weighing.noise},
        tolerance=stacked({**tolerance, **weighing.tolerance}),
        setting_columns=np.stack(uncertain, axis=1),
        findings=(*findings, *weighing.findings),
        present=tuple(added.effect.name for added in model.effects),
        noise_source=table.noise_source,
        magnitude=weighing.magnitude,
        weight=stacked(dict.fromkeys(channels, everywhere)),
    )


def _comparable(model: ActuatorModel, table: BenchTable) -> tuple[BoolArray, list[Finding]]:
    """Which rows can be compared, and what is said of the others and of those at the border.

    Raises
    ------
    TableError
        If there is none.
    """
    findings, box = list(table.findings), model.without_effects.validity
    d, i = table.rows["distance_m"].to_numpy(), currents_in(model, table.rows)
    placed_rows = np.isfinite(d) & np.isfinite(i).reshape(len(d), -1).all(axis=1)
    if "frequency_Hz" in table.given:
        placed_rows &= np.isfinite(table.rows["frequency_Hz"].to_numpy())
    within = placed_rows & within_domain(model, d, i)
    if not within.any():
        raise TableError(nothing_in_domain(model, table.source, d[placed_rows], i[placed_rows]))
    inside = within.copy()
    if "frequency_Hz" in table.given:
        inside[within], remark = near_bias(model, d[within], i[within])
        if not inside.any():
            raise TableError(f"{table.source} has no row that can be compared. {remark}")
        findings += filter(None, [remark])
    if not placed_rows.all():
        findings.append(finding("no-setting", rows=int((~placed_rows).sum())))
    if outside := int((placed_rows & ~within).sum()):
        findings.append(finding("outside-domain", rows=outside))
    if beyond := int((inside & ~within_currents(box, i)).sum()):
        facts: dict[str, Any] = {
            "quadratic": model.without_effects.kind is None,
            "limits": box.column_limits_A.tolist(),
        }
        findings.append(finding("extrapolated", beyond=beyond, rows=int(inside.sum()), **facts))
    return inside, findings


def _point(model: ActuatorModel, rows: pd.DataFrame) -> tuple[pd.DataFrame, Point]:
    """Covariates of rows of a bench table, and the model there."""
    covariates = _covariates(rows, current_columns(model.current_names))
    conditions, currents = conditions_of(covariates, nominal_of(model)), currents_in(model, covariates)
    return covariates, Point(model, covariates["distance_m"].to_numpy(), currents, conditions, model.effects)


@dataclass(frozen=True, eq=False)
class _BenchPrediction:
    """What a model predicts of a bench table's readings, as one vector."""

    point: Point  # Of the table's rows
    stacked: Stacking

    def __call__(self, effects: Sequence[AddedEffect], parameters: Sequence[Parameter]) -> FloatArray:
        present = self.point.effects
        point = replace(self.point, effects=(*present, *effects))
        places = [(len(present) + k, name) for k, name in parameters]
        return self.stacked(readings_by(point, places, tuple(self.stacked.rows)))


def _covariates(rows: pd.DataFrame, currents: Sequence[str]) -> pd.DataFrame:
    """Settings with runs and mounts numbered from 0, and both clocks."""
    run = pd.factorize(rows["run"])[0]
    mount = pd.factorize(rows["mount"].where(rows["mount"].notna(), rows["run"]))[0]
    place, order = pd.Series(run).groupby(run).cumcount().to_numpy(), rows["order"].to_numpy()
    order = np.where(np.isfinite(order), order, place)
    by_run = pd.Series(order).groupby(run)
    first, last = (by_run.agg(end).to_numpy() for end in ("min", "max"))
    within, elapsed = order - first[run], order - order.min()
    if (np.diff(first) <= 0.0).any():  # an order that starts anew with each run counts on from the run before
        elapsed = within + np.append(0.0, np.cumsum(last - first + 1.0)[:-1])[run]
    settings = ("distance_m", *dict.fromkeys(["current_A", *currents]), "branch", *TEMPERATURES)
    at_frequencies = "frequency_Hz" in rows and bool(rows["frequency_Hz"].notna().any())
    covariates = rows[[*settings, *(("frequency_Hz",) * at_frequencies)]].astype(np.float64).reset_index(drop=True)
    return covariates.assign(run=run, mount=mount, order=within, elapsed=elapsed).fillna({"branch": 0.0})


def conditions_of(covariates: pd.DataFrame, nominal: Nominal) -> Conditions:
    """What effects need to know of every row of the covariates; a temperature that was not recorded is NaN."""
    return Conditions(
        nominal=nominal,
        **circumstances(covariates, ("run", "distance_m")),
        time_s=covariates["order"].to_numpy(),
        elapsed=covariates["elapsed"].to_numpy(),
        recalled=_recalled(covariates, nominal),
        frequency_Hz=covariates["frequency_Hz"].to_numpy() if "frequency_Hz" in covariates else np.nan,
    )


def _recalled(covariates: pd.DataFrame, nominal: Nominal) -> Mapping[str, FloatArray]:
    """What the effects recall of the order of measuring; nothing where the branches contradict it."""
    in_order = covariates.sort_values(["run", "order"], kind="stable")
    current, run = in_order["current_A"].to_numpy(), in_order["run"].to_numpy()
    begins = np.append(True, run[1:] != run[:-1])
    path, still = current.copy(), STILL_CURRENT * np.ptp(current)
    for k in np.flatnonzero(~begins):
        if abs(current[k] - path[k - 1]) <= still:
            path[k] = path[k - 1]
    step, branch = np.where(begins, 0.0, np.diff(path, prepend=path[0])), in_order["branch"].to_numpy()
    same_place = np.append(False, np.diff(in_order["distance_m"].to_numpy()) == 0.0)
    # A branch that changes while the current stands still contradicts the order, but for a turning point read twice
    moving = same_place & (branch != 0.0) & ((step != 0.0) | np.append(False, branch[1:] != branch[:-1]))
    if not moving.any() or np.mean(np.sign(step[moving]) == branch[moving]) < IN_ORDER:
        return {}
    place = np.argsort(in_order.index.to_numpy())
    return {
        name: values[place]
        for effect in all_effects().values()
        if effect.memory is not None and effect.memory.recall is not None
        for name, values in effect.memory.recall(path, begins, nominal).items()
    }


def measurement_of(data: Measurement | str | Path) -> Measurement:
    """The measurement, read where a path is given."""
    return data if isinstance(data, BenchTable | TimeSeries) else read_measurement(data)


def placed(model: ActuatorModel, data: Measurement | str | Path) -> Observations:
    """Place a measurement beside a model, what contradicts the model's sensors set aside.

    Raises
    ------
    TableError
        If a bench table has so many rows that a comparison takes hours, or no reading that the model predicts.
    """
    data = measurement_of(data)
    if isinstance(data, TimeSeries):
        return series_observations(model, data)
    require_known_settings(model, data)
    data = plausible_table(model, with_currents(model, data))
    data = averaged(data, current_columns(model.current_names), partial(_residuals, model))
    if len(data.rows) > MOST_ROWS:
        raise TableError(sentence("refusals", "many_rows", data.source, len(data.rows)))
    return bench_observations(model, data)


def _residuals(model: ActuatorModel, table: BenchTable) -> dict[str, FloatArray]:
    """Readings less what the model predicts, by channel."""
    _, point = _point(model, table.rows)
    predicted = readings_by(point, (), table.channels)
    return {name: table.rows[name].to_numpy() - predicted[name][0] for name in table.channels if name in predicted}
