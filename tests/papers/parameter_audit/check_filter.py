"""A filter's weights, noise units and single precision; and the noise reduction that is said of it.

References
----------
S. J. Julier, The scaled unscented transformation, American Control Conference (2002) 4555: the weights and their sums.
"""

import math

import numpy as np
from papers.parameter_audit.check_motion import unstable_rate
from papers.parameter_audit.parameters import FilterSection, ForceSection, Magnet, PidSection, SupplySection

from femfit.audit.audit_model import AuditFinding

_EPSILON = 2.0**-24
"""Rounding of single precision, IEEE 754."""

_LOST = 1e-3
"""Part of every sigma point's mean that rounding of the centre weight may cost."""

_SUM = 1e-3
_REACHABLE = 1.1


def check_weights(section: FilterSection) -> list[AuditFinding]:
    """Sigma-point weights: their exact values and sums, the printed digits, and single precision."""
    n, alpha = section.states, section.alpha
    spread = alpha**2 * (n + section.kappa)
    centre, other = 1.0 - n / spread, 0.5 / spread
    more = 1.0 - alpha**2 + section.beta
    exact = {"mean_weights": (1.0, centre), "covariance_weights": (1.0 + more, centre + more)}
    findings = []
    for name, (expected, first) in exact.items():
        printed = getattr(section, name)
        if not printed:
            continue
        total = float(np.sum(printed))
        wrong = abs(total - expected) > _SUM * max(1.0, abs(expected))
        text = f"the printed digits sum to {total:.6g} and should to {expected:.6g}"
        text += f"; exactly W_0 = {first:.0f} and W_i = {other:.2f}." if wrong else "."
        findings.append(
            AuditFinding(name, "wrong" if wrong else "holds", name.replace("_", " "), text, total, expected)
        )
    lost = abs(centre) * _EPSILON
    if lost > _LOST:
        severity = "wrong" if section.single_precision else "note"
        text = (
            f"alpha = {alpha:g} gives a centre weight of {centre:.3g}: single precision rounds {100 * lost:.2g} % of "
            "every mean away and loses the covariance; alpha = 1 in difference form is safe."
        )
    else:
        severity, text = "holds", f"the centre weight {centre:.3g} is safe in single precision."
    return [*findings, AuditFinding("single_precision", severity, "alpha", text, alpha, lost)]  # type: ignore[arg-type]


def check_noise(section: FilterSection, supply: SupplySection | None) -> list[AuditFinding]:
    """Whether the noise covariances have a unit, and what they would mean.

    Returns
    -------
    list of AuditFinding
        One, where a measurement noise is given.
    """
    if section.measurement_noise is None:
        return []
    root = math.sqrt(section.measurement_noise)
    if section.noise_unit:
        text = f"R = {section.measurement_noise:g} {section.noise_unit} is a standard deviation of {root:.3g}."
        return [AuditFinding("noise_unit", "holds", "Q and R", text, section.measurement_noise, root)]
    text = f"no unit: R = {section.measurement_noise:g} in m2 is a standard deviation of {root:.2g} m"
    if supply is not None:
        text += f", {root / (1e-3 * (supply.held_max_mm - supply.held_min_mm)):.2g} times the whole range"
    text += f"; in mm2 it is {root:.2g} mm."
    return [AuditFinding("noise_unit", "wrong", "Q and R", text, section.measurement_noise, root)]


def check_reduction(
    section: FilterSection, force: ForceSection, magnet: Magnet, supply: SupplySection
) -> list[AuditFinding]:
    """Whether a causal filter of the unstable body can reduce white noise as much as is said: 1/sqrt(2 lambda t_s).

    Parameters
    ----------
    section : FilterSection
        With rms values before and after.
    force, magnet, supply : ForceSection, Magnet, SupplySection
        That give the unstable pole lambda over the range.
    """
    if not section.direct_rms_m or len(section.direct_rms_m) != len(section.filtered_rms_m):
        return []
    ratios = [a / b for a, b in zip(section.direct_rms_m, section.filtered_rms_m, strict=True)]
    ends = (1e-3 * supply.held_min_mm, 1e-3 * supply.held_max_mm)
    rates = [unstable_rate(force, magnet, d) for d in ends]
    if min(rates) <= 0.0:
        return []
    bounds = sorted(1.0 / math.sqrt(2.0 * rate * section.sample_time_s) for rate in rates)
    wrong = max(ratios) > _REACHABLE * bounds[-1]
    said = " and ".join(f"{ratio:.3g}" for ratio in ratios)
    text = (
        f"{said} times less noise is said; with white noise no causal filter of this unstable body passes "
        f"1/sqrt(2 lambda t_s) = {bounds[0]:.2g} to {bounds[1]:.2g}."
    )
    return [
        AuditFinding("noise_reduction", "wrong" if wrong else "holds", "noise reduction", text, max(ratios), bounds[-1])
    ]


def check_pid(section: PidSection) -> list[AuditFinding]:
    """Poles and zeros of a printed difference equation."""
    poles = np.sort(np.abs(np.roots([1.0, *(-p for p in section.past)])))[::-1]
    zeros = np.sort(np.abs(np.roots(section.error)))[::-1]
    outside = [float(z) for z in zeros if z > 1.0 + 1e-3]
    text = f"its poles have the magnitudes {', '.join(f'{p:.4g}' for p in poles)}, its zeros "
    text += f"{', '.join(f'{z:.4g}' for z in zeros)}"
    if not outside:
        return [AuditFinding("pid", "holds", "controller", text + ".")]
    text += (
        f": a zero at {outside[0]:.4g}, outside of the unit circle, works against the integrator: with it the static "
    )
    gain = float(np.sum(section.error))
    text += f"part acts {'with' if gain * section.error[0] > 0.0 else 'against'} the sign of the fast part."
    return [AuditFinding("pid", "wrong", "controller", text, outside[0], 1.0)]
