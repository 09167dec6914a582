"""Fit results as lines of text, for the command line and the report."""

import numpy as np

from femfit.fit.build import FitResult
from femfit.fit.law_fit import LawFit
from femfit.fit.linearity import LinearityTest
from femfit.model.actuator_model import Misfit


def fit_lines(result: FitResult) -> list[str]:
    """Everything that ``femfit fit`` prints.

    Parameters
    ----------
    result : FitResult
        Any.

    Returns
    -------
    list of str
        Lines.
    """
    lines = [f"{result.model.name}: {len(result.rows.force)} rows"]
    if result.law is not None:
        lines += _law_lines(result.law)
    elif result.coenergy is not None:
        fit = result.coenergy
        lines += [
            (
                f"co-energy: {np.prod(fit.basis.shape)} coefficients ({fit.basis.cells[0]} cells in d_0/d, degree 4; "
                f"{fit.basis.cells[1]} in i, degree {fit.basis.current_degree}), held-out force error "
                f"{100 * fit.held_out:.2g} %, condition {fit.qp.condition:.1e}, scaled {fit.qp.condition_scaled:.1e}"
            ),
            f"shape constraints: {'; '.join(fit.constraints) or 'none'}; active: {'; '.join(fit.active) or 'none'}",
        ]
    lines += [misfit_line(m) for m in result.misfits]
    if result.hall is not None:
        hall = result.hall
        low, high = (1e3 * t for t in hall.coil_slope_T_per_A)
        lines.append(
            f"Hall field: coil part {low:.4g} to {high:.4g} mT/A, magnet part {1e3 * hall.magnet_field_T[0]:.4g} to "
            f"{1e3 * hall.magnet_field_T[1]:.4g} mT, "
            f"misfit {1e6 * hall.rms_T:.3g} uT rms, {1e6 * hall.max_T:.3g} uT max"
        )
    if result.linearity is not None:
        lines += linearity_lines(result.linearity)
    lines += [f"note: {note}" for note in result.notes]
    return lines


def misfit_line(misfit: Misfit) -> str:
    """One misfit in a sentence.

    Parameters
    ----------
    misfit : Misfit
        Any.

    Returns
    -------
    str
        With per cent of force and of weight.
    """
    weight = "" if misfit.force_rms_of_weight is None else f", {100 * misfit.force_rms_of_weight:.3g} % of the weight"
    flux = (
        "" if misfit.flux_linkage_rms_Wb is None else f"; flux linkage {1e6 * misfit.flux_linkage_rms_Wb:.3g} uWb rms"
    )
    return (
        f"misfit against {misfit.against}: {1e3 * misfit.force_rms_N:.4g} mN rms "
        f"({100 * misfit.force_rms_relative:.3g} % of force{weight}), {1e3 * misfit.force_max_N:.4g} mN max{flux}"
    )


def _law_lines(fit: LawFit) -> list[str]:
    lines = [f"{fit.law.name}: {fit.law.formula}   ({fit.law.reference})"]
    lines += [
        f"  {name} = {value:.5g} (95 %: {fit.shape_interval[name][0]:.4g} .. {fit.shape_interval[name][1]:.4g})"
        for name, value in fit.shape.items()
    ]
    lines.append("stage one, at each current:")
    lines.append("  current_A  " + "  ".join(f"{basis:>13}" for basis in fit.law.basis) + "  J (N^2)  on a bound")
    for i, c, j, s in zip(
        fit.stage_one.currents,
        fit.stage_one.coefficients,
        fit.stage_one.residual_sums,
        fit.stage_one.solutions,
        strict=True,
    ):
        active = ", ".join(f"{b} {side}" for b, side in zip(fit.law.basis, s.active, strict=True) if side)
        lines.append(f"  {i:9.4g}  " + "  ".join(f"{v:13.5e}" for v in c) + f"  {j:.3e}  {active or '-'}")
    lines.append("stage two, coefficient functions (held-out rms error of each tried):")
    for basis, function in zip(fit.law.basis, fit.stage_two, strict=True):
        tried = ", ".join(f"{name} {error:.2e}" for name, error in function.held_out.items())
        lines.append(f"  {basis}: {function.name}; J_3 = {function.residual_sum:.4e}; {tried}")
        lines += [f"    bound: {word}" for word in function.active]
    lines.append("coefficients (95 % intervals: block jackknife over distances; white residuals in brackets):")
    lines.append("  term                     two-stage       one-stage   95 % of the one-stage")
    for n, (basis, power) in enumerate(fit.terms):
        unit = fit.law.coefficient_units[fit.law.basis.index(basis)] + (f" A^-{power}" if power else "")
        block, white = fit.interval.block[n], fit.interval.white[n]
        lines.append(
            f"  {_term(basis, power):20} {fit.two_stage[n]:13.5e}   {fit.joint.x[n]:13.5e}   "
            f"{block[0]:.4e} .. {block[1]:.4e} ({white[0]:.4e} .. {white[1]:.4e}) {unit}"
        )
    lines.append(f"one-stage fit, active bounds: {'; '.join(fit.joint_active) or 'none'}")
    lines.append(f"condition number {fit.joint.condition:.2e}, columns scaled {fit.joint.condition_scaled:.2e}")
    return lines


def _term(basis: str, power: int) -> str:
    return basis if power == 0 else f"{basis} i" if power == 1 else f"{basis} i^{power}"


def linearity_lines(test: LinearityTest) -> list[str]:
    """Table 2 of the paper on these data.

    Parameters
    ----------
    test : LinearityTest
        Any.

    Returns
    -------
    list of str
        Lines.
    """
    lines = ["linearity in the current (differences of adjacent currents, over the distances):"]
    for pair, mean, sd in zip(test.pairs_A, test.mean_N, test.sd_N, strict=True):
        lines.append(f"  {pair[0]:.4g} to {pair[1]:.4g} A: mean {1e3 * mean:.5g} mN, sd {1e3 * sd:.5g} mN")
    lines.append(
        f"  i^2 part: {100 * test.quadratic_share:.2g} % of the dependence on current, at most "
        f"{100 * test.quadratic_of_force:.2g} % of the largest force"
    )
    if test.f_value is not None:
        freedom = "F({}, {})".format(*test.degrees_of_freedom)
        lines.append(f"  test of the i^2 part: {freedom} = {test.f_value:.3g}, p = {test.p_value:.2g}")
    return lines
