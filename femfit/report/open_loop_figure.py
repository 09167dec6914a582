"""The picture of a motion in open loop."""

from pathlib import Path
from typing import TYPE_CHECKING

from femfit.core.atomic import replacing
from femfit.core.outputs import PICTURE, require_outputs
from femfit.core.sweep_columns import circuit_currents, voltage_columns
from femfit.open_loop.result import OpenLoop
from femfit.report.style import (
    BLUE,
    CATEGORIES,
    DPI,
    GREEN,
    INK,
    MUTED,
    ORANGE,
    VERMILION,
    new_figure,
    style,
    styled,
    words,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MS = 1e3
_SPAN = 0.1
"""Conventional: share of its height that a panel leaves free at each end of its lines."""


@styled
def open_loop_figure(motion: OpenLoop) -> "Figure":
    """Draw distance with the stops, velocity, current, voltage and forces over time, first touches marked."""
    figure = new_figure(7.0)
    panels = figure.subplots(5, 1, sharex=True, height_ratios=(1.6, 1.0, 1.0, 1.0, 1.2))
    table, mechanics = motion.table, motion.model.require_motion()
    time, names = _MS * table["time_s"], motion.model.circuit_names
    several = len(names) > 1
    for axes, columns, factor, colour, key in (
        (panels[0], ["distance_m"], 1e3, BLUE, "distance"),
        (panels[1], ["velocity_m_s"], 1.0, GREEN, "velocity"),
        (panels[2], circuit_currents(names), 1.0, VERMILION, "current"),
        (panels[3], voltage_columns(names), 1.0, MUTED, "voltage"),
    ):
        for k, column in enumerate(columns):
            of_circuit = several and axes in (panels[2], panels[3])
            look = CATEGORIES[k % len(CATEGORIES)] if of_circuit else colour
            axes.plot(time, factor * table[column], color=look, label=names[k] if of_circuit else None)
        axes.set_ylabel(words("open_loop", key))
    if several:
        panels[2].legend(ncols=len(names))
    for stop in (mechanics.near_stop, mechanics.far_stop):
        if stop is not None:
            panels[0].axhline(1e3 * stop.distance_m, color=INK, linewidth=0.7, dashes=(2, 2))
    panels[4].plot(time, table["force_N"], color=BLUE, label=words("open_loop", "magnetic"))
    panels[4].plot(time, table["static_force_N"], color=ORANGE, label=words("open_loop", "static"))
    panels[4].set(ylabel=words("open_loop", "force"), xlabel=words("open_loop", "time"))
    panels[4].legend(ncols=2)
    for axes in panels:
        _mark(axes, motion)
        axes.margins(y=_SPAN)
    figure.align_ylabels()
    return figure


def _mark(axes: "Axes", motion: OpenLoop) -> None:
    for one in motion.switchings:
        axes.axvline(_MS * one.reached_s, color=MUTED, linewidth=0.7)
    for _, time in motion.left_domain:
        axes.axvspan(_MS * time, _MS * motion.end_s, color=MUTED, alpha=0.15)


def write_open_loop_picture(motion: OpenLoop, path: Path) -> None:
    """Write the picture as PNG, SVG or PDF, by the file's suffix."""
    require_outputs([], (path, PICTURE))
    with style(), replacing(path) as unfinished:
        open_loop_figure(motion).savefig(unfinished, dpi=DPI, format=path.suffix.lstrip(".").lower() or "png")
