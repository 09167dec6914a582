"""Places a measurement beside a model: a bench table by its rows, a record over time by its windows.

Of a bench table these are the readings that can be compared; impedances are weighed.

An instrument's errors of resistance and reactance go with the magnitude |Z|. Readings, predictions and slopes are
multiplied by a magnitude that is usual over |Z| of each reading, so that a channel has one noise: by the winding's
resistance, and for an inductance by its own over |Z| / w.

Eddy currents beside iron that saturates were solved about a bias. Away from it the iron has another permeability, by a
factor that the model does not know. Skin layers go with the product of permeability and conductivity, so that the
impedance is off as if the iron conducted otherwise: by about x = |lambda(d, i) - lambda(d, b(d))| / lambda_s in the
logarithm, lambda_s a flux linkage that begins to saturate the iron. A solid lifting magnet of 1010 that was solved
about 2.5 and 3.0 A is off at 1.3 and 1.6 A by 0.44 and 0.46, where x is 0.47.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from femfit.core.errors import TableError
from femfit.core.numerics import BIAS_SHARE, BoolArray, FloatArray
from femfit.core.results import Finding
from femfit.core.sweep_columns import current_columns, resistance_column
from femfit.effects.effect import AddedEffect
from femfit.identify.constants import AWAY, FREQUENCY_SLACK, LEAST_LINKED, MOST_ROWS, OF_THREE
from femfit.identify.observations import Observations, Stacking, model_tolerance
from femfit.identify.plausible import (
    nothing_in_domain,
    plausible_table,
    require_known_settings,
    within_currents,
    within_domain,
)
from femfit.identify.series.observations import series_observations
from femfit.identify.settings import averaged, conditions_of, covariates_of, currents_in, with_currents
from femfit.identify.words import finding, sentence
from femfit.model.actuator_model import ActuatorModel
from femfit.model.impedance import SHORTED
from femfit.model.readings import Parameter, Point, readings_by, setting_slopes
from femfit.model.with_effects import nominal_of
from femfit.tables.header import parts_of
from femfit.tables.impedance import SERIES
from femfit.tables.measurement import IMPEDANCE_SHARE, BenchTable, Measurement, TimeSeries
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
        prediction=partial(_predicted, point, stacked),
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
    covariates = covariates_of(rows, current_columns(model.current_names))
    conditions, currents = conditions_of(covariates, nominal_of(model)), currents_in(model, covariates)
    return covariates, Point(model, covariates["distance_m"].to_numpy(), currents, conditions, model.effects)


def _predicted(
    point: Point, stacked: Stacking, effects: Sequence[AddedEffect], parameters: Sequence[Parameter]
) -> FloatArray:
    """What the model at the rows of a bench table predicts of its readings, as one vector."""
    present = point.effects
    places = [(len(present) + k, name) for k, name in parameters]
    return stacked(readings_by(replace(point, effects=(*present, *effects)), places, tuple(stacked.rows)))


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


def near_bias(model: ActuatorModel, distance: FloatArray, current: FloatArray) -> tuple[BoolArray, Finding | None]:
    """Which rows, at distances (N,) and currents (N,) or (N, n), are near the bias of eddy currents.

    A finding says of the others where they were read, and what to do.
    """
    base = model.without_effects
    bias = base.eddy.bias if base.eddy else None
    if bias is None:
        return np.ones(len(distance), dtype=bool), None
    measured, biases = current.reshape(len(distance), -1), bias.at(distance)
    read, solved = (base.magnetics.flux_linkage(distance, currents) for currents in (measured, biases))
    apart = np.minimum(*(np.linalg.norm(read - sign * solved, axis=1) for sign in (1.0, -1.0)))  # all turned is alike
    ends = np.array(np.meshgrid(*base.validity.current_limits_A)).reshape(measured.shape[1], -1).T
    linked = [base.magnetics.flux_linkage(distance, np.tile(end, (len(distance), 1))) for end in ends]
    away = np.asarray(apart > AWAY * BIAS_SHARE * np.linalg.norm(linked, axis=-1).max())
    if not away.any():
        return ~away, None
    least = [float(f"{median:.3g}") for median in np.median(measured[away], axis=0)]
    facts: dict[str, Any] = {"asked": least[0] if len(least) == 1 else least, "rows": int(away.sum())}
    facts["circuits"] = [parts_of(name)[1] for name in current_columns(model.current_names)]
    for name, currents in (("read", measured[away]), ("held", biases[away])):
        facts[name] = list(zip(currents.min(axis=0).tolist(), currents.max(axis=0).tolist(), strict=True))
    return ~away, finding("eddy-bias", "current_A", float(away.sum()), **facts)


@dataclass(frozen=True, eq=False)
class Weighing:
    """How readings of each channel are weighed; empty where they are no impedances."""

    weight: Mapping[str, FloatArray] = field(default_factory=dict)  # Of every row, shape (N,), by channel
    magnitude: Mapping[str, float] = field(default_factory=dict)  # At which a channel's readings are given, in its unit
    noise: Mapping[str, float] = field(default_factory=dict)  # Declared as a share of |Z|
    tolerance: Mapping[str, FloatArray] = field(default_factory=dict)  # Of the model's eddy currents, of every row
    findings: tuple[Finding, ...] = ()


def weighed_by_magnitude(point: Point, channels: Collection[str], declared: Mapping[str, float]) -> Weighing:
    """The weights of impedances, by the model's own magnitude; of a channel with a noise in its unit they are 1."""
    names = [name for name in channels if parts_of(name)[0] in SERIES and name not in declared]
    nominal, frequency, eddy = point.conditions.nominal, np.asarray(point.conditions.frequency_Hz), point.model.eddy
    if not names or not np.isfinite(frequency).all():
        return Weighing()
    read = {name: values for name, (values,) in readings_by(point, (), SERIES).items()}
    w = 2.0 * np.pi * frequency
    magnitude = {
        name: np.hypot(read.get(resistance_column(name), 0.0), w * values)
        for name, values in read.items()
        if parts_of(name)[0] == "inductance_H"
    }
    largest = np.max(list(magnitude.values()), axis=0)
    size, most = {}, {}
    for name, z in magnitude.items():
        off = largest * (OF_THREE if name.endswith(SHORTED) else 1.0)
        for channel, scale in ((resistance_column(name), 1.0), (name, w)):
            size[channel], most[channel] = np.maximum(z, LEAST_LINKED * largest) / scale, off / scale
    quantity = {name: parts_of(name)[0] for name in names}
    usual = {name: float(getattr(nominal, of)) for name, of in quantity.items()}
    findings = [finding("weighed", usual=list({of: usual[name] for name, of in quantity.items()}.items()))]
    share, misfit = declared.get(IMPEDANCE_SHARE), 0.0
    if eddy is not None and eddy.error is not None:
        misfit, held = (eddy.error.impedance or 0.0) / np.sqrt(3.0), eddy.error.frequency_max_Hz  # evenly spread
        if beyond := int((frequency > (1.0 + FREQUENCY_SLACK) * held).sum()):  # not held against the field there
            facts = {"beyond": beyond, "held": held, "highest": float(frequency.max())}
            findings.append(finding("frequency-range", "frequency_Hz", float(beyond), "", **facts))
    return Weighing(
        {name: usual[name] / size[name] for name in names},
        usual,
        noise={name: share * usual[name] for name in names} if share else {},
        # The eddy currents' misfit is a share of the largest of all impedances
        tolerance={name: misfit * most[name] for name in names},
        findings=tuple(findings),
    )
