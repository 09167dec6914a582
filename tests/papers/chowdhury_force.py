"""Tables 2 to 5 of the levitation paper on a sweep table.

    python tests/papers/chowdhury_force.py runs/emaws-rig

prints whether the force is linear in the current (Table 2), F1e and F2e at each current (Tables 3 and 5, Figures 8 and
9) and their coefficients as functions of the current (Table 4, Figure 10).

References
----------
A. Chowdhury and A. Sarjas, Sensors 16 (2016) 1504, eqs. (4) to (13).
"""

import argparse
import sys
from dataclasses import dataclass

import numpy as np
from scipy.stats import f as fisher

from femfit.core.numerics import FloatArray
from femfit.fit.law_fit import LawFit, fit_law
from femfit.fit.rows import FitRows, rows_of_table
from femfit.laws.catalogue import law_by_name
from femfit.tables.sweep_table import read_sweep_table

GRAVITY = 9.80665

# Relative residuals below this are rounding of stored numbers, not noise.
_ROUNDING = 1e-10


@dataclass(frozen=True, eq=False)
class LinearityTest:
    """Differences of the force at adjacent currents (p, 2), their mean and deviation over the distances, the i^2 part.

    Its share of the dependence on the current says whether it matters; its F test over all distances, whether it is
    there: None where a parabola leaves nothing but rounding.
    """

    pairs_A: FloatArray
    mean_N: FloatArray
    sd_N: FloatArray
    quadratic_share: float
    f_value: float | None
    p_value: float | None
    degrees_of_freedom: tuple[int, int]


def linearity_test(rows: FitRows) -> LinearityTest | None:
    """Whether the force is linear in the current; None with fewer than three currents, or where the grid has holes."""
    currents, distances = rows.currents, rows.distances
    if len(currents) < 3 or len(rows.force) != len(currents) * len(distances):
        return None
    order = np.lexsort((rows.distance, rows.current))
    force = rows.force[order].reshape(len(currents), len(distances))
    differences = np.diff(force, axis=0)
    quadratic, f_value, p_value, freedom = beside_line(currents, force)
    change = force - force.mean(axis=0)
    return LinearityTest(
        pairs_A=np.stack([currents[:-1], currents[1:]], axis=1),
        mean_N=differences.mean(axis=1),
        sd_N=differences.std(axis=1, ddof=1),
        quadratic_share=float(np.sqrt(np.mean(quadratic**2) / np.mean(change**2))),
        f_value=f_value,
        p_value=p_value,
        degrees_of_freedom=freedom,
    )


def quadratic_f_test(current: FloatArray, values: FloatArray, through_origin: bool = False) -> tuple[float, float]:
    """F and p of an i^2 part beside a line, or beside the paper's f_b through the origin; more than three currents."""
    _, f_value, p_value, _ = beside_line(current, values[:, None], through_origin)
    return f_value, p_value


def beside_line(currents, values, through_origin=False):
    """The i^2 part beside the best line of each column (m, n), its pooled F, p and degrees of freedom."""
    powers = np.arange(1 if through_origin else 0, 3)
    matrix = currents[:, None] ** powers.astype(float)
    q_factor = np.linalg.qr(matrix / np.linalg.norm(matrix, axis=0))[0]
    along = q_factor.T @ values
    part = np.outer(q_factor[:, -1], along[-1])
    columns = values.shape[1]
    freedom = (columns, columns * (len(currents) - len(powers)))
    residual = float(np.sum((values - q_factor @ along) ** 2))
    if not freedom[1] or residual <= _ROUNDING**2 * float(np.sum(values**2)):
        return part, None, None, freedom
    f_value = float(np.sum(along[-1] ** 2) / freedom[0] / residual * freedom[1])
    return part, f_value, float(fisher.sf(f_value, *freedom)), freedom


def law_lines(fit: LawFit, rows: FitRows) -> list[str]:
    """Tables 3 and 5, each current by itself with what functions of the current leave, and Table 4, these functions."""
    names = "  ".join(f"{basis:>13}" for basis in fit.law.basis)
    lines = [f"{fit.law.name} at each current (J: sum of squared residuals in N^2)"]
    lines.append(f"  {'current_A':>9}  {names}          J  J with functions")
    for k, i in enumerate(fit.stage_one.currents):
        at = rows.current == i
        left = fit.force(fit.two_stage, rows.distance[at], rows.current[at]) - rows.force[at]
        values = "  ".join(f"{value:13.5e}" for value in fit.stage_one.coefficients[k])
        lines.append(f"  {i:9.4g}  {values}  {fit.stage_one.residual_sums[k]:9.3e}  {np.sum(left**2):9.3e}")
    lines.append(f"{fit.law.name}: coefficients as functions of the current")
    for basis, function in zip(fit.law.basis, fit.stage_two, strict=True):
        tried = ", ".join(f"{name} {error:.2e}" for name, error in function.held_out.items())
        values = ", ".join(f"{value:.4e}" for value in function.values)
        lines.append(f"  {basis}: {function.name} ({values}); J_3 = {function.residual_sum:.4e}; held out: {tried}")
    return lines


def linearity_lines(test: LinearityTest) -> list[str]:
    """Table 2 with its statistics right."""
    lines = ["differences of the force at adjacent currents, over the distances"]
    for pair, mean, sd in zip(test.pairs_A, test.mean_N, test.sd_N, strict=True):
        lines.append(f"  {pair[0]:.4g} to {pair[1]:.4g} A: mean {1e3 * mean:.5g} mN, sd {1e3 * sd:.5g} mN")
    lines.append(f"  i^2 part: {100 * test.quadratic_share:.2g} % of the dependence on current")
    if test.f_value is not None:
        freedom = "F({}, {})".format(*test.degrees_of_freedom)
        lines.append(f"  test of the i^2 part: {freedom} = {test.f_value:.3g}, p = {test.p_value:.2g}")
    return lines


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("table")
    table = read_sweep_table(parser.parse_args().table)
    rows = rows_of_table(table, (table.manifest.get("actuator") or {}).get("mass_kg"), GRAVITY)
    test = linearity_test(rows)
    lines = linearity_lines(test) if test else ["no full grid of three currents: linearity not tested"]
    for name in ("F1e", "F2e"):
        fit = fit_law(law_by_name(name), rows)
        lines += law_lines(fit, rows)
    sys.stdout.write("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
