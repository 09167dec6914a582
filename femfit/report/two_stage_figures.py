"""The paper's two stages: Figures 8, 9 and 10."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from femfit.fit.law_fit import LawFit
from femfit.fit.rows import FitRows
from femfit.report.formula import formula_label
from femfit.report.numbers import force_scale
from femfit.report.style import BLUE, CATEGORIES, INK, VERMILION, new_figure, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MM = 1e3
CURVES = 3


@styled
def residual_sums_figure(fits: Sequence[LawFit]) -> "Figure":
    """Figure 8 of the paper: J_1 and J_2, the sum of squared residuals at each current."""
    figure = new_figure(2.8)
    axes = figure.subplots()
    factor, unit = force_scale(np.sqrt(np.max([fit.stage_one.residual_sums for fit in fits], axis=0)))
    for n, (colour, marker, fit) in enumerate(zip(CATEGORIES, "osD", fits, strict=False), start=1):
        label = f"J{chr(0x2080 + n)} of {fit.law.name}"
        sums = fit.stage_one.residual_sums
        known = sums > 0.0  # without force there is nothing to miss
        axes.semilogy(fit.stage_one.currents[known], factor**2 * sums[known], marker=marker, color=colour, label=label)
    axes.set(xlabel="current i (A)", ylabel=f"sum of squared residuals ({unit}²)")
    axes.legend(loc="best")
    return figure


@styled
def curve_fit_figure(fits: Sequence[LawFit], rows: FitRows) -> "Figure":
    """Figure 9 of the paper: laws on force curves at three currents, with their residuals below.

    Parameters
    ----------
    fits : sequence of LawFit
        A column each; their stage-one coefficients are drawn.

    Returns
    -------
    Figure
        Points of the sweep, lines of the law; residuals.
    """
    figure = new_figure(4.4)
    factor, unit = force_scale(rows.force)
    panels = figure.subplots(2, len(fits), sharex=True, height_ratios=(2.2, 1.0), squeeze=False)
    chosen = shown_currents(len(rows.currents))
    for column, fit in enumerate(fits):
        above, below = panels[:, column]
        for colour, k in zip(CATEGORIES, chosen, strict=False):
            current = rows.currents[k]
            at = rows.current == current
            order = np.argsort(rows.distance[at])
            d, force = rows.distance[at][order], rows.force[at][order]
            law = fit.law.columns(d, fit.shape) @ fit.stage_one.coefficients[k]
            above.plot(MM * d[::2], factor * force[::2], "o", color=colour, markersize=2.6, fillstyle="none")
            above.plot(MM * d, factor * law, color=colour, label=f"{current:g} A")
            below.plot(MM * d, factor * (law - force), color=colour)
        below.axhline(0.0, color=INK, linewidth=0.8)
        above.set_title(f"{fit.law.name}:  {formula_label(fit.law.formula)}")
        below.set_xlabel("distance d (mm)")
    low, high = factor * min(rows.force.min(), 0.0), factor * max(rows.force.max(), 0.0)
    for above in panels[0]:  # the sweep's range with room for the legend; a bad law may leave it
        above.set_ylim(low - 0.05 * (high - low), high + 0.3 * (high - low))
    panels[0, 0].set_ylabel(f"force F ({unit})")
    panels[1, 0].set_ylabel(f"law − sweep ({unit})")
    panels[0, -1].legend(title="sweep (○), law (—)", loc="upper right")
    return figure


def shown_currents(count: int) -> list[int]:
    """Indices of the currents drawn: 0, 0.6 and 1.2 A of the paper's eight, the like of other sweeps."""
    last = max(count - 2, 0) if count > CURVES else count - 1
    return sorted({0, last // 2, last})


@styled
def coefficient_figure(fit: LawFit) -> "Figure":
    """Figure 10 of the paper: a law's coefficients at each current, and the functions fitted to them."""
    count = len(fit.law.basis)
    figure = new_figure(2.7 if count <= 3 else 4.6)
    columns = count if count <= 3 else (count + 1) // 2
    panels = figure.subplots(1 if count <= 3 else 2, columns, squeeze=False).ravel()
    currents = fit.stage_one.currents
    fine = np.linspace(currents[0], currents[-1], 100)
    for k, (ax, basis, function) in enumerate(zip(panels, fit.law.basis, fit.stage_two, strict=False)):
        ax.plot(currents, fit.stage_one.coefficients[:, k], "o", color=BLUE, markersize=4.5, label="stage one")
        ax.plot(fine, function.at(fine), color=VERMILION, label=f"stage two: {function.name}")
        low, high = ax.get_ylim()
        if not np.any(fit.stage_one.coefficients[:, k]):
            ax.set_yticks([0.0])
        if low > 0.5 * high > 0.0:
            ax.set_ylim(0.0, 1.15 * high)
        symbol = "abcdefgh"[k]
        ax.set(
            xlabel="current i (A)",
            ylabel=f"{symbol} ({formula_label(fit.law.coefficient_units[k])})",
            title=f"{symbol}, coefficient of {formula_label(basis)}",
        )
        ax.legend(loc="best")
    for ax in panels[count:]:
        ax.remove()
    return figure
