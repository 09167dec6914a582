"""Tables 2 to 5 of the levitation paper on a sweep table.

    python tests/papers/chowdhury_force.py runs/emaws-rig

prints whether the force is linear in the current (Table 2), F1e and F2e at each current (Tables 3 and 5, Figures 8 and
9) and their coefficients as functions of the current (Table 4, Figure 10).

References
----------
A. Chowdhury and A. Sarjas, Sensors 16 (2016) 1504, eqs. (4) to (13).
"""

import sys

import numpy as np
from scipy.stats import f as fisher

from femfit.core.numerics import GRAVITY
from femfit.fit.law_fit import fit_law
from femfit.fit.rows import rows_of_table
from femfit.laws.catalogue import law_by_name
from femfit.tables.sweep_table import read_sweep_table

_ROUNDING = 1e-10
"""Relative residuals below this are rounding of stored numbers, not noise."""


def linearity_lines(rows):
    """Table 2 with its statistics right, of a full grid of three currents and more: F of nested polynomials."""
    currents, distances = rows.currents, rows.distances
    if len(currents) < 3 or len(rows.force) != len(currents) * len(distances):
        return ["no full grid of three currents: linearity not tested"]
    force = rows.force[np.lexsort((rows.distance, rows.current))].reshape(len(currents), len(distances))
    lines = ["differences of the force at adjacent currents, over the distances"]
    for low, high, step in zip(currents, currents[1:], 1e3 * np.diff(force, axis=0), strict=False):
        lines.append(f"  {low:.4g} to {high:.4g} A: mean {step.mean():.5g} mN, sd {step.std(ddof=1):.5g} mN")
    line, parabola = (np.vander(currents, n) @ np.polyfit(currents, force, n - 1) for n in (2, 3))
    part, residual = np.sum((parabola - line) ** 2), np.sum((force - parabola) ** 2)
    share = np.sqrt(part / np.sum((force - force.mean(axis=0)) ** 2))
    lines.append(f"  i^2 part: {100 * share:.2g} % of the dependence on current")
    freedom = len(distances), len(distances) * (len(currents) - 3)
    if freedom[1] and residual > _ROUNDING**2 * np.sum(force**2):
        f_value = part / freedom[0] / residual * freedom[1]
        p_value = fisher.sf(f_value, *freedom)
        lines.append(f"  test of the i^2 part: F({freedom[0]}, {freedom[1]}) = {f_value:.3g}, p = {p_value:.2g}")
    return lines


def law_lines(fit, rows):
    """Tables 3 and 5, each current by itself with what functions of the current leave, and Table 4, these functions."""
    names = "  ".join(f"{basis:>13}" for basis in fit.law.basis)
    lines = [f"{fit.law.name} at each current (J: sum of squared residuals in N^2)"]
    lines.append(f"  {'current_A':>9}  {names}          J  J with functions")
    for k, i in enumerate(rows.currents):
        at = rows.current == i
        columns, coefficients = fit.law.columns(rows.distance[at], fit.shape), fit.stage_one[k]
        of_functions = np.array([function.at(i) for function in fit.stage_two])
        alone, left = (np.sum((columns @ c - rows.force[at]) ** 2) for c in (coefficients, of_functions))
        values = "  ".join(f"{value:13.5e}" for value in coefficients)
        lines.append(f"  {i:9.4g}  {values}  {alone:9.3e}  {left:9.3e}")
    lines.append(f"{fit.law.name}: coefficients as functions of the current")
    for k, (basis, function) in enumerate(zip(fit.law.basis, fit.stage_two, strict=True)):
        tried = ", ".join(f"{name} {error:.2e}" for name, error in function.held_out.items())
        values = ", ".join(f"{value:.4e}" for value in function.values)
        left = np.sum((function.at(rows.currents) - fit.stage_one[:, k]) ** 2)
        lines.append(f"  {basis}: {function.name} ({values}); J_3 = {left:.4e}; held out: {tried}")
    return lines


def main():
    table = read_sweep_table(sys.argv[1])
    rows = rows_of_table(table, (table.manifest.get("actuator") or {}).get("mass_kg"), GRAVITY)
    lines = linearity_lines(rows)
    for name in ("F1e", "F2e"):
        lines += law_lines(fit_law(law_by_name(name), rows), rows)
    sys.stdout.write("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
