"""A recorded time series beside a model: rows of short-window balances for the engine that diagnoses bench tables.

One row is one window. Without effects both sides of a balance come from every single sample; what effects change is
computed on a coarser grid of the smoothed motion, which is exact enough for a change and fast enough for all of them;
but for how fast eddy currents decay, which is as fast as the samples.

References
----------
F. R. Hampel, Journal of the American Statistical Association 69 (1974) 383: the median of magnitudes and its scatter.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from math import prod

import numpy as np
import pandas as pd

from femfit.core.errors import TableError
from femfit.core.numerics import FloatArray
from femfit.core.sweep_columns import flux_columns
from femfit.effects.effect import AddedEffect
from femfit.effects.friction import REST
from femfit.estimate.record import with_distance
from femfit.identify.constants import MEDIAN_CHANCE, REMEMBERED, RESTLESS, SLOPE_STEP, TURNS_OF_MISFIT
from femfit.identify.noise.whitening import orthonormal_basis
from femfit.identify.observations import Observations, Stacking, WithoutCache, model_tolerance
from femfit.identify.patterns import smooth_patterns
from femfit.identify.series.balances import (
    FORCE_BALANCE,
    RememberedPoints,
    Side,
    model_balances,
    model_readings,
    model_rests,
    voltage_balances,
)
from femfit.identify.series.measured import (
    MeasuredChannel,
    Recorded,
    measure_balances,
    measure_sensors,
    sample_field,
    sensor_noise,
    successive_scatter,
)
from femfit.identify.series.samples import take_samples
from femfit.identify.series.views import View, balance_view, sensor_view
from femfit.identify.series.weights import lay_windows
from femfit.identify.words import finding, sentence
from femfit.model.actuator_model import ActuatorModel
from femfit.model.readings import Parameter
from femfit.model.with_effects import nominal_of
from femfit.tables.measurement import TimeSeries


def series_observations(model: ActuatorModel, series: TimeSeries) -> Observations:
    """Place a time series beside a model.

    The channels are ``force_balance_N`` (with motion), ``voltage_balance_V`` (of each circuit with its commanded
    voltage), ``hall_V`` and ``force_N``; ``covariates`` also hold ``time_s``, ``velocity_m_s`` and
    ``current_rate_A_s``.
    """
    base, series = model.without_effects, with_distance(model, series)
    samples = take_samples(model, series)
    windows = lay_windows(base, samples)
    if not len(windows.centre_s):
        raise TableError(sentence("refusals", "no_stretch", series.source, windows.length_s))
    nominal = nominal_of(model)
    sampled = sample_field(base, samples)
    noise = sensor_noise(base, samples, sampled, series.declared_noise)
    views = balance_view(samples, windows, nominal), sensor_view(samples, windows, nominal)
    record = Recorded(base, nominal, samples, sampled, noise)
    every = [*measure_balances(record, views[0])], [*measure_sensors(record, views[1].windows)]
    told = (finding for of_view in every for channel in of_view for finding in channel.findings)
    series = replace(series, findings=(*series.findings, *told))
    measured = [[channel for channel in of_view if channel.valid.any()] for of_view in every]
    if not any(measured):
        raise TableError(sentence("refusals", "no_balance", series))
    return _with_scatter(_assembled(model, series, record, views, measured))


def _assembled(
    model: ActuatorModel,
    series: TimeSeries,
    record: Recorded,
    views: tuple[View, View],
    measured: Sequence[Sequence[MeasuredChannel]],
) -> Observations:
    """The channels that were measured in both views, one after the other."""
    channels, nominal = [*measured[0], *measured[1]], record.nominal
    rows = {channel.name: np.flatnonzero(channel.valid) for channel in channels}
    # Windows with few samples are noisier; scaled to one noise a channel, as the engine takes it
    sigma = {channel.name: channel.sigma[rows[channel.name]] for channel in channels}
    usual = {name: float(np.median(values)) for name, values in sigma.items()}
    scale = {name: np.where(np.isfinite(u), u / sigma[name], 1.0) for name, u in usual.items()}
    names, stacked = tuple(rows), Stacking(rows, scale)
    number = stacked.channel
    offset = np.repeat([0, len(views[0].covariates)], [len(of_view) for of_view in measured])
    of_sensors = model_rests if [channel.name for channel in measured[1]] == [REST] else model_readings
    sides = zip(views, (model_balances, of_sensors), measured, strict=True)
    recorded = [(view, side) for view, side, of_view in sides if of_view]
    prediction = _SeriesPrediction(model, recorded, record, channels, stacked)
    change, present = prediction.change, model.effects
    step = 1e-3 * (nominal.distance_max_m - nominal.distance_min_m)
    covariates = pd.concat([view.covariates for view in views], ignore_index=True)
    # What a bench would have to read to show as much as each balance does
    fluxes = zip(voltage_balances(model.without_effects), flux_columns(model.circuit_names), strict=True)
    tolerance, shown = _tolerance(model, covariates), {FORCE_BALANCE: "force_N", **dict(fluxes)}
    return Observations(
        channels=names,
        channel=number,
        row=np.concatenate([piece + start for piece, start in zip(rows.values(), offset, strict=True)]),
        value=stacked({channel.name: channel.measured for channel in channels}),
        covariates=covariates,
        given=(*series.given, *(shown[name] for name in names if name in shown)),
        prediction=prediction,
        distance_slope=(change(present, step) - change(present, -step)) / (2.0 * step),
        distance_curvature=(change(present, step) - 2.0 * change(present) + change(present, -step)) / step**2,
        nominal=nominal,
        declared_noise={name: noise for name, noise in usual.items() if np.isfinite(noise)},
        tolerance=np.array([tolerance.get(name, 0.0) for name in names])[number],
        setting_columns=np.zeros((len(number), 2)),
        findings=(*series.findings, *record.samples.findings),
        present=tuple(added.effect.name for added in present),
        noise_source="samples",
    )


@dataclass(frozen=True, eq=False)
class _SeriesPrediction(WithoutCache):
    """What a model predicts of a record's windows, as one vector: the exact balances, and what effects change."""

    model: ActuatorModel
    sides: Sequence[tuple[View, Side]]  # Those of which a channel was recorded
    record: Recorded
    channels: Sequence[MeasuredChannel]
    stacked: Stacking  # Of the windows that count, by the factor that gives them one noise

    def __call__(self, effects: Sequence[AddedEffect], parameters: Sequence[Parameter]) -> FloatArray:
        """Slopes are differences: states and eddy currents at a node follow from all nodes before, one by one."""
        values = [self._predicted(effects)]
        for k, name in parameters:
            added = effects[k]
            p, here = next(p for p in added.effect.parameters if p.name == name), added.parameters[name]
            ends = min(here + SLOPE_STEP * p.width, p.upper), max(here - SLOPE_STEP * p.width, p.lower)
            ahead, behind = (
                self._predicted(
                    (*effects[:k], replace(added, parameters={**added.parameters, name: at}), *effects[k + 1 :])
                )
                for at in ends
            )
            values.append((ahead - behind) / (ends[0] - ends[1]))
        return np.stack(values, axis=1)

    def _predicted(self, effects: Iterable[AddedEffect]) -> FloatArray:
        together = (*self.model.effects, *effects)
        faster = prod(added.effect.eddy(added.parameters) for added in together if added.effect.eddy is not None)
        slow = tuple(added for added in together if added.effect.eddy is None)
        return self.exact(faster) + self.change(slow)

    @cached_property
    def exact(self) -> Callable[[float], FloatArray]:
        """The model's side without effects, from every sample, where eddy currents decay so many times faster."""

        @lru_cache(REMEMBERED)
        def predicted(faster: float) -> FloatArray:
            base, field = self.record.base, self.record.field
            if base.eddy is not None and faster != 1.0:
                eddy = replace(base.eddy, resistances_ohm=faster * base.eddy.resistances_ohm)
                field = sample_field(replace(base, eddy=eddy), self.record.samples)
            return self.stacked({channel.name: channel.predict(field) for channel in self.channels})

        return predicted

    def change(self, effects: Sequence[AddedEffect], shift: float = 0.0) -> FloatArray:
        """What effects, and a shift of the recorded distance, change."""
        return self._at(effects, shift) - self._without if effects or shift else np.zeros_like(self._without)

    def _at(self, effects: Sequence[AddedEffect], shift: float) -> FloatArray:
        values: dict[str, FloatArray] = {}
        for (view, side), points in zip(self.sides, self._points, strict=True):
            motion = replace(view.motion, distance_m=view.motion.distance_m + shift) if shift else view.motion
            values |= side(points, motion, view.weights, effects)
        if shift and REST in values:
            values[REST] = values[REST] - shift  # what is recorded there is the distance itself
        return self.stacked(values)

    @cached_property
    def _without(self) -> FloatArray:
        return self._at((), 0.0)

    @cached_property
    def _points(self) -> list[RememberedPoints]:
        return [RememberedPoints(self.model.without_effects) for _ in self.sides]


def _tolerance(model: ActuatorModel, covariates: pd.DataFrame) -> dict[str, float]:
    """Misfit of the model to its own source in each channel; of the flux linkage as fast as it changes here."""
    misfits, box = model_tolerance(model), model.validity
    result = {**misfits, FORCE_BALANCE: misfits.get("force_N", 0.0)}
    if "flux_linkage_Wb" in misfits:
        rates = np.hypot(
            covariates["velocity_m_s"] / (box.distance_max_m - box.distance_min_m),
            covariates["current_rate_A_s"] / (box.current_max_A - box.current_min_A),
        )
        misfit = TURNS_OF_MISFIT * misfits["flux_linkage_Wb"] * float(np.sqrt(np.mean(rates**2)))
        result |= dict.fromkeys(voltage_balances(model), misfit)
    return result


def _with_scatter(observations: Observations) -> Observations:
    """The noise of channels whose successive windows scatter more than their sensors' noise makes."""
    noise, findings = dict(observations.declared_noise), []
    order, run, patterns = observations.column("order"), observations.column("run"), smooth_patterns(observations)
    for c, name in enumerate(observations.channels):
        here = np.flatnonzero(observations.channel == c)
        basis = orthonormal_basis(patterns.columns[np.ix_(here, np.flatnonzero(patterns.channel == c))])
        scatter = observations.residual[here] - basis @ (basis.T @ observations.residual[here])
        follows = 1 + np.flatnonzero((np.diff(order[here]) == 1.0) & (np.diff(run[here]) == 0.0))
        shown, declared = successive_scatter(scatter, follows, basis), noise.get(name, np.nan)
        if np.isfinite(shown) and not shown <= max(RESTLESS, 1.0 + MEDIAN_CHANCE / np.sqrt(len(follows))) * declared:
            noise[name] = shown
            times = shown / declared if np.isfinite(declared) else None
            findings.append(finding("restless", name, name=name, shown=shown, times=times))
    return replace(observations, declared_noise=noise, findings=(*observations.findings, *findings))
