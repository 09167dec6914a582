"""Offset voltages and fields by method: Figures 5 to 8 of the paper on integrators.

References
----------
P. Arpaia et al., Sensors 22 (2022) 182, Figures 5 to 8.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from femfit.integrate.uncertainty import FieldBlock

COLOURS: Mapping[str, str] = {
    "trapezoid": "#d55e00",
    "ffa1": "#0072b2",
    "ffa2": "#e69f00",
    "cs1": "#24292f",
    "cs2": "#009e73",
    "cs1-offset": "#56b4e9",
    "cs2-identified": "#cc79a7",
}
"""Okabe and Ito's palette, which colour-blind readers can tell apart."""

POINTS = 4000
"""Of a curve."""

MAGNIFIED = (0.1, 1e-3)
"""Half heights of the lower rows of Figure 7 about the field on the last flat-top, T."""


def offsets_figure(blocks: Mapping[float, Mapping[str, FieldBlock]], methods: Sequence[str]) -> Figure:
    """Figures 5 and 6: the offset voltage that each method finds, a panel for each ramp rate.

    Parameters
    ----------
    blocks : mapping of (mapping of FieldBlock)
        By ramp rate in A/s, then method.
    """
    figure = _new_figure(5.2)
    axes = figure.subplots(len(blocks), 1, squeeze=False)[:, 0]
    for panel, (rate, found) in zip(axes, blocks.items(), strict=True):
        for method in methods:
            block = found[method]
            rows = _thin(block)
            panel.plot(block.time[rows], 1e6 * block.offset[rows], color=COLOURS[method], linewidth=0.9, label=method)
        panel.set(ylabel="offset (µV)", title=f"{rate:g} A/s")
    axes[-1].set_xlabel("time (s)")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=len(methods))
    return figure


def fields_figure(blocks: Mapping[float, Mapping[str, FieldBlock]], methods: Sequence[str]) -> Figure:
    """Figure 7: the field by method, a column for each ramp rate, magnified from row to row about the flat-tops.

    Parameters
    ----------
    blocks : mapping of (mapping of FieldBlock)
        By ramp rate in A/s, then method; cs1 tells the flat-tops' field.

    Returns
    -------
    Figure
        In T, then mT beside the field on the flat-tops.
    """
    figure = _new_figure(6.0)
    axes = figure.subplots(1 + len(MAGNIFIED), len(blocks), sharex="col", sharey="row", squeeze=False)
    for column, (rate, found) in zip(axes.T, blocks.items(), strict=True):
        top = float(np.nanquantile(found["cs1"].field, 0.9))
        for method in methods:
            block = found[method]
            rows = _thin(block)
            time, field = block.time[rows], block.field[rows]
            column[0].plot(time, field, color=COLOURS[method], linewidth=0.9, label=method)
            for panel in column[1:]:
                panel.plot(time, 1e3 * (field - top), color=COLOURS[method], linewidth=0.9)
        column[0].set_title(f"{rate:g} A/s")
        column[-1].set_xlabel("time (s)")
    axes[0, 0].set_ylabel("field (T)")
    for row, half in zip(axes[1:], MAGNIFIED, strict=True):
        row[0].set(ylabel="field − top (mT)", ylim=(-1e3 * half, 1e3 * half))
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=len(methods))
    return figure


def flat_top_figure(blocks: Mapping[str, FieldBlock], flat_top: tuple[float, float], methods: Sequence[str]) -> Figure:
    """Figure 8: the last flat-top."""
    figure = _new_figure(2.8)
    axes = figure.subplots()
    for method in methods:
        block = blocks[method]
        rows = np.flatnonzero((block.time > flat_top[0] + 0.5) & (block.time < flat_top[1]))
        rows = rows[:: max(1, len(rows) // POINTS)]
        axes.plot(block.time[rows], block.field[rows], color=COLOURS[method], linewidth=0.9, label=method)
    axes.set(xlabel="time (s)", ylabel="field (T)")
    axes.ticklabel_format(axis="y", useOffset=False)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=len(methods))
    return figure


def _new_figure(height: float) -> Figure:
    return Figure(figsize=(7.8, height), layout="constrained")


def _thin(block: FieldBlock) -> slice:
    return slice(None, None, max(1, len(block.time) // POINTS))
