"""The picture of one run of a closed loop."""

from pathlib import Path
from typing import TYPE_CHECKING

from femfit.core.atomic import replacing
from femfit.core.outputs import PICTURE, require_outputs
from femfit.report.style import BLUE, CATEGORIES, DPI, GREEN, INK, new_figure, style, styled, words
from femfit.simulation.summary import LoopSummary

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@styled
def closed_loop_figure(loop: LoopSummary) -> "Figure":
    """Draw distances, currents and commands of the first recorded run over time."""
    figure = new_figure(5.0)
    top, middle, bottom = figure.subplots(3, 1, sharex=True, height_ratios=(2.0, 1.0, 1.0))
    series, time = loop.result.series, loop.result.time_s
    top.plot(time, 1e3 * series.estimated_distance_m[:, 0], color=BLUE, label=words("loop", loop.experiment.observer))
    top.plot(time, 1e3 * series.distance_m[:, 0], color=INK, dashes=(4, 2), label=words("loop", "true"))
    top.plot(time, 1e3 * series.reference_m[:, 0], color=GREEN, label=words("loop", "reference"))
    top.set_ylabel(words("loop", "distance"))
    names = loop.design.model.circuit_names
    for k, name in enumerate(names):
        look = CATEGORIES[k % len(CATEGORIES)]
        middle.plot(time, series.currents_A[:, 0, k], color=look, label=name)
        bottom.plot(time, series.commands[:, 0, k], color=look, linewidth=0.6, rasterized=True)
    if len(names) > 1:
        middle.legend(ncols=len(names))
    middle.set_ylabel(words("loop", "current"))
    bottom.set(ylabel=words("loop", "voltage"), xlabel=words("loop", "time"))
    figure.align_ylabels()
    figure.legend(*top.get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return figure


def write_closed_loop_picture(loop: LoopSummary, path: str | Path) -> None:
    """Write the picture, in the form that the path's ending names."""
    path = Path(path)
    require_outputs([], (path, PICTURE))
    with style(), replacing(path) as partial:
        closed_loop_figure(loop).savefig(partial, format=path.suffix.removeprefix("."), dpi=DPI)
