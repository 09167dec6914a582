"""Fit results as lines of text, for the command line and the report."""

from collections import Counter
from collections.abc import Sequence

import numpy as np

from femfit.fit.build import FitResult
from femfit.fit.coenergy import SHAPES, CoenergyFit
from femfit.fit.coenergy_basis import U_DEGREE
from femfit.fit.hall import HallFit
from femfit.fit.law_fit import LawFit
from femfit.fit.linearity import LinearityTest
from femfit.fit.ranking import TARGET, Ranking
from femfit.fit.result_data import stage_one_data
from femfit.fit.rows import FitRows
from femfit.model.actuator_model import ActuatorModel, Misfit
from femfit.model.magnetics import LawMagnetics

_LABELS_SHOWN = 4
"""Of active constraints; more are counted."""


def fit_lines(result: FitResult) -> list[str]:
    """Everything that ``femfit fit`` prints."""
    model = result.model
    lines = [*(f"note: {note}" for note in result.of_data), f"{model.name}: {len(result.rows.force)} rows"]
    if result.ranking is not None:
        lines += ranking_lines(result.ranking)
    if result.law is not None:
        lines += _law_lines(result.law, result.rows)
    elif result.coenergy is not None:
        lines += _coenergy_lines(result.coenergy)
    lines += [misfit_line(m) for m in result.misfits]
    lines.append(_derived_line(result))
    if isinstance(model.magnetics, LawMagnetics) and result.rows.flux_linkage is not None:
        lines.append(
            f"from the flux linkage: constant inductance {_si(model.magnetics.constant_inductance_H, 'H')}, "
            f"constant flux linkage {_si(model.magnetics.constant_flux_linkage_Wb, 'Wb')}"
        )
    if result.hall is not None:
        lines += _hall_lines(result.hall, model)
    if result.linearity is not None:
        lines += linearity_lines(result.linearity)
    return [*lines, *(f"note: {note}" for note in result.notes)]


def _derived_line(result: FitResult) -> str:
    d, i = result.rows.distance, result.rows.current
    state = result.model.magnetics.state(d, i)
    text = f"k_m = dF/di {state.motional_constant.min():.4g} to {state.motional_constant.max():.4g} N/A"
    if result.model.circuit is None and result.rows.flux_linkage is None:
        return f"{text}; inductance unknown (no flux linkage in the table)"
    return f"{text}; inductance {_si(state.inductance.min(), 'H', 5)} to {_si(state.inductance.max(), 'H', 5)}"


def ranking_lines(ranking: Ranking) -> list[str]:
    """The table of candidates."""
    lines = [
        f"candidates, errors in % of the {ranking.of} (held-out rows: blocks of distances, single currents):",
        (
            f"  {'law':23} {'held-out rms':>12} {'max':>7} {'of force':>9} {'all rows':>9} {'operations':>11} "
            f"{'parameters':>11} {'condition':>10}  on a bound"
        ),
    ]
    for c in ranking.candidates:
        if c.fit is None:
            lines.append(f"  {c.law.name:23} not fitted: {c.failure}")
            continue
        lines.append(
            f"  {c.law.name:23} {100 * c.held_out_rms:12.3f} {100 * c.held_out_max:7.2f} "
            f"{100 * c.held_out_of_force:7.2f} % {100 * c.rms:9.3f} {c.fit.operations:11d} {c.parameters:11d} "
            f"{c.fit.joint.condition_scaled:10.1e}  {len(c.fit.limits.active(c.fit.joint)) or '-'}"
        )
    best = ranking.recommended
    reason = "the cheapest within" if ranking.reached else "the best; none is within"
    operations = best.fit.operations if best.fit else 0
    if ranking.why_of:
        lines.append(f"errors are parts of the {ranking.of}, because {ranking.why_of}")
    lines.append(
        f"recommended: {best.law.name} ({operations} operations), {reason} {100 * TARGET:g} % of the {ranking.of}"
    )
    return lines


def _coenergy_lines(fit: CoenergyFit) -> list[str]:
    size = fit.basis.shape[0] * fit.basis.shape[1]
    return [
        f"co-energy: {size} coefficients, held-out error {100 * fit.held_out:.2g} %",
        (
            f"B-spline: {fit.basis.cells[0]} cells of degree {U_DEGREE} in d_0/d, {fit.basis.cells[1]} of degree "
            f"{fit.basis.current_degree} in the current"
        ),
        f"condition number {fit.qp.condition:.1e}, columns scaled {fit.qp.condition_scaled:.1e}",
        *(f"constraint: {SHAPES[name]}" for name in fit.constraints),
        f"active constraints: {_active(fit.active)}",
    ]


def _active(labels: Sequence[str]) -> str:
    if len(labels) <= _LABELS_SHOWN:
        return "; ".join(labels) or "none"
    counts = Counter(label.partition(" at ")[0] for label in labels)
    return "; ".join(f"{name} at {count} places" for name, count in counts.items())


def _hall_lines(hall: HallFit, model: ActuatorModel) -> list[str]:
    low, high = hall.coil_slope_T_per_A
    far, near = hall.magnet_field_T
    lines = [
        "Hall field, coil part CH and magnet part MH:",
        f"  CH {_si(low, 'T/A')} to {_si(high, 'T/A')}, MH {_si(far, 'T')} to {_si(near, 'T')}",
    ]
    if model.sensor is not None:
        volt = model.sensor.sensitivity_V_per_T
        lines.append(
            f"  at the sensor's output: CH {volt * low:.4g} to {volt * high:.4g} V/A, MH {volt * far:.4g} to "
            f"{volt * near:.4g} V above {model.sensor.quiescent_V:g} V"
        )
    lines.append(f"  misfit {_si(hall.rms_T, 'T', 3)} rms, {_si(hall.max_T, 'T', 3)} max")
    return lines


def _si(value: float, unit: str, digits: int = 4) -> str:
    """A number with an SI prefix, from micro to kilo: actuators pull from micronewtons to hundreds of kilonewtons."""
    sizes = ((1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "u"))
    scale, prefix = next((pair for pair in sizes if abs(value) >= pair[0]), sizes[-1] if value else (1.0, ""))
    return f"{value / scale:.{digits}g} {prefix}{unit}"


def misfit_line(misfit: Misfit) -> str:
    """One misfit in a sentence.

    Returns
    -------
    str
        With per cent of force and of weight.
    """
    weight = "" if misfit.force_rms_of_weight is None else f", {100 * misfit.force_rms_of_weight:.3g} % of the weight"
    flux = (
        "" if misfit.flux_linkage_rms_Wb is None else f"; flux linkage {_si(misfit.flux_linkage_rms_Wb, 'Wb', 3)} rms"
    )
    return (
        f"misfit against {misfit.against}: {_si(misfit.force_rms_N, 'N')} rms "
        f"({100 * misfit.force_rms_relative:.3g} % of force{weight}), {_si(misfit.force_max_N, 'N')} max{flux}"
    )


def _law_lines(fit: LawFit, rows: FitRows) -> list[str]:
    lines = [f"{fit.law.name}: {fit.law.formula}   ({fit.law.reference})"]
    lines += [
        f"  {name} = {value:.5g} (95 %: {fit.shape_interval[name][0]:.4g} .. {fit.shape_interval[name][1]:.4g})"
        for name, value in fit.shape.items()
    ]
    lines.append("stage one, at each current (J: sum of squared residuals; rms in % of force and of the weight):")
    columns = "  ".join(f"{basis:>13}" for basis in fit.law.basis)
    lines.append(f"  {'current_A':>9}  {columns}  {'J (N^2)':>9}  % force  % weight  J final law  on a bound")
    for entry in stage_one_data(fit, rows):
        values = "  ".join(f"{entry['coefficients'][basis]:13.5e}" for basis in fit.law.basis)
        weight = "-" if entry["rms_of_weight"] is None else f"{100 * entry['rms_of_weight']:.3g}"
        active = ", ".join(f"{basis} {side}" for basis, side in entry["active"].items())
        lines.append(
            f"  {entry['current_A']:9.4g}  {values}  {entry['J_N2']:9.3e}  {100 * entry['rms_of_force']:7.3g}  "
            f"{weight:>8}  {entry['J_final_N2']:11.3e}  {active or '-'}"
        )
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
    difference = fit.force(fit.two_stage - fit.joint.x, rows.distance, rows.current)
    rms = float(np.sqrt(np.mean(difference**2)))
    scale, name = rows.error_scale
    part = f", {100 * rms / scale:.2g} % of the {name}"
    lines.append(f"two-stage minus one-stage force: {_si(rms, 'N', 3)} rms{part}")
    lines.append(f"one-stage fit, active bounds: {'; '.join(fit.limits.active(fit.joint)) or 'none'}")
    lines.append(f"condition number {fit.joint.condition:.2e}, columns scaled {fit.joint.condition_scaled:.2e}")
    return lines


def _term(basis: str, power: int) -> str:
    return basis if power == 0 else f"{basis} i" if power == 1 else f"{basis} i^{power}"


def linearity_lines(test: LinearityTest) -> list[str]:
    """Table 2 of the paper on these data."""
    lines = ["linearity in the current (differences of adjacent currents, over the distances):"]
    for pair, mean, sd in zip(test.pairs_A, test.mean_N, test.sd_N, strict=True):
        lines.append(f"  {pair[0]:.4g} to {pair[1]:.4g} A: mean {_si(mean, 'N', 5)}, sd {_si(sd, 'N', 5)}")
    lines.append(
        f"  i^2 part: {100 * test.quadratic_share:.2g} % of the dependence on current, at most "
        f"{100 * test.quadratic_of_force:.2g} % of the largest force"
    )
    if test.f_value is not None:
        freedom = "F({}, {})".format(*test.degrees_of_freedom)
        value = f"{freedom} = {test.f_value:.3g}, p = {test.p_value:.2g}"
        lines.append(f"  test of the i^2 part against what a parabola leaves: {value}")
    elif test.degrees_of_freedom[1]:
        lines.append("  a parabola in the current leaves nothing but rounding: no noise to test the i^2 part against")
    return lines
