"""The picture of a distance that is sensed without a sensor of position."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from femfit.core.atomic import replacing
from femfit.core.outputs import PICTURE, require_outputs
from femfit.open_loop.sense import Sensing
from femfit.report.style import BLUE, DPI, INK, MUTED, VERMILION, new_figure, style, styled, words

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_FLOOR_M = 1e-7
"""Conventional: errors below a tenth of a micrometre are drawn as that."""


@styled
def sense_figure(found: Sensing) -> "Figure":
    """Draw the motion with the filter's error, and that error beside its bound."""
    figure = new_figure(4.5)
    path, error = figure.subplots(2, 1)
    time, distance = 1e3 * found.time_s, 1e3 * found.distance_m
    rms = 1e3 * found.rms_m
    path.fill_between(time, distance - rms, distance + rms, color=BLUE, alpha=0.25, label=words("sense", "band"))
    path.plot(time, distance, color=INK, label=words("sense", "true"))
    path.set(ylabel=words("sense", "distance"), xticklabels=[])
    path.legend(ncols=2)
    for values, colour, key in (
        (found.rms_m, BLUE, "rms"),
        (found.claimed_m, VERMILION, "claimed"),
        (found.bound_m, MUTED, "bound"),
    ):
        error.semilogy(time, 1e6 * np.maximum(values, _FLOOR_M), color=colour, label=words("sense", key))
    error.set(ylabel=words("sense", "error"), xlabel=words("sense", "time"))
    error.legend(ncols=3)
    return figure


def write_sense_picture(found: Sensing, path: Path) -> None:
    """Write the picture as PNG, SVG or PDF, by the file's suffix."""
    require_outputs([], (path, PICTURE))
    with style(), replacing(path) as unfinished:
        sense_figure(found).savefig(unfinished, dpi=DPI, format=path.suffix.lstrip(".").lower() or "png")
