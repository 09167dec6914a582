"""How a model fits: laws ranked, maps of the misfit, the sensor's characteristic."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.fit.ranking import TARGET, Ranking
from femfit.fit.rows import FitRows
from femfit.model.actuator_model import ActuatorModel
from femfit.report.style import BLUE, MUTED, VERMILION, new_figure, ordered_colours, styled, words

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MM = 1e3
POINTS = 200


@styled
def ranking_figure(ranking: Ranking) -> "Figure":
    """Draw held-out error over floating-point operations, a point for each law; the recommended one is ringed."""
    figure = new_figure(3.5)
    axes = figure.subplots()
    fitted = [c for c in ranking.candidates if c.fit is not None]
    x = np.array([c.fit.operations for c in fitted if c.fit is not None])
    y = np.array([100.0 * c.error for c in fitted])
    axes.semilogy(x, y, "o", color=BLUE, markersize=5)
    best = fitted.index(ranking.recommended)
    axes.semilogy(x[best], y[best], "o", color=VERMILION, markersize=9, fillstyle="none", markeredgewidth=1.8)
    axes.axhline(100.0 * TARGET, color=MUTED, linewidth=1.0, dashes=(4, 3))
    axes.annotate(
        words("ranking", "target", target=f"{100 * TARGET:g}"),
        (1.0, 100.0 * TARGET),
        xycoords=("axes fraction", "data"),
        xytext=(4, 0),
        textcoords="offset points",
        va="center",
        color=MUTED,
        fontsize=8.5,
    )
    axes.set(xlabel=words("ranking", "operations"), ylabel=words("ranking", "error", scale=ranking.of))
    axes.margins(x=0.12, y=0.12)
    figure.draw_without_rendering()  # places in pixels are known from here on
    place_labels(axes, x, y, [c.law.name for c in fitted], best, 72.0 / figure.dpi)
    return figure


def place_labels(
    axes: "Axes", x: FloatArray, y: FloatArray, labels: Sequence[str], bold: int, points_per_pixel: float
) -> None:
    """Write each point's name where it covers neither a point nor another name.

    Parameters
    ----------
    x, y : array, shape (n,)
        Points.
    """
    points = points_per_pixel * axes.transData.transform(np.column_stack([x, y]))
    taken = [(px - 3.0, py - 3.0, px + 3.0, py + 3.0) for px, py in points]
    for k in np.argsort(y):
        width, height = (5.9 if k == bold else 5.2) * len(labels[k]), 10.0
        trials = [
            (dx, dy, (px + dx - width * (dx < 0) - 0.5 * width * (dx == 0), py + dy - 0.5 * height))
            for px, py in (points[k],)
            for dx, dy in ((7, 0), (-7, 0), (0, 11), (0, -11), (7, 9), (7, -9), (-7, 9), (-7, -9))
        ]
        free = [
            t for t in trials if not any(_overlap((*t[2], t[2][0] + width, t[2][1] + height), box) for box in taken)
        ]
        dx, dy, (left, low) = (free or trials)[0]
        taken.append((left, low, left + width, low + height))
        axes.annotate(
            labels[k],
            (x[k], y[k]),
            xytext=(dx, dy),
            textcoords="offset points",
            ha="left" if dx > 0 else "right" if dx < 0 else "center",
            va="center",
            fontsize=8.5,
            fontweight="bold" if k == bold else "normal",
        )


def _overlap(one: tuple[float, ...], other: tuple[float, ...]) -> bool:
    return one[0] < other[2] and other[0] < one[2] and one[1] < other[3] and other[1] < one[3]


@styled
def residual_figure(rows: FitRows, forces: Sequence[tuple[str, FloatArray]]) -> "Figure":
    """Draw fitted minus solved force, in per cent of the weight or of the rms force.

    Parameters
    ----------
    forces : sequence of (str, array)
        Name and force of each model at the rows, N; a panel each, with its own scale.
    """
    from matplotlib.ticker import MaxNLocator

    figure = new_figure(2.9)
    panels = figure.subplots(1, len(forces), sharey=True, squeeze=False)[0]
    scale, of = rows.error_scale
    order = np.lexsort((rows.distance, rows.current))
    for ax, (name, force) in zip(panels, forces, strict=True):
        residual = 100.0 * ((force - rows.force) / scale)[order].reshape(len(rows.currents), len(rows.distances))
        largest = float(np.max(np.abs(residual))) or 1.0
        image = ax.pcolormesh(
            MM * rows.distances,
            rows.currents,
            residual,
            cmap="RdBu_r",
            vmin=-largest,
            vmax=largest,
            shading="nearest",
            rasterized=True,
        )
        ax.set(title=name, xlabel=words("residuals", "distance"))
        ax.grid(visible=False)
        bar = figure.colorbar(image, ax=ax, location="bottom", pad=0.03, aspect=22)
        bar.locator = MaxNLocator(4)
        bar.ax.tick_params(labelsize=8)
        bar.set_label(words("residuals", "error", scale=of), fontsize=8.5)
    panels[0].set_ylabel(words("residuals", "current"))
    return figure


@styled
def hall_figure(model: ActuatorModel, rows: FitRows) -> "Figure":
    """Draw the sensor's output as the coil's part over voltage (or current), and as it is without current."""
    sensor = model.require_sensor()
    figure = new_figure(3.0)
    left, *others = figure.subplots(1, 2 if model.has_magnet else 1, squeeze=False)[0]
    currents, distances = rows.currents, rows.distances
    fine = np.linspace(currents[0], currents[-1], POINTS)
    resistance = None if model.circuit is None else model.circuit.resistance_ohm
    across = fine if resistance is None else resistance * fine
    shown = distances[[0, len(distances) // 2, -1]]
    for colour, style, d in zip(ordered_colours(3), ("-", "--", ":"), shown, strict=True):
        field = sensor.field.field(np.full_like(fine, d), fine) - sensor.field.field(np.array(d), np.array(0.0))
        left.plot(
            across,
            MM * sensor.sensitivity_V_per_T * field,
            style,
            color=colour,
            label=words("hall", "level", distance=f"{MM * d:g}"),
        )
    left.set(
        xlabel=words("hall", "current" if resistance is None else "voltage"),
        ylabel=words("hall", "coil"),
        title=words("hall", "coil_title"),
    )
    left.legend(loc="upper left")
    if not others:
        return figure
    right = others[0]
    span = np.linspace(distances[0], distances[-1], POINTS)
    right.plot(MM * span, sensor.voltage(span, np.zeros_like(span)), color=BLUE, label=words("hall", "fitted"))
    if rows.hall is not None and np.any(rows.current == 0.0):
        at = rows.current == 0.0
        volts = sensor.quiescent_V + sensor.sensitivity_V_per_T * rows.hall[at]
        right.plot(
            MM * rows.distance[at],
            volts,
            "o",
            color=VERMILION,
            markersize=2.8,
            fillstyle="none",
            label=words("hall", "sweep"),
        )
    right.axhline(sensor.quiescent_V, color=MUTED, linewidth=1.0, dashes=(4, 3), label=words("hall", "quiescent"))
    right.set(xlabel=words("hall", "distance"), ylabel=words("hall", "magnet"), title=words("hall", "magnet_title"))
    right.legend(loc="best")
    return figure
