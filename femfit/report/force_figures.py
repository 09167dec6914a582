"""Force over stroke, coil over stroke, and the sweep: as figures."""

from typing import TYPE_CHECKING

import numpy as np

from femfit.core.text import axis_scale
from femfit.device.mechanics import Mechanics
from femfit.report.rating import Rating, SweepGrid
from femfit.report.style import (
    BLUE,
    GREEN,
    MUTED,
    ORANGE,
    PURPLE,
    VERMILION,
    Figure,
    label,
    new_figure,
    ordered_colours,
    plain,
    significant,
    words,
)

if TYPE_CHECKING:
    from matplotlib.axis import Axis

MM = 1e3

CROWDED = 0.15
"""Contour lines nearer to the weight than this part of it would run into its label."""

FEEDS = {
    "cold": (BLUE, "-"),
    "warm": (VERMILION, "-"),
    "reversed": (PURPLE, "-"),
    "rated": (GREEN, "--"),
    "idle": (MUTED, ":"),
}
"""Colour and line of each feed."""


def stroke_figure(rating: Rating, motion: Mechanics | None) -> Figure:
    """Draw force over the stroke at the supply's voltage and the rated current, and what it has to overcome."""
    figure = new_figure(3.6)
    axes = figure.subplots()
    factor, unit = axis_scale(np.concatenate(list(rating.forces_N.values())), "N")
    for feed in rating.feeds:
        colour, line = FEEDS[feed.name]
        voltage = rating.voltage_V if feed.name != "reversed" else feed.current_A * rating.cold_ohm
        about = {"voltage": plain(voltage, 3), "temperature": plain(feed.temperature_C)}
        text = words("stroke", feed.name, current=significant(feed.current_A), **about)
        if feed.limited:
            text += words("stroke", "limited", drawn=significant(feed.drawn_A))
        axes.plot(MM * rating.distance_m, factor * rating.forces_N[feed.name], line, color=colour, label=text)
    if motion is not None:
        against, name = (
            motion.static_force(rating.distance_m),
            "static" if motion.springs or motion.load_N else "weight",
        )
        if np.any(against):
            x, dashes = MM * rating.distance_m, (5, 3)
            axes.plot(x, factor * against, color=ORANGE, linewidth=1.0, dashes=dashes, label=words("stroke", name))
    label(axes, "stroke", "distance", "force", unit=unit)
    axes.legend(loc="best")
    return figure


def coil_figure(rating: Rating) -> Figure:
    """Draw inductance, electrical time constant and motor constant over the stroke."""
    figure = new_figure(2.9)
    panels = figure.subplots(1, 3)
    x = MM * rating.distance_m
    idle = rating.feed("idle")
    curves = [
        ("rated", rating.reference.drawn_A, rating.inductance_H, BLUE, "-"),
        ("idle", 0.0 if idle is None else idle.drawn_A, rating.idle_inductance_H, MUTED, "--"),
    ]
    for name, current, inductance, colour, line in curves:
        text = words("coil", name, current=significant(current))
        panels[0].plot(x, 1e3 * inductance, line, color=colour, label=text)
        panels[1].plot(x, 1e3 * rating.time_constant_s(inductance), line, color=colour, label=text)
    panels[2].plot(x, rating.motor_constant, color=BLUE)
    for ax, name in zip(panels, ("inductance", "time", "motor_constant"), strict=True):
        label(ax, "coil", "distance", name)
    for ax in panels[:2]:
        ax.set_ylim(0.0, 1.08 * ax.get_ylim()[1])
    panels[0].legend(loc="best")
    return figure


def force_curves_figure(grid: SweepGrid, weight: float | None, differential: bool = False) -> Figure:
    """Draw force over distance, a curve for each current, on logarithmic axes too where its sign allows.

    Parameters
    ----------
    differential : bool
        Whether the current is the differential one of several circuits.
    """
    figure = new_figure(3.3)
    scales = ("linear",) if changes_sign(grid) else ("linear", "log")
    axes = figure.subplots(1, len(scales), squeeze=False)[0]
    factor, unit = axis_scale(grid.force, "N")
    for ax, scale in zip(axes, scales, strict=True):
        for colour, current, force in zip(ordered_colours(len(grid.currents)), grid.currents, grid.force, strict=True):
            if scale == "log" and not np.all(force > 0):
                continue
            text = words("force-curves", "current", current=f"{current:.3g}")
            ax.plot(MM * grid.distances, factor * force, color=colour, label=text)
        if weight is not None:
            ax.axhline(
                factor * weight, color=VERMILION, linewidth=1.0, dashes=(5, 3), label=words("force-curves", "weight")
            )
        label(ax, "force-curves", "distance", "force", unit=unit)
        ax.set(xscale=scale, yscale=scale)
        if scale == "log":
            _plain_decades(ax.xaxis)
            _plain_decades(ax.yaxis)
    figure.legend(
        *axes[0].get_legend_handles_labels(),
        loc="outside right center",
        title=words("force-curves", "differential" if differential else "legend"),
    )
    return figure


def force_map_figure(grid: SweepGrid, weight: float | None, differential: bool = False) -> Figure:
    """Draw force over distance and current in colours, blue and red where it changes its sign.

    The weight in N is drawn as the line on which the body is held; ``differential`` as of :func:`force_curves_figure`.
    """
    from matplotlib.colors import LogNorm, Normalize
    from matplotlib.ticker import MaxNLocator

    figure = new_figure(3.6)
    axes = figure.subplots()
    factor, unit = axis_scale(grid.force, "N")
    x, force = MM * grid.distances, factor * grid.force
    top = float(force.max())
    floor = max(float(force.min()), top / 300.0)
    both = changes_sign(grid)
    if both:
        largest = float(np.max(np.abs(force)))
        norm, colours, lines_colour = Normalize(-largest, largest), "RdBu_r", "black"
        levels = np.asarray(MaxNLocator(8).tick_values(float(force.min()), top))
    else:
        norm = LogNorm(floor, top) if top > 5.0 * floor else Normalize(float(force.min()), top)
        colours, lines_colour = "cividis", "white"
        levels = np.concatenate([np.array([1.0, 2.0, 5.0]) * 10.0**k for k in range(-6, 9)])
        levels = levels[(levels > floor) & (levels < top)]
    shown = force if both else np.maximum(force, floor)
    image = axes.pcolormesh(x, grid.currents, shown, norm=norm, cmap=colours, shading="gouraud", rasterized=True)
    if weight is not None:
        levels = levels[np.abs(levels - factor * weight) > CROWDED * factor * weight]
    if levels.size:
        lines = axes.contour(x, grid.currents, force, levels=levels, colors=lines_colour, linewidths=0.8)
        axes.clabel(lines, fmt=lambda value: f"{value:g}", fontsize=8)
    if weight is not None and force.min() < factor * weight < top:
        held = axes.contour(x, grid.currents, force, levels=[factor * weight], colors=[VERMILION], linewidths=2.2)
        axes.clabel(held, fmt=lambda value: words("force-map", "weight", weight=f"{value:.3g}"), fontsize=8.5)
    label(axes, "force-map", "distance", "differential" if differential else "current")
    axes.grid(visible=False)
    bar = figure.colorbar(image, ax=axes, pad=0.02)
    bar.set_label(words("force-map", "force", unit=unit))
    if isinstance(norm, LogNorm):
        _plain_decades(bar.ax.yaxis)
    return figure


def changes_sign(grid: SweepGrid) -> bool:
    """Whether the force both attracts and repels, so that logarithms would hide a part of it."""
    low, high = float(grid.force.min()), float(grid.force.max())
    return min(-low, high) > 0.05 * max(-low, high)


def _plain_decades(axis: "Axis") -> None:
    """Numbers such as 20 and 0.5 on a logarithmic axis, not powers of ten, and at more than whole decades."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())
