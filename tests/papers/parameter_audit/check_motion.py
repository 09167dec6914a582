"""Printed state equations: dimensions and signs; and the range that the supply can hold."""

import numpy as np
from papers.parameter_audit.law import current_slope, force, holding_current
from papers.parameter_audit.parameters import EquationSection, ForceSection, Magnet, SupplySection

from femfit.audit.audit_model import AuditFinding
from femfit.core.constants import GRAVITY

_MM = 1e-3
_GRAVITY_SHARE = 2e-3
"""Gravity on earth at sea level is within 0.27 % of the standard value (equator to pole)."""

_SAME = 1e-3
_GRID_MM = 0.01


def check_equations(
    equations: EquationSection, force_section: ForceSection | None, magnet: Magnet | None, supply: SupplySection | None
) -> list[AuditFinding]:
    """Dimensions and signs of the state equations.

    Parameters
    ----------
    force_section : ForceSection or None
        The law that they should contain.
    supply : SupplySection or None
        Whose range says where the back-EMF is told.
    """
    findings = _gravity(equations.gravity_m_s2)
    if force_section is not None and magnet is not None:
        findings += _acceleration(equations, force_section, 1e-3 * magnet.mass_g)
    if not equations.has_back_emf and force_section is not None:
        at = supply.held_min_mm if supply is not None else force_section.distance_min_mm
        slope = current_slope(force_section.terms, at * _MM, 0.0)
        text = f"it has no back-EMF; by reciprocity that is k_m = dF/di = {slope:.3g} V s/m at {at:g} mm."
        findings.append(AuditFinding("back_emf", "wrong", "current equation", text, 0.0, slope))
    if equations.current_per_A >= 0.0 or equations.current_per_V <= 0.0:
        text = "di/dt must fall with the current and rise with the voltage: -R/L and 1/L."
        findings.append(AuditFinding("current_signs", "wrong", "current equation", text))
    return findings


def _gravity(values: list[float]) -> list[AuditFinding]:
    worst = max(values, key=lambda g: abs(abs(g) - GRAVITY))
    wrong = abs(abs(worst) / GRAVITY - 1.0) > _GRAVITY_SHARE
    listed = " and ".join(f"{g:g}" for g in values)
    text = f"{listed} m/s2 {'are' if len(values) > 1 else 'is'} printed; standard gravity is {GRAVITY:.4g}."
    return [AuditFinding("gravity", "wrong" if wrong else "holds", "gravity", text, worst, GRAVITY)]


def _acceleration(equations: EquationSection, section: ForceSection, mass: float) -> list[AuditFinding]:
    """Each term of d'' must be the law's, with the other sign and over the mass."""
    law = {(t.distance_power, t.current_power): t.value for t in section.terms}
    findings = []
    undivided, turned = [], []
    for term in equations.acceleration_terms:
        value = law.get((term.distance_power, term.current_power))
        name = f"d^{term.distance_power} i^{term.current_power}"
        if value is None:
            continue
        if abs(abs(term.value) - abs(value)) < _SAME * abs(value) and abs(mass - 1.0) > _SAME:
            undivided.append(name)
        if term.value * value > 0.0:
            turned.append(name)
    if undivided:
        text = (
            f"{' and '.join(undivided)} stand in an acceleration as in the force: the division by the mass of "
            f"{1e3 * mass:g} g is missing, a factor of {1.0 / mass:.3g}."
        )
        findings.append(AuditFinding("mass_missing", "wrong", "velocity equation", text, 1.0, 1.0 / mass))
    if turned:
        text = f"{' and '.join(turned)} pushes away, where the law attracts: the sign must be the other."
        findings.append(AuditFinding("force_sign", "wrong", "velocity equation", text))
    if not findings:
        findings.append(
            AuditFinding("acceleration", "holds", "velocity equation", "it is g minus the law over the mass.")
        )
    return findings


def check_range(supply: SupplySection, section: ForceSection, magnet: Magnet, resistance: float) -> list[AuditFinding]:
    """The distances at which the supply's clamp can hold the body, against the range that is said."""
    weight = 1e-3 * magnet.mass_g * GRAVITY
    d = np.arange(section.distance_min_mm, section.distance_max_mm + _GRID_MM, _GRID_MM)
    voltage = resistance * holding_current(section.terms, d * _MM, weight)
    held = d[(voltage >= supply.voltage_min_V) & (voltage <= supply.voltage_max_V)]
    clamp = f"{supply.voltage_min_V:g} to {supply.voltage_max_V:g} V"
    far = float(holding_current(section.terms, supply.held_max_mm * _MM, weight))
    needs = f"{supply.held_max_mm:g} mm would need {far:.2g} A and {far * resistance:.3g} V"
    about = "range that the supply can hold"
    if not len(held):
        text = f"with {clamp} no distance of the law's range can be held; {needs}."
        return [AuditFinding("held_range", "wrong", about, text)]
    wrong = held[0] > supply.held_min_mm + 0.5 or held[-1] < supply.held_max_mm - 0.5
    said = f"{supply.held_min_mm:g} to {supply.held_max_mm:g} mm"
    text = f"with {clamp} the law holds {held[0]:.1f} to {held[-1]:.1f} mm; {said} are said, and {needs}."
    return [AuditFinding("held_range", "wrong" if wrong else "holds", about, text, supply.held_max_mm, float(held[-1]))]


def unstable_rate(section: ForceSection, magnet: Magnet, distance_m: float) -> float:
    """The rate at which the held body leaves, sqrt(-F_d/m), in rad/s; 0 where it does not."""
    mass = 1e-3 * magnet.mass_g
    current = float(holding_current(section.terms, distance_m, mass * GRAVITY))
    step = 1e-4 * distance_m
    ahead, behind = (force(section.terms, distance_m + s, current) for s in (step, -step))
    return float(np.sqrt(max(-float(ahead - behind) / (2.0 * step) / mass, 0.0)))
