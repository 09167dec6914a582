"""Where the model fails, and what explains it: measured points on its curves, and maps of the misfit."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd

from femfit.core.numerics import FloatArray
from femfit.core.results import remembered
from femfit.core.text import axis_scale
from femfit.effects.effect import AddedEffect
from femfit.identify.before_after import AddResult
from femfit.identify.compare import Comparison
from femfit.identify.decision.diagnose import Diagnosis
from femfit.identify.misfit import MeasuredCurves, measured_curves
from femfit.identify.observations import Observations
from femfit.identify.settings import setting_cells
from femfit.model.actuator_model import ActuatorModel
from femfit.model.with_effects import with_effects
from femfit.report.style import INK, MUTED, VERMILION, WIDTH, Axes, Figure, new_figure, ordered_colours, quantity, words
from femfit.tables.measurement import channel_words

MM = 1e3

LEAST_LIMIT = 2.0
"""A map's colours span at least so many standard deviations: noise alone should look pale."""

BINS = 12


SCALAR = (
    "coil_temperature_C", "magnet_temperature_C", "order", "elapsed", "branch", "run", "velocity_m_s",
    "current_rate_A_s",
)  # fmt: skip
"""Covariates that a map over distance and current does not show."""


@dataclass(frozen=True, eq=False)
class Bench:
    """Readings beside a model, before and with effects."""

    model: ActuatorModel
    observations: Observations
    floor: Mapping[str, float]  # Standard deviation of one reading, in the channels in which it is known
    effects: Sequence[AddedEffect]
    noise_known: bool  # Of every channel
    channels: Sequence[str]  # In the order of their misfit over the noise, or over their own size
    fails: str  # The channel of which a diagnosis says where it fails, and what its misfit changes with besides
    covariates: Sequence[str]

    @cached_property
    def curves(self) -> dict[str, MeasuredCurves]:
        """Each channel's readings on the model's curves."""
        curves = measured_curves(self.model, self.observations, after=self.effects, noise=dict(self.floor))
        return {curve.channel: curve for curve in curves}


@remembered
def bench_of(result: Comparison | Diagnosis | AddResult) -> Bench:
    """What the figures show of a result."""
    model, observations, fails = result.model, result.observations, ""
    effects: Sequence[AddedEffect] = ()
    covariates: Sequence[str] = ()
    if isinstance(result, Comparison):
        floor = {each.channel: each.noise_floor for each in result.channels if each.noise_floor is not None}
    elif isinstance(result, Diagnosis):
        floor, effects = dict(result.noise_floor), result.explanations[0].effects if result.explanations else ()
        fails, covariates = result.where.channel, [name for name in result.where.covariates if name in SCALAR and floor]
    else:
        floor, effects = dict(result.floor), result.added
        earlier = tuple(added for added in model.effects if added.effect.name in result.kept)
        model = with_effects(model.without_effects, earlier)
    rms = observations.rms(observations.residual)
    largest = {name: float(np.max(np.abs(observations.value[observations.of(name)]), initial=0.0)) for name in rms}
    worst_first = sorted(rms, key=lambda name: round(-rms[name] / (floor.get(name) or largest[name] or 1.0), 9))
    return Bench(model, observations, floor, effects, set(floor) >= set(rms), worst_first, fails, covariates)


def residual_maps_figure(bench: Bench) -> Figure:
    """Maps of recorded minus predicted over distance and current, a column a channel, a dot a setting."""
    observations, sigma = bench.observations, bench.noise_known
    scale = bench.floor if sigma else dict.fromkeys(observations.channels, 1.0)
    names = observations.channels
    figure = new_figure(2.4, width=min(WIDTH, 1.4 + 2.2 * len(names)))
    panels = figure.subplots(1, len(names), squeeze=False, sharey=True)[0]
    for ax, name in zip(panels, names, strict=True):
        here = observations.of(name)
        columns = {"d": MM * observations.column("distance_m"), "i": observations.column("current_A")}
        readings = pd.DataFrame({**columns, "residual": observations.residual / scale.get(name, np.nan)})[here]
        d, i, mean = readings.groupby(setting_cells(observations)[here]).mean().to_numpy().T
        limit = max(float(np.nanquantile(np.abs(mean), 0.98)), LEAST_LIMIT if sigma else 1e-300)
        dots = ax.scatter(d, i, 14.0, mean, cmap="RdBu_r", vmin=-limit, vmax=limit, edgecolors=MUTED, linewidths=0.2)
        ax.set(title=channel_words(name), xlabel=words("curves", "distance_m"))
        bar = figure.colorbar(dots, ax=ax, location="bottom", pad=0.02, aspect=18)
        bar.set_label("in noise σ" if sigma else f"in {name.rpartition('_')[2]}")
    panels[0].set_ylabel(words("curves", "current_A"))
    return figure


def covariate_figure(bench: Bench) -> Figure:
    """One channel's residual, over its noise, against temperature, time, branch or run."""
    observations, channel, names = bench.observations, bench.fails, bench.covariates
    residual = observations.residual / bench.floor[channel]
    figure = new_figure(2.7, width=min(WIDTH, 2.8 + 2.5 * len(names)))
    panels = figure.subplots(1, len(names), squeeze=False, sharey=True)[0]
    here = observations.of(channel)
    for ax, name in zip(panels, names, strict=True):
        x = observations.column(name)[here]
        _binned(ax, x, residual[here])
        ax.axhline(0.0, color=MUTED, linewidth=0.8)
        ax.set_xlabel(words("covariates", name))
    panels[0].set_ylabel(f"{channel_words(channel)}:\nrecorded − predicted (σ)")
    return figure


def _binned(ax: Axes, x: FloatArray, y: FloatArray) -> None:
    finite = np.isfinite(x)
    x, y = x[finite], y[finite]
    levels = np.unique(x)
    cuts = levels if len(levels) <= BINS else np.quantile(x, np.linspace(0.0, 1.0, BINS + 1)[:-1])
    group = np.searchsorted(np.unique(cuts), x, side="right")
    table = pd.DataFrame({"x": x, "y": y}).groupby(group).agg({"x": "mean", "y": ["mean", "sem"]})
    ax.errorbar(
        table["x"]["mean"], table["y"]["mean"], 2.0 * table["y"]["sem"].fillna(0.0),
        fmt="o-", color=VERMILION, markersize=3.5, linewidth=1.0, elinewidth=0.9,
    )  # fmt: skip


_SETTING = {"distance_m": 1e3, "current_A": 1.0, "frequency_Hz": 1.0}
"""Factor of a setting's axis, in mm, A or Hz."""


def curves_figure(bench: Bench, channel: str) -> Figure:
    """Draw readings of one channel on the model's curves with the misfit below; with effects, before and after."""
    curves = bench.curves[channel]
    columns = [("before", curves.before, curves.misfit_before)]
    if bench.effects:
        columns.append(("after", curves.after, curves.misfit_after))
    figure = new_figure(4.6)
    panels = figure.subplots(2, len(columns), sharex=True, sharey="row", height_ratios=(2.2, 1.0), squeeze=False)
    for (name, lines, misfit), (above, below) in zip(columns, panels.T, strict=True):
        _draw(above, below, curves, lines, misfit)
        above.set_title(words("curves", name))
        below.set_xlabel(words("curves", curves.along))
    quantity = channel_words(channel)
    panels[0, 0].set_ylabel(words("curves", "reading", quantity=quantity, unit=axis_scale(curves.measured, channel)[1]))
    panels[1, 0].set_ylabel(words("curves", "misfit", unit=axis_scale(curves.misfit_before, channel)[1]))
    figure.legend(
        *panels[0, 0].get_legend_handles_labels(), loc="outside right center", title=words("curves", curves.over)
    )
    return figure


def _draw(above: Axes, below: Axes, curves: MeasuredCurves, lines: FloatArray, misfit: FloatArray) -> None:
    factor, size = _SETTING[curves.along], axis_scale(curves.measured, curves.channel)[0]
    small = axis_scale(curves.misfit_before, curves.channel)[0]
    for k, (level, colour) in enumerate(zip(curves.levels, ordered_colours(len(curves.levels)), strict=True)):
        at_level = curves.level == k
        label = quantity(level, curves.over)
        if len(lines):
            above.plot(factor * curves.axis, size * lines[k], color=colour, linewidth=1.2, label=label)
        measured = "" if len(lines) else label
        look: dict[str, Any] = {"color": colour, "markersize": 2.8, "fillstyle": "none", "label": measured}
        above.plot(factor * curves.x[at_level], size * curves.measured[at_level], "o", **look)
        below.plot(factor * curves.x[at_level], small * misfit[at_level], "o", color=colour, markersize=2.2)
    below.axhline(0.0, color=INK, linewidth=0.8)
    if curves.along == "frequency_Hz":
        below.set_xscale("log")
    if curves.noise is not None:
        below.axhspan(-small * curves.noise, small * curves.noise, color=MUTED, alpha=0.18, linewidth=0.0)
