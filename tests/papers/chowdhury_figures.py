"""Figures 6 to 11 of the levitation paper, on a run of femfit.

    python tests/papers/chowdhury_figures.py runs/emaws-rig build/figures

draws the force over distance and current (6), force curves (7), the sum of squared residuals of F1e and F2e at each
current (8), both laws on three force curves (9), the coefficients of F1e over the current (10), the Hall characteristic
(11), and beside them the exponent by which the force falls, which says why F1e fits or not. Figures 15 to 18 are in the
report that ``femfit run`` writes; Figure 19 shows what tests/papers/chowdhury_table6.py prints.

References
----------
A. Chowdhury and A. Sarjas, Sensors 16 (2016) 1504, Figures 6 to 11.
"""

import argparse
import re
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from femfit.core.text import axis_scale
from femfit.fit.build import fit_model
from femfit.fit.law_fit import fit_law
from femfit.laws.catalogue import law_by_name
from femfit.report.force_figures import force_curves_figure, force_map_figure
from femfit.report.model_figures import hall_figure
from femfit.report.rating import sweep_grid
from femfit.report.style import BLUE, CATEGORIES, INK, MUTED, VERMILION, new_figure, style
from femfit.tables.sweep_table import read_sweep_table
from support.coenergies import partials
from support.one_current import flat

MM = 1e3
CURVES = 3

_EXPONENT = re.compile(r"\^(?:\((-?[\d/]+)\)|(-?\d+))")


def formula_label(formula):
    """A formula in a picture, its exponents raised."""
    return _EXPONENT.sub(lambda m: f"$^{{{(m[1] or m[2]).replace('-', '−')}}}$", formula)


def local_exponents(magnetics, rows):
    """Distance in m and n = -d ln|f| / d ln d, of the current-free force and of k_m = dF/di, over the rows' range.

    Parts that vanish or change sign are left out.
    """
    d = np.linspace(rows.distances[0], rows.distances[-1], 200)
    low, high = (np.full_like(d, i) for i in (rows.currents[0], rows.currents[-1]))
    found = {}
    if rows.currents[0] == 0.0:
        force, slope = flat(magnetics).force(d, low), flat(magnetics).force_gradient(d, low)
        if np.all(force > 1e-6 * np.abs(rows.force).max()):
            found["current-free force F(d, 0)"] = (d, -d * slope / force)
    constant, gradient = (-value for value in partials(magnetics.expression, d, 0.5 * (low + high), ((1, 1), (2, 1))))
    if np.all(constant > 0.0):
        found["force per current ∂F/∂i"] = (d, -d * gradient / constant)
    return found


def exponent_figure(exponents):
    """The local exponents beside what F1e allows."""
    figure = new_figure(3.0)
    axes = figure.subplots()
    for colour, (label, (d, n)) in zip((BLUE, VERMILION), exponents.items(), strict=False):
        axes.plot(MM * d, n, color=colour, label=label)
    for level in (4.0, 2.0):  # those of d^-4 and d^-2
        axes.axhline(level, color=MUTED, linewidth=1.0, dashes=(4, 3))
    axes.set(xlabel="distance d (mm)", ylabel="local exponent n, part ∝ d⁻ⁿ", ylim=(0.0, None))
    axes.legend(loc="best")
    return figure


def residual_sums_figure(fits):
    """Figure 8 of the paper: J_1 and J_2, the sum of squared residuals at each current."""
    figure = new_figure(2.8)
    axes = figure.subplots()
    factor, unit = axis_scale(np.sqrt(np.max([fit.stage_one.residual_sums for fit in fits], axis=0)), "N")
    for n, (colour, marker, fit) in enumerate(zip(CATEGORIES, "osD", fits, strict=False), start=1):
        sums, label = fit.stage_one.residual_sums, f"J{chr(0x2080 + n)} of {fit.law.name}"
        some = sums > 0.0  # without force there is nothing to miss
        axes.semilogy(fit.stage_one.currents[some], factor**2 * sums[some], marker=marker, color=colour, label=label)
    axes.set(xlabel="current i (A)", ylabel=f"sum of squared residuals ({unit}²)")
    axes.legend(loc="best")
    return figure


def curve_fit_figure(fits, rows):
    """Figure 9 of the paper: the laws' stage-one coefficients on force curves at three currents, residuals below."""
    figure = new_figure(4.4)
    factor, unit = axis_scale(rows.force, "N")
    panels = figure.subplots(2, len(fits), sharex=True, height_ratios=(2.2, 1.0), squeeze=False)
    for (above, below), fit in zip(panels.T, fits, strict=True):
        for colour, k in zip(CATEGORIES, shown_currents(len(rows.currents)), strict=False):
            current = rows.currents[k]
            here = np.flatnonzero(rows.current == current)
            here = here[np.argsort(rows.distance[here])]
            d, force = rows.distance[here], rows.force[here]
            law = fit.law.columns(d, fit.shape) @ fit.stage_one.coefficients[k]
            above.plot(MM * d[::2], factor * force[::2], "o", color=colour, markersize=2.6, fillstyle="none")
            above.plot(MM * d, factor * law, color=colour, label=f"{current:g} A")
            below.plot(MM * d, factor * (law - force), color=colour)
        below.axhline(0.0, color=INK, linewidth=0.8)
        above.set_title(f"{fit.law.name}:  {formula_label(fit.law.formula)}")
        below.set_xlabel("distance d (mm)")
        # The sweep's range with room for the legend; a bad law may leave it
        low, high = factor * min(rows.force.min(), 0.0), factor * max(rows.force.max(), 0.0)
        above.set_ylim(low - 0.05 * (high - low), high + 0.3 * (high - low))
    panels[0, 0].set_ylabel(f"force F ({unit})")
    panels[1, 0].set_ylabel(f"law − sweep ({unit})")
    panels[0, -1].legend(title="sweep (○), law (—)", loc="upper right")
    return figure


def shown_currents(count):
    """Indices of the currents drawn: 0, 0.6 and 1.2 A of the paper's eight, the like of other sweeps."""
    last = max(count - 2, 0) if count > CURVES else count - 1
    return sorted({0, last // 2, last})


def coefficient_figure(fit):
    """Figure 10 of the paper: a law's coefficients at each current, and the functions fitted to them."""
    figure = new_figure(2.7)
    panels = figure.subplots(1, len(fit.law.basis), squeeze=False).ravel()
    currents = fit.stage_one.currents
    fine = np.linspace(currents[0], currents[-1], 100)
    for k, (axes, basis, function) in enumerate(zip(panels, fit.law.basis, fit.stage_two, strict=True)):
        axes.plot(currents, fit.stage_one.coefficients[:, k], "o", color=BLUE, markersize=4.5, label="stage one")
        axes.plot(fine, function.at(fine), color=VERMILION, label=f"stage two: {function.name}")
        symbol, unit = "abcdefgh"[k], formula_label(fit.law.coefficient_units[k])
        title = f"{symbol}, coefficient of {formula_label(basis)}"
        axes.set(xlabel="current i (A)", ylabel=f"{symbol} ({unit})", title=title)
        axes.legend(loc="best")
    return figure


def figures(run):
    """The figures of a run by their number in the paper."""
    fit = fit_model(read_sweep_table(run))
    rows, grid = fit.rows, sweep_grid(fit.rows)
    laws = [fit_law(law_by_name(name), rows) for name in ("F1e", "F2e")]
    drawn = {
        "figure-06": force_map_figure(grid, rows.weight),
        "figure-07": force_curves_figure(grid, rows.weight),
        "figure-08": residual_sums_figure(laws),
        "figure-09": curve_fit_figure(laws, rows),
        "figure-10": coefficient_figure(laws[0]),
        "exponents": exponent_figure(local_exponents(fit.model.magnetics, rows)),
    }
    return drawn | ({"figure-11": hall_figure(fit.model, rows)} if fit.model.sensor is not None else {})


def main():
    """Draw the figures of a run directory into another directory."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("run", type=Path, help="run directory of femfit run or femfit sweep")
    parser.add_argument("output", type=Path, help="directory for the figures")
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    with style():
        for name, figure in figures(options.run).items():
            figure.savefig(options.output / f"{name}.png", dpi=150)
            print(options.output / f"{name}.png")


if __name__ == "__main__":
    main()
