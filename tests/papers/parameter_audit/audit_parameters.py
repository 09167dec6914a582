"""Audits a published parameter set: every check that finds what it needs.

python tests/papers/chowdhury_audit.py data/chowdhury2016.toml
"""

from papers.parameter_audit.check_coil import check_coil, check_magnet
from papers.parameter_audit.check_filter import check_noise, check_pid, check_reduction, check_weights
from papers.parameter_audit.check_force import check_force
from papers.parameter_audit.check_hall import check_hall
from papers.parameter_audit.check_motion import check_equations, check_range
from papers.parameter_audit.parameters import ParameterSet

from femfit.audit.audit_model import AuditFinding


def audit_parameters(parameters: ParameterSet) -> list[AuditFinding]:
    """Everything that follows from the numbers themselves.

    Returns
    -------
    list of AuditFinding
        In the order of the file's sections.
    """
    p = parameters
    findings: list[AuditFinding] = []
    if p.magnet is not None:
        findings += check_magnet(p.magnet)
    if p.coil is not None:
        findings += check_coil(p.coil, p.force)
    if p.force is not None:
        findings += check_force(p.force)
    resistance = p.coil.resistance_ohm if p.coil is not None else None
    if p.supply is not None and p.force is not None and p.magnet is not None and resistance is not None:
        findings += check_range(p.supply, p.force, p.magnet, resistance)
    if p.equations is not None:
        findings += check_equations(p.equations, p.force, p.magnet, p.supply)
    if p.filter is not None:
        findings += [*check_weights(p.filter), *check_noise(p.filter, p.supply)]
        if p.force is not None and p.magnet is not None and p.supply is not None:
            findings += check_reduction(p.filter, p.force, p.magnet, p.supply)
    if p.hall is not None:
        findings += check_hall(p.hall, p.magnet, p.supply)
    if p.pid is not None:
        findings += check_pid(p.pid)
    return findings
