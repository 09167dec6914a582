"""What was measured, and where the model fails: measured points on the model's curves, and maps of the misfit."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import binned_statistic_2d

from femfit.core.numerics import BoolArray, FloatArray
from femfit.core.text import axis_scale
from femfit.identify.misfit import MeasuredCurves
from femfit.identify.observations import Observations
from femfit.report.style import (
    BLUE,
    CATEGORIES,
    INK,
    MUTED,
    VERMILION,
    WIDTH,
    Axes,
    Figure,
    new_figure,
    ordered_colours,
    quantity,
    words,
)
from femfit.tables.measurement import CHANNEL_WORDS

MM = 1e3

CELLS = 25
"""Most columns and rows of a map: finer settings are averaged."""

LEAST_LIMIT = 2.0
"""A map's colours span at least so many standard deviations: noise alone should look pale."""

BINS = 12


def settings_figure(observations: Observations) -> Figure:
    """Where and when readings were taken."""
    rows = observations.covariates
    warm = [n for n in ("coil_temperature_C", "magnet_temperature_C") if np.isfinite(rows[n].to_numpy()).any()]
    figure = new_figure(3.0)
    axes = figure.subplots(1, 2 if warm else 1, squeeze=False)[0]
    runs = rows["run"].to_numpy(dtype=int)
    spread = 0.02 * float(np.ptp(rows["distance_m"])) if runs.max() else 0.0
    for run in range(int(runs.max()) + 1):
        here = rows[runs == run]
        shift = spread * (run - 0.5 * runs.max()) / max(runs.max(), 1)  # beside each other, not on top
        colour, label = CATEGORIES[run % len(CATEGORIES)], f"run {run + 1}" if run < len(CATEGORIES) else None
        x = MM * (here["distance_m"] + shift)
        axes[0].plot(x, here["current_A"], ".", markersize=3.0, color=colour, label=label)
    axes[0].set(xlabel="distance d (mm)", ylabel="current i (A)", title="settings")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside right upper", markerscale=3.0)
    for name, colour in zip(warm, (VERMILION, BLUE), strict=False):
        axes[1].plot(rows["elapsed"], rows[name], color=colour, label=name.removesuffix("_temperature_C"))
    if warm:
        axes[1].set(xlabel="order of the readings", ylabel="temperature (°C)", title="temperatures")
        figure.legend(*axes[1].get_legend_handles_labels(), loc="outside right lower")
    return figure


def residual_maps_figure(
    observations: Observations, rows: Sequence[tuple[str, FloatArray]], scale: Mapping[str, float], sigma: bool
) -> Figure:
    """Maps of recorded minus predicted over distance and current, a column a channel, a row a titled residual.

    All rows share a channel's colours.
    """
    names = observations.channels
    figure = new_figure(0.5 + 1.9 * len(rows), width=min(WIDTH, 1.4 + 2.2 * len(names)))
    panels = figure.subplots(len(rows), len(names), squeeze=False, sharex=True, sharey=True)
    edges = [_edges(MM * observations.column("distance_m")), _edges(observations.column("current_A"))]
    for c, name in enumerate(names):
        here = observations.of(name)
        maps = [_cell_means(observations, residual / scale.get(name, np.nan), here, edges) for _, residual in rows]
        finite = np.concatenate([np.abs(m[np.isfinite(m)]) for m in maps])
        limit = float(np.quantile(finite, 0.98)) if finite.size else 1.0
        limit = max(limit, LEAST_LIMIT) if sigma else max(limit, 1e-300)
        for (title, _), values, ax in zip(rows, maps, panels[:, c], strict=True):
            image = ax.pcolormesh(edges[0], edges[1], values.T, cmap="RdBu_r", vmin=-limit, vmax=limit, rasterized=True)
            ax.grid(visible=False)
            ax.set_title(f"{CHANNEL_WORDS[name]}{', ' + title if title else ''}", fontsize=8.5)
        panels[-1, c].set_xlabel("distance d (mm)")
        bar = figure.colorbar(image, ax=list(panels[:, c]), location="bottom", pad=0.02, aspect=18)
        bar.ax.tick_params(labelsize=8)
        bar.set_label("in noise σ" if sigma else f"in {name.rpartition('_')[2]}", fontsize=8.5)
    for ax in panels[:, 0]:
        ax.set_ylabel("current i (A)")
    return figure


def _edges(values: FloatArray) -> FloatArray:
    """Borders between the levels of a setting, or of equal cells where there are many levels."""
    levels = np.unique(np.round(values, 6))
    gaps = np.diff(levels)
    if len(levels) > 1:  # levels that a stage met a little beside each other are one
        keep = np.concatenate([[True], gaps > 0.02 * np.ptp(levels) / min(len(levels), CELLS)])
        levels = levels[keep]
    if len(levels) > CELLS:
        return np.linspace(levels[0], levels[-1], CELLS + 1)
    if len(levels) == 1:
        half = 0.05 * max(abs(float(levels[0])), 1e-3)
        return np.array([levels[0] - half, levels[0] + half])
    middle = 0.5 * (levels[1:] + levels[:-1])
    return np.concatenate([[2 * levels[0] - middle[0]], middle, [2 * levels[-1] - middle[-1]]])


def _cell_means(
    observations: Observations, values: FloatArray, here: BoolArray, edges: Sequence[FloatArray]
) -> FloatArray:
    """Mean of each cell, shape (columns, rows); NaN where nothing was read."""
    columns = (MM * observations.column("distance_m")[here], observations.column("current_A")[here])
    x, y = (np.clip(column, e[0], e[-1]) for column, e in zip(columns, edges, strict=True))
    return np.asarray(binned_statistic_2d(x, y, values[here], bins=list(edges)).statistic)


def covariate_figure(observations: Observations, residual: FloatArray, channel: str, names: Sequence[str]) -> Figure:
    """One channel's residual, over its noise, against temperature, time, branch or run."""
    figure = new_figure(2.7, width=min(WIDTH, 2.8 + 2.5 * len(names)))
    panels = figure.subplots(1, len(names), squeeze=False, sharey=True)[0]
    here = observations.of(channel)
    for ax, name in zip(panels, names, strict=True):
        x = observations.column(name)[here]
        _binned(ax, x, residual[here])
        ax.axhline(0.0, color=MUTED, linewidth=0.8)
        ax.set_xlabel(COVARIATE_LABELS.get(name, name))
        if name in {"branch", "run"}:
            levels = np.unique(x)
            ax.set_xticks(levels, [_level(name, value) for value in levels])
    panels[0].set_ylabel(f"{CHANNEL_WORDS[channel]}:\nrecorded − predicted (σ)")
    return figure


COVARIATE_LABELS = {
    "coil_temperature_C": "coil temperature (°C)",
    "magnet_temperature_C": "magnet temperature (°C)",
    "order": "order within the run",
    "elapsed": "order of the readings",
    "branch": "branch of the current",
    "run": "run",
    "velocity_m_s": "speed of the distance (m/s)",
    "current_rate_A_s": "rate of the current (A/s)",
    "distance_m": "distance (m)",
    "current_A": "current (A)",
    "frequency_Hz": "frequency (Hz)",
}
"""What axes call the columns of a campaign."""


def _level(name: str, value: float) -> str:
    if name == "run":
        return str(int(value) + 1)
    return {1.0: "rising", -1.0: "falling"}.get(float(value), "unknown")


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


_SETTING = {"distance_m": 1e3, "current_A": 1.0, "frequency_Hz": 1e-3}
"""Factor of a setting's axis, in mm, A or kHz."""


def curves_figure(curves: MeasuredCurves, *, fitted: bool) -> Figure:
    """Draw readings of one channel on the model's curves with the misfit below; with a fit, before and after."""
    columns = [("before", curves.before, curves.misfit_before)]
    if fitted:
        columns.append(("after", curves.after, curves.misfit_after))
    figure = new_figure(4.6)
    panels = figure.subplots(2, len(columns), sharex=True, sharey="row", height_ratios=(2.2, 1.0), squeeze=False)
    for (name, lines, misfit), (above, below) in zip(columns, panels.T, strict=True):
        _draw(above, below, curves, lines, misfit)
        above.set_title(words("curves", name))
        below.set_xlabel(words("curves", curves.along))
    quantity = CHANNEL_WORDS[curves.channel]
    panels[0, 0].set_ylabel(
        words("curves", "reading", quantity=quantity, unit=axis_scale(curves.measured, curves.channel)[1])
    )
    panels[1, 0].set_ylabel(words("curves", "misfit", unit=axis_scale(curves.misfit_before, curves.channel)[1]))
    figure.legend(
        *panels[0, 0].get_legend_handles_labels(), loc="outside right center", title=words("curves", curves.over)
    )
    return figure


def _draw(above: Axes, below: Axes, curves: MeasuredCurves, lines: FloatArray, misfit: FloatArray) -> None:
    factor, size = _SETTING[curves.along], axis_scale(curves.measured, curves.channel)[0]
    small = axis_scale(curves.misfit_before, curves.channel)[0]
    for k, (level, colour) in enumerate(zip(curves.levels, ordered_colours(len(curves.levels)), strict=True)):
        here = curves.level == k
        label = quantity(level, curves.over)
        if len(lines):
            above.plot(factor * curves.axis, size * lines[k], color=colour, linewidth=1.2, label=label)
        measured = "" if len(lines) else label
        look: dict[str, Any] = {"color": colour, "markersize": 2.8, "fillstyle": "none", "label": measured}
        above.plot(factor * curves.x[here], size * curves.measured[here], "o", **look)
        below.plot(factor * curves.x[here], small * misfit[here], "o", color=colour, markersize=2.2)
    below.axhline(0.0, color=INK, linewidth=0.8)
    if curves.along == "frequency_Hz":
        below.set_xscale("log")
    if curves.noise is not None:
        below.axhspan(-small * curves.noise, small * curves.noise, color=MUTED, alpha=0.18, linewidth=0.0)


def worst_first(curves: Sequence[MeasuredCurves]) -> list[MeasuredCurves]:
    """Channels in the order of their misfit over the noise, or over their own size where the noise is not known."""

    def badness(curve: MeasuredCurves) -> float:
        size = curve.noise or float(np.max(np.abs(curve.measured), initial=0.0)) or 1.0
        return round(-float(np.sqrt(np.mean(curve.misfit_before**2))) / size, 9)

    return sorted(curves, key=badness)
