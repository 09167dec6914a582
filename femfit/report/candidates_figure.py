"""Why a law fits or not: the data's local exponent, the candidates' error against their cost, residual maps."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.fit.law_fit import LawFit
from femfit.fit.ranking import TARGET, Ranking
from femfit.fit.rows import FitRows
from femfit.model.magnetics import Magnetics
from femfit.report.style import BLUE, MUTED, VERMILION, new_figure, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MM = 1e3
POINTS = 200


def local_exponents(magnetics: Magnetics, rows: FitRows) -> dict[str, tuple[FloatArray, FloatArray]]:
    """Exponent n of d^-n by which a part of the force falls, n = -d ln|f| / d ln d.

    Parameters
    ----------
    rows : FitRows
        Whose range of distances and currents is taken.

    Returns
    -------
    dict of str to (array, array)
        Distance in m and exponent, of the current-free force and of k_m = dF/di; parts that vanish or change sign are
        left out.
    """
    d = np.linspace(rows.distances[0], rows.distances[-1], POINTS)
    low, high = (np.full_like(d, i) for i in (rows.currents[0], rows.currents[-1]))
    largest = float(np.max(np.abs(rows.force)))
    found = {}
    if rows.currents[0] == 0.0:
        force, slope = magnetics.force(d, low), magnetics.force_gradient(d, low)
        if np.all(force > 1e-6 * largest):
            found["current-free force F(d, 0)"] = (d, -d * slope / force)
    constant, gradient = (-value for value in magnetics.coenergy_derivatives(d, 0.5 * (low + high), ((1, 1), (2, 1))))
    if np.all(constant > 0.0):
        found["force per current ∂F/∂i"] = (d, -d * gradient / constant)
    return found


@styled
def exponent_figure(exponents: dict[str, tuple[FloatArray, FloatArray]]) -> "Figure":
    """Draw the local exponents beside what F1e allows."""
    figure = new_figure(3.0)
    axes = figure.subplots()
    for colour, (label, (d, n)) in zip((BLUE, VERMILION), exponents.items(), strict=False):
        axes.plot(MM * d, n, color=colour, label=label)
    for level, label in ((4.0, "d⁻⁴"), (2.0, "d⁻²")):
        axes.axhline(level, color=MUTED, linewidth=1.0, dashes=(4, 3))
        axes.annotate(
            label,
            (1.0, level),
            xycoords=("axes fraction", "data"),
            xytext=(4, 0),
            textcoords="offset points",
            va="center",
        )
    axes.set(xlabel="distance d (mm)", ylabel="local exponent n, part ∝ d⁻ⁿ")
    axes.set_ylim(bottom=0.0)
    axes.legend(loc="best")
    return figure


@styled
def ranking_figure(ranking: Ranking) -> "Figure":
    """Held-out error against floating-point operations, a point a candidate.

    Returns
    -------
    Figure
        With the target, and the recommended law marked.
    """
    figure = new_figure(3.5)
    axes = figure.subplots()
    fitted = [c for c in ranking.candidates if c.fit is not None]
    x = np.array([c.fit.operations for c in fitted if c.fit is not None])
    y = np.array([100.0 * c.held_out_rms for c in fitted])
    axes.semilogy(x, y, "o", color=BLUE, markersize=5)
    best = fitted.index(ranking.recommended)
    axes.semilogy(x[best], y[best], "o", color=VERMILION, markersize=9, fillstyle="none", markeredgewidth=1.8)
    axes.axhline(100.0 * TARGET, color=MUTED, linewidth=1.0, dashes=(4, 3))
    axes.annotate(
        f"target {100 * TARGET:g} %",
        (1.0, 100.0 * TARGET),
        xycoords=("axes fraction", "data"),
        xytext=(4, 0),
        textcoords="offset points",
        va="center",
        color=MUTED,
        fontsize=8.5,
    )
    axes.set(xlabel="floating-point operations of one evaluation", ylabel=f"held-out rms error (% of the {ranking.of})")
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
    bold : int
        Index of the point that is written bold.
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
    """Maps of fitted minus solved force.

    Parameters
    ----------
    forces : sequence of (str, array)
        Name and force of each model at the rows, N.

    Returns
    -------
    Figure
        A panel a model, each with its own scale, in per cent of the weight (or of the rms force).
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
        ax.set(title=name, xlabel="distance d (mm)")
        ax.grid(visible=False)
        bar = figure.colorbar(image, ax=ax, location="bottom", pad=0.03, aspect=22)
        bar.locator = MaxNLocator(4)
        bar.ax.tick_params(labelsize=8)
        bar.set_label(f"(% of the {of})", fontsize=8.5)
    panels[0].set_ylabel("current i (A)")
    return figure


def law_force(fit: LawFit, rows: FitRows) -> FloatArray:
    """A law's force at the rows, with the coefficients of the model, in N.

    Returns
    -------
    array, shape (rows,)
        In N.
    """
    return fit.force(fit.joint.x, rows.distance, rows.current)
