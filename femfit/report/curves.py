"""The picture that an engineer looks at first: measured points on the model's curves, before and after."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from femfit.core.amount import axis_scale
from femfit.core.arrays import FloatArray
from femfit.identify.comparison.curves import MeasuredCurves
from femfit.report.numbers import quantity
from femfit.report.style import INK, MUTED, new_figure, ordered_colours, styled, words
from femfit.tables.measurement import CHANNEL_WORDS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SETTING = {"distance_m": 1e3, "current_A": 1.0}
"""Factor of a setting's axis, in mm or A."""


@styled
def curves_figure(curves: MeasuredCurves, *, fitted: bool) -> "Figure":
    """Draw readings of one channel on the model's curves with the misfit below.

    Parameters
    ----------
    fitted : bool
        Whether something was added to the model: two columns then, before and after, on the same scales.
    """
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


def _draw(above: "Axes", below: "Axes", curves: MeasuredCurves, lines: FloatArray, misfit: FloatArray) -> None:
    factor, size = _SETTING[curves.along], axis_scale(curves.measured, curves.channel)[0]
    small = axis_scale(curves.misfit_before, curves.channel)[0]
    for k, (level, colour) in enumerate(zip(curves.levels, ordered_colours(len(curves.levels)), strict=True)):
        here = curves.level == k
        label = quantity(level, curves.over)
        if len(lines):
            above.plot(factor * curves.axis, size * lines[k], color=colour, linewidth=1.2, label=label)
        above.plot(
            factor * curves.x[here],
            size * curves.measured[here],
            "o",
            color=colour,
            markersize=2.8,
            fillstyle="none",
            label="" if len(lines) else label,
        )
        below.plot(factor * curves.x[here], small * misfit[here], "o", color=colour, markersize=2.2)
    below.axhline(0.0, color=INK, linewidth=0.8)
    if curves.noise is not None:
        below.axhspan(-small * curves.noise, small * curves.noise, color=MUTED, alpha=0.18, linewidth=0.0)


def worst_first(curves: Sequence[MeasuredCurves]) -> list[MeasuredCurves]:
    """Channels in the order of their misfit over the noise, or over their own size where the noise is not known."""

    def badness(one: MeasuredCurves) -> float:
        size = one.noise or float(np.max(np.abs(one.measured), initial=0.0)) or 1.0
        return round(-float(np.sqrt(np.mean(one.misfit_before**2))) / size, 9)

    return sorted(curves, key=badness)
