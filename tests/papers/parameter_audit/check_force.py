"""Whether a fitted force law agrees with the numbers that it was fitted to, and with what is said of it."""

import numpy as np
from papers.parameter_audit.law import force
from papers.parameter_audit.parameters import ForceSection, StageOneRow
from scipy import stats

from femfit.audit.audit_model import AuditFinding
from femfit.core.arrays import FloatArray

_MM = 1e-3
_ROUNDING = 2e-3
"""Relative difference that printing four digits and fitting rounded numbers can make."""

_J3_ROUNDING = 0.1
"""The same of a sum of squares of small differences."""

_LEVEL = 0.05
_MISPRINT = 5.0
"""Factor to what the neighbours of a row give from which it is a misprint."""


def check_force(section: ForceSection) -> list[AuditFinding]:
    """Every check of a force law."""
    findings = [*_bounds(section), *_again(section), *_differences(section)]
    if len(section.rows) > 3:
        findings += [*_second_stage(section), *_linearity(section), *_residuals(section), *_misprints(section.rows)]
    return findings


def _columns(rows: list[StageOneRow]) -> tuple[FloatArray, FloatArray, FloatArray]:
    return tuple(np.array([getattr(row, name) for row in rows]) for name in ("current_A", "a", "b"))  # type: ignore[return-value]


def _agrees(stated: float, value: float, tolerance: float) -> bool:
    return abs(stated - value) <= tolerance * abs(value)


def _second_stage(section: ForceSection) -> list[AuditFinding]:
    """The printed mean of a, slope of b through the origin and its sum of squares, from the rows."""
    i, a, b = _columns(section.rows)
    slope = float(i @ b / (i @ i))
    values = (
        ("mean_a", "mean of a", section.mean_a, float(a.mean()), _ROUNDING),
        ("slope_b", "slope of b over the current", section.slope_b, slope, _ROUNDING),
        ("J3", "J3", section.J3, float(np.sum((b - slope * i) ** 2)), _J3_ROUNDING),
    )
    return [
        AuditFinding(
            code,
            "holds" if _agrees(stated, value, tolerance) else "wrong",
            about,
            f"the rows give {value:.4g}; {stated:.5g} is printed.",
            stated,
            value,
        )
        for code, about, stated, value, tolerance in values
        if stated is not None
    ]


def _linearity(section: ForceSection) -> list[AuditFinding]:
    """F test of a term in i^2 beside the line through the origin that b is said to be."""
    i, _, b = _columns(section.rows)
    line, curve = i[:, None], np.column_stack([i, i**2])
    left = [float(np.sum((b - x @ np.linalg.lstsq(x, b, rcond=None)[0]) ** 2)) for x in (line, curve)]
    degrees = len(b) - 2
    ratio = (left[0] - left[1]) / (left[1] / degrees)
    p = float(stats.f.sf(ratio, 1, degrees))
    curved = p < _LEVEL
    severity = ("wrong" if section.says_linear_in_current else "note") if curved else "holds"
    text = f"a term in i^2 beside the line for b has F = {ratio:.3g}, p = {p:.2g}: " + (
        "b is not linear in the current." if curved else "b is linear in the current as far as the rows tell."
    )
    return [AuditFinding("linear_in_current", severity, "linearity in the current", text, None, p)]  # type: ignore[arg-type]


def _residuals(section: ForceSection) -> list[AuditFinding]:
    """What the sums of squares mean as a force, and whether they know of the current."""
    sums = np.array([row.J1 for row in section.rows])
    rms = float(np.sqrt(sums.mean() / section.points))
    spread = float(np.ptp(sums) / sums.mean())
    middle = 0.5 * (section.distance_min_mm + section.distance_max_mm) * _MM
    share = rms / abs(float(force(section.terms, middle, 0.0)))
    text = (
        f"J1 = {sums.mean():.3g} N2 over {section.points} points is {1e3 * rms:.3g} mN rms, {100 * share:.2g} % of the "
        f"force without current at {1e3 * middle:g} mm"
    )
    same = spread < 0.05
    text += (
        f"; it differs by {100 * spread:.2g} % between currents, so the misfit is in the part without current."
        if same
        else "."
    )
    return [AuditFinding("residual_rms", "note", "J1", text, float(sums.mean()), rms)]


def _misprints(rows: list[StageOneRow]) -> list[AuditFinding]:
    """Values that their neighbours contradict by a factor."""
    findings = []
    for name in ("a", "b", "J1", "c"):
        values = [getattr(row, name) for row in rows]
        for k in range(1, len(rows) - 1):
            triple = values[k - 1 : k + 2]
            if any(v is None or v <= 0.0 for v in triple):
                continue
            between = float(np.sqrt(triple[0] * triple[2]))
            if max(triple[1] / between, between / triple[1]) > _MISPRINT and max(
                triple[0], triple[2]
            ) < _MISPRINT**2 * min(triple[0], triple[2]):
                text = f"{name} = {triple[1]:.4g} stands between {triple[0]:.4g} and {triple[2]:.4g}: a misprint."
                about = f"row {rows[k].current_A:g} A"
                findings.append(AuditFinding("misprint", "wrong", about, text, triple[1], between))
    return findings


def _bounds(section: ForceSection) -> list[AuditFinding]:
    """Bounds that exclude the printed solution, or every solution."""
    if section.upper_bound is None:
        return []
    low, high = section.lower_bound or 0.0, section.upper_bound
    findings = []
    values = [value for row in section.rows for value in (row.a, row.b)] or [t.value for t in section.terms]
    outside = [v for v in values if not low <= v <= high]
    if outside:
        text = f"the bounds {low:g} to {high:g} exclude {max(outside):.4g}, which is printed as the solution."
        findings.append(AuditFinding("bounds", "wrong", "bounds of the fit", text, high, max(outside)))
    if section.bounds_hold_for_slacks and section.rows:
        rms = float(np.sqrt(np.mean([row.J1 for row in section.rows]) / section.points))
        if rms > high:
            text = (
                f"bounds on the slacks too would hold every point within {high:g} N; the printed fit misses by "
                f"{rms:.3g} N rms: the problem is infeasible as printed."
            )
            findings.append(AuditFinding("slack_bounds", "wrong", "bounds of the fit", text, high, rms))
    return findings


def _again(section: ForceSection) -> list[AuditFinding]:
    """The same law printed twice with different numbers."""
    findings = []
    first = {(t.distance_power, t.current_power): t.value for t in section.terms}
    for term in section.terms_again:
        stated = first.get((term.distance_power, term.current_power))
        if stated is not None and not _agrees(term.value, stated, _ROUNDING):
            power = f"d^{term.distance_power} i^{term.current_power}"
            text = f"the coefficient of {power} is {term.value:.4g} there and {stated:.4g} in the law."
            findings.append(
                AuditFinding("law_twice", "wrong", section.terms_again_where or "law", text, term.value, stated)
            )
    return findings


def _differences(section: ForceSection) -> list[AuditFinding]:
    """Mean and standard deviation over the distances of what a step of the current adds to the force."""
    if section.difference_step_A is None:
        return []
    d = np.linspace(section.distance_min_mm, section.distance_max_mm, section.points) * _MM
    step = force(section.terms, d, section.difference_step_A) - force(section.terms, d, 0.0)
    findings = []
    values = (
        ("difference_mean", "mean", section.difference_mean_N, float(step.mean())),
        ("difference_sd", "standard deviation", section.difference_sd_N, float(step.std(ddof=1))),
    )
    for code, about, stated, value in values:
        if stated is None:
            continue
        ratio = stated / value
        wrong = max(ratio, 1.0 / ratio) > 1.5
        unit = ", a thousand times less: mN is meant" if 500.0 < ratio < 2000.0 else ""
        text = (
            f"the law gives {value:.3g} N for a step of {section.difference_step_A:g} A; {stated:.4g} is printed{unit}."
        )
        findings.append(
            AuditFinding(code, "wrong" if wrong else "note", f"{about} of the differences", text, stated, value)
        )
    return findings
