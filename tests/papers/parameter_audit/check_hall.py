"""A printed conversion from Hall output to distance: the sign of its constant, and the magnet's own field.

References
----------
E. P. Furlani, Permanent Magnet and Electromechanical Devices (Academic Press, 2001), section 3.11: the field on the
axis of a cylinder.
"""

import numpy as np
from papers.parameter_audit.parameters import HallSection, Magnet, SupplySection

from femfit.audit.audit_model import AuditFinding
from femfit.core.arrays import FloatArray

_FIELD_SHARE = 0.1


def check_hall(section: HallSection, magnet: Magnet | None, supply: SupplySection | None) -> list[AuditFinding]:
    """Whether the conversion gives distances, and those of the magnet.

    Parameters
    ----------
    magnet : Magnet or None
        With its remanence: the field that the element sees.
    """
    as_printed, subtracted = (
        float(np.polyval(section.polynomial_mm, section.quiescent_V + sign * section.constant_V))
        for sign in (1.0, -1.0)
    )
    sensible = 0.0 < as_printed < 1e3
    text = (
        f"without any field the printed constant of {section.constant_V:+g} V gives a distance of {as_printed:.3g} mm"
    )
    text += "." if sensible else f"; subtracted it gives {subtracted:.3g} mm, the far end: it must be subtracted."
    about = "Hall output to distance"
    severity = "holds" if sensible else "wrong"
    findings = [AuditFinding("hall_constant", severity, about, text, as_printed, subtracted)]  # type: ignore[arg-type]
    if None not in (magnet, supply, section.sensitivity_V_per_T) and magnet is not None and supply is not None:
        findings += _magnets_field(section, magnet, supply)
    return findings


def _magnets_field(section: HallSection, magnet: Magnet, supply: SupplySection) -> list[AuditFinding]:
    if magnet.remanence_T is None or section.sensitivity_V_per_T is None:
        return []
    d = np.linspace(supply.held_min_mm, supply.held_max_mm, 17)
    volts = section.sensitivity_V_per_T * axis_field(magnet, d)
    given = np.polyval(section.polynomial_mm, volts)
    off = float(np.max(np.abs(given / d - 1.0)))
    text = (
        f"the field of a {magnet.diameter_mm:g} x {magnet.height_mm:g} mm magnet of {magnet.remanence_T:g} T at "
        f"{section.sensitivity_V_per_T:g} V/T gives the distance within {100 * off:.2g} %."
    )
    severity = "note" if off > _FIELD_SHARE else "holds"
    return [AuditFinding("hall_field", severity, "Hall output to distance", text, None, off)]  # type: ignore[arg-type]


def axis_field(magnet: Magnet, distance_mm: FloatArray) -> FloatArray:
    """B on the axis of a cylinder magnet, Br/2 ((d + h)/sqrt((d + h)^2 + R^2) - d/sqrt(d^2 + R^2))."""
    d, far, radius = distance_mm, distance_mm + magnet.height_mm, 0.5 * magnet.diameter_mm
    remanence = magnet.remanence_T or 0.0
    return np.asarray(0.5 * remanence * (far / np.hypot(far, radius) - d / np.hypot(d, radius)))
