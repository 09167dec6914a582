"""Where the model fails, and what explains it: measured points on its curves, and maps of the misfit."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from femfit.core.numerics import FloatArray
from femfit.core.text import axis_scale
from femfit.identify.misfit import MeasuredCurves
from femfit.identify.observations import Observations
from femfit.identify.settings import setting_cells
from femfit.report.style import (
    INK,
    MUTED,
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

LEAST_LIMIT = 2.0
"""A map's colours span at least so many standard deviations: noise alone should look pale."""


def residual_maps_figure(observations: Observations, scale: Mapping[str, float], sigma: bool) -> Figure:
    """Maps of recorded minus predicted over distance and current, a column a channel, a dot a setting."""
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
        ax.set(title=CHANNEL_WORDS[name], xlabel=words("curves", "distance_m"))
        bar = figure.colorbar(dots, ax=ax, location="bottom", pad=0.02, aspect=18)
        bar.set_label("in noise σ" if sigma else f"in {name.rpartition('_')[2]}")
    panels[0].set_ylabel(words("curves", "current_A"))
    return figure


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
