"""Figures of what would explain a misfit, how far the error fell, and what was learnt as unexplained."""

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np

from femfit.core.numerics import FloatArray
from femfit.core.text import axis_scale
from femfit.effects.effect import AddedEffect
from femfit.identify.decision.diagnosis import ScoredEffect
from femfit.identify.observations import Observations
from femfit.model.carried import Carried, Curve
from femfit.report.style import (
    BLUE,
    GREEN,
    INK,
    MUTED,
    ORANGE,
    VERMILION,
    WIDTH,
    Axes,
    Figure,
    new_figure,
    plain,
    words,
)
from femfit.tables.measurement import CHANNEL_WORDS

Panel = Callable[[Figure, Axes], None]
"""What draws a panel of a figure."""

SHOWN = 12


def ranking_figure(
    ranking: Sequence[ScoredEffect], excess: float, named: Sequence[str], members: Sequence[str]
) -> Figure:
    """Share of the structured misfit that each effect explains by itself; a dot for that on runs left out."""
    shown = list(ranking)[:SHOWN]
    figure = new_figure(0.9 + 0.24 * len(shown))
    axes = figure.subplots()
    y = np.arange(len(shown))
    share = [100.0 * min(max(s.chi2_fall - s.degrees_of_freedom, 0.0) / max(excess, 1e-12), 1.0) for s in shown]
    colours = [VERMILION if s.name in named else ORANGE if s.name in members else "#b8c0c8" for s in shown]
    axes.barh(y, share, color=colours, height=0.7)
    for k, s in enumerate(shown):
        if np.isfinite(s.explained_share):
            axes.plot(100.0 * float(np.clip(s.explained_share, 0.0, 1.0)), k, "o", color=INK, markersize=4.5)
    axes.set_yticks(y, [s.name for s in shown])
    axes.invert_yaxis()
    axes.grid(visible=False, axis="y")
    axes.set(xlim=(0.0, 104.0), xlabel="structured misfit explained, each effect alone (%)")
    if any(np.isfinite(s.explained_share) for s in shown):
        axes.plot([], [], "o", color=INK, markersize=4.5, label="on runs left out")
    for colour, label in ((VERMILION, "named"), (ORANGE, "not told from it")):
        if colour in colours:
            axes.barh([0], [0], color=colour, label=label)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc="lower right")
    return figure


def waterfall_figure(steps: Sequence[tuple[str, dict[str, float]]], floor: dict[str, float]) -> Figure:
    """How each step lowers the error of each channel towards the noise, a panel a channel.

    A step is what was added, and the error per channel with it and all before; the first is the model as it was.
    """
    names = [name for name in steps[0][1] if name in floor]
    labels = [*(text for text, _ in steps), "after"]
    figure = new_figure(0.85 + 0.3 * len(labels), width=min(WIDTH, 2.2 + 1.6 * len(names)))
    panels = figure.subplots(1, len(names), squeeze=False, sharey=True)[0]
    for ax, name in zip(panels, names, strict=True):
        _waterfall(ax, [values[name] / floor[name] for _, values in steps])
        ax.set_title(CHANNEL_WORDS[name])
        ax.set_xlabel("rms error / noise")
    panels[0].set_yticks(range(len(labels)), labels)
    panels[0].invert_yaxis()
    return figure


def _waterfall(ax: Axes, heights: Sequence[float]) -> None:
    """Bars from top to bottom: all of the first, the changes, all of the last; a dashed line at the noise."""
    top = max(*heights, 1.0)
    bars = [(0.0, heights[0], VERMILION)]
    bars += [(min(a, b), abs(b - a), GREEN if b <= a else ORANGE) for a, b in pairwise(heights)]
    bars.append((0.0, heights[-1], BLUE))
    for k, (left, width, colour) in enumerate(bars):
        ax.barh(k, max(width, 0.006 * top), left=left, color=colour, height=0.66)
    for k, value in ((0, heights[0]), (len(bars) - 1, heights[-1])):
        ax.text(value + 0.02 * top, k, f"{value:.2f}" if value < 10.0 else plain(value, 3), va="center", fontsize=8.5)
    for k, value in enumerate(heights):
        ax.plot([value, value], [k + 0.33, k + 0.67], color=MUTED, linewidth=0.7)
    ax.axvline(1.0, color=INK, linewidth=1.0, dashes=(4, 3))
    ax.set_xlim(0.0, 1.25 * top)
    ax.grid(visible=False, axis="y")


_MM, _LEVELS, _POINTS = 1e3, 61, 400


def remainder_figure(added: AddedEffect, observations: Observations) -> Figure:
    """One panel for each thing that the remainder changes, within the data."""
    panels = _panels(added, observations)
    columns = min(len(panels), 3)
    rows = -(-len(panels) // columns)
    figure = new_figure(0.2 + 2.7 * rows, width=min(WIDTH, 0.6 + 3.0 * columns))
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    for draw, ax in zip(panels, axes, strict=False):
        draw(figure, ax)
    for ax in axes[len(panels) :]:
        ax.set_axis_off()
    return figure


def _panels(added: AddedEffect, observations: Observations) -> list[Panel]:
    carried = added.effect.carried
    result: list[Panel] = []
    if not isinstance(carried, Carried):
        return result
    for term in carried.magnetics or ():
        size = added.parameters[term.parameter] ** term.power
        if term.coenergy is not None:
            result += [
                _map("force", "N", term.coenergy.force, size, observations),
                _map("flux", "Wb", term.coenergy.flux_linkage, size, observations),
            ]
        if term.hall is not None:
            result.append(_map("hall", "T", term.hall.field, size, observations))
    curves: dict[str, Curve | None] = {**carried.readings, "force_branch": carried.branches.get("force_N")}
    curves |= carried.setting
    curves |= {"brake": carried.brake.against if carried.brake else None, "resistance": carried.resistance}
    return result + [_line(name, values, added) for name, values in curves.items() if values is not None]


def _map(
    what: str,
    unit: str,
    change: Callable[[FloatArray, FloatArray], FloatArray],
    size: float,
    observations: Observations,
) -> Panel:
    """A change of the field over distance and current, with the settings that were measured."""

    def draw(figure: Figure, ax: Axes) -> None:
        d, i = (observations.covariates[name].to_numpy() for name in ("distance_m", "current_A"))
        across, up = (np.linspace(x.min(), x.max(), _LEVELS) for x in (d, i))
        at_d, at_i = np.meshgrid(across, up)
        values = size * change(at_d.ravel(), at_i.reshape(-1, 1)).reshape(at_d.shape)
        factor, shown = axis_scale(values, unit)
        limit = max(float(np.abs(factor * values).max()), 1e-300)
        image = ax.pcolormesh(
            _MM * across,
            up,
            factor * values,
            cmap="RdBu_r",
            vmin=-limit,
            vmax=limit,
            shading="gouraud",
            rasterized=True,
        )
        ax.plot(_MM * d, i, ".", color=INK, markersize=1.5)
        ax.grid(visible=False)
        ax.set(xlabel=words("remainder", "distance"), ylabel=words("remainder", "current"))
        ax.set_title(words("remainder", what, unit=shown))
        figure.colorbar(image, ax=ax)

    return draw


def _line(name: str, curve: Curve, added: AddedEffect) -> Panel:
    """A curve between the ends of its data: the outer cells of its knots, where it is constant, are left out."""

    def draw(figure: Figure, ax: Axes) -> None:  # noqa: ARG001  a panel's signature
        breaks = np.unique(curve.knots)
        x = np.linspace(breaks[curve.degree], breaks[-1 - curve.degree], _POINTS)
        y = curve.at(x, added.parameters)
        label, over = (words("remainder", f"{name}_{side}").partition("|") for side in ("y", "x"))
        scales = [axis_scale(values, unit[2]) for values, unit in ((y, label), (x, over))]
        ax.plot(scales[1][0] * x, scales[0][0] * y, color=BLUE)
        ax.axhline(0.0, color=INK, linewidth=0.6)
        ax.set(xlabel=f"{over[0]} ({scales[1][1]})", ylabel=f"{label[0]} ({scales[0][1]})")

    return draw
