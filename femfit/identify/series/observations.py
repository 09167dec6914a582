"""A recorded time series beside a model: rows of short-window balances for the engine that diagnoses bench tables.

One row is one window. Without effects both sides of a balance come from every single sample; what effects change is
computed on a coarser grid of the smoothed motion, which is exact enough for a change and fast enough for all of them;
but for how fast eddy currents decay, which is as fast as the samples.

References
----------
F. R. Hampel, Journal of the American Statistical Association 69 (1974) 383: the median of magnitudes and its scatter.
J. W. Tukey, Exploratory Data Analysis (Addison-Wesley, 1977), section 2: the median as a measure that few large values
do not move.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pandas as pd

from femfit.core.errors import TableError
from femfit.core.numerics import FloatArray, robust_deviation
from femfit.core.sweep_columns import flux_columns
from femfit.effects.catalogue import effect_by_name
from femfit.effects.effect import AddedEffect
from femfit.estimate.record import with_distance
from femfit.identify.constants import LEAST_REPEATS
from femfit.identify.observations import Observations, Stacking, WithoutCache, model_tolerance
from femfit.identify.patterns import orthonormal_basis, smooth_patterns
from femfit.identify.series.constants import LEAST_VARIANCE, MEDIAN_CHANCE, RESTLESS, TURNS_OF_MISFIT
from femfit.identify.series.measured import measure_balances, measure_sensors, recorded
from femfit.identify.series.motion import FORCE_BALANCE, Motion, model_side, voltage_balances
from femfit.identify.series.samples import take_samples
from femfit.identify.series.views import balance_view, sensor_view
from femfit.identify.series.weights import Weights, lay_windows
from femfit.identify.words import finding, sentence
from femfit.model.actuator_model import ActuatorModel
from femfit.model.readings import Parameter
from femfit.model.with_effects import nominal_of
from femfit.tables.measurement import TimeSeries

SLOPE_STEP = 1e-3
"""Numerical: step of a difference over the width of a parameter's plausible range."""


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
    samples, nominal = replace(samples, rows=samples.rows[samples["usable"]]), nominal_of(model)
    record = recorded(base, samples, nominal, series.declared_noise)
    views = [view(base, samples, windows, nominal) for view in (balance_view, sensor_view)]
    every = [*measure_balances(record, views[0])], [*measure_sensors(record, views[1].windows)]
    findings = tuple(finding for of_view in every for channel in of_view for finding in channel.findings)
    measured = [{each.name: each for each in of_view if each.weights.valid.any()} for of_view in every]
    channels = measured[0] | measured[1]
    if not channels:
        raise TableError(sentence("refusals", "no_balance", replace(series, findings=(*series.findings, *findings))))
    rows = {name: np.flatnonzero(channel.weights.valid) for name, channel in channels.items()}
    # Windows with few samples are noisier; scaled to one noise a channel, as the engine takes it
    sigma = {name: channel.sigma[rows[name]] for name, channel in channels.items()}
    usual = {name: float(np.median(values)) for name, values in sigma.items()}
    stacked = Stacking(rows, {name: u / sigma[name] for name, u in usual.items() if np.isfinite(u)})
    nodes = [(view.motion, dict.fromkeys(of_view, view.weights)) for view, of_view in zip(views, measured, strict=True)]
    weights = {name: channel.weights for name, channel in channels.items()}
    offsets = {name: np.zeros_like(channel.value) + channel.beside for name, channel in channels.items()}
    prediction = _SeriesPrediction(model, [(record.motion, weights)], nodes, stacked(offsets), stacked)
    covariates = pd.concat([view.covariates for view in views], ignore_index=True)
    below = np.repeat([0, len(views[0].covariates)], [len(of_view) for of_view in measured])
    step, offset = 1e-3 * nominal.travel_m, effect_by_name("distance_offset")
    ahead, middle, behind = (
        prediction.change((AddedEffect(offset, {"offset_m": by}), *model.effects)) for by in (step, 0.0, -step)
    )
    # What a bench would have to read to show as much as each balance does
    fluxes = zip(voltage_balances(base), flux_columns(model.circuit_names), strict=True)
    tolerance, shown = _tolerance(model, covariates), {FORCE_BALANCE: "force_N", **dict(fluxes)}
    observations = Observations(
        channels=tuple(channels),
        channel=stacked.channel,
        row=np.concatenate([piece + start for piece, start in zip(rows.values(), below, strict=True)]),
        value=stacked({name: channel.value for name, channel in channels.items()}),
        covariates=covariates,
        given=(*series.given, *(shown[name] for name in channels if name in shown)),
        prediction=prediction,
        distance_slope=(ahead - behind) / (2.0 * step),
        distance_curvature=(ahead - 2.0 * middle + behind) / step**2,
        nominal=nominal,
        declared_noise={name: noise for name, noise in usual.items() if np.isfinite(noise)},
        tolerance=np.array([tolerance.get(name, 0.0) for name in channels])[stacked.channel],
        setting_columns=np.zeros((len(stacked.channel), 2)),
        weight=np.ones(len(stacked.channel)),
        findings=(*series.findings, *findings, *samples.findings),
        present=tuple(added.effect.name for added in model.effects),
        noise_source="samples",
    )
    return _with_scatter(observations)


@dataclass(frozen=True, eq=False)
class _SeriesPrediction(WithoutCache):
    """What a model predicts of a record's windows, as one vector: the exact balances, and what effects change.

    Both from motions, each with the weights of the channels that are taken from it.
    """

    model: ActuatorModel
    samples: Sequence[tuple[Motion, Mapping[str, Weights]]]
    nodes: Sequence[tuple[Motion, Mapping[str, Weights]]]
    beside: FloatArray  # Beside these, whatever the effects; shape (M,)
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
                    (*effects[:k], replace(added, parameters={**added.parameters, name: value}), *effects[k + 1 :])
                )
                for value in ends
            )
            values.append((ahead - behind) / (ends[0] - ends[1]))
        return np.stack(values, axis=1)

    def _predicted(self, effects: Sequence[AddedEffect]) -> FloatArray:
        together = (*self.model.effects, *effects)
        eddy = tuple(added for added in together if added.effect.eddy is not None)
        slow = tuple(added for added in together if added.effect.eddy is None)
        exact = self._side(self.samples, eddy) if eddy else self._without[0]
        return self.beside + exact + self.change(slow)

    def change(self, effects: Sequence[AddedEffect]) -> FloatArray:
        """What effects change, shape (M,)."""
        return self._side(self.nodes, effects) - self._without[1]

    @cached_property
    def _without(self) -> tuple[FloatArray, FloatArray]:
        return self._side(self.samples, ()), self._side(self.nodes, ())

    def _side(
        self, motions: Sequence[tuple[Motion, Mapping[str, Weights]]], effects: Sequence[AddedEffect]
    ) -> FloatArray:
        """The model's sides, of readings under effects."""
        sides = [model_side(motion, weights, effects) for motion, weights in motions]
        return self.stacked({name: values for side in sides for name, values in side.items()})


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
    """The noise of channels whose successive windows scatter more than their sensors' noise makes.

    By the median difference of those that follow each other. White noise less its part along smooth patterns, of an
    orthonormal basis (n, p), differs from one window to the next by a variance of 2 less the squared difference of the
    basis' rows.
    """
    noise, findings = dict(observations.declared_noise), []
    order, run, patterns = observations.column("order"), observations.column("run"), smooth_patterns(observations)
    for c, name in enumerate(observations.channels):
        here = np.flatnonzero(observations.channel == c)
        basis = orthonormal_basis(patterns.columns[np.ix_(here, np.flatnonzero(patterns.channel == c))])
        scatter = observations.residual[here] - basis @ (basis.T @ observations.residual[here])
        follows = (np.diff(order[here]) == 1.0) & (np.diff(run[here]) == 0.0)
        variance = 2.0 - np.sum(np.diff(basis, axis=0) ** 2, axis=1)
        free = follows & (variance > LEAST_VARIANCE)
        if np.count_nonzero(free) < LEAST_REPEATS:
            continue
        shown = float(robust_deviation(np.diff(scatter)[free] / np.sqrt(variance[free])))
        declared, slack = noise.get(name, np.nan), MEDIAN_CHANCE / np.sqrt(np.count_nonzero(follows))
        if not shown <= max(RESTLESS, 1.0 + slack) * declared:
            noise[name] = shown
            times = shown / declared if np.isfinite(declared) else None
            findings.append(finding("restless", name, name=name, shown=shown, times=times))
    return replace(observations, declared_noise=noise, findings=(*observations.findings, *findings))
