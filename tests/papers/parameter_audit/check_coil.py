"""Whether resistance, inductance and force belong to one coil, and the mass to the magnet.

Resistance grows with the turns N, force per ampere with N, inductance with N^2: each tells its own number of turns.
"""

import math

from papers.parameter_audit.law import current_slope
from papers.parameter_audit.parameters import CoilSection, ForceSection, Magnet

from femfit.audit.audit_model import AuditFinding
from femfit.device.winding import smallest_winding_area, wire_resistance

_MM = 1e-3
_RESISTANCE_SHARE = 0.15
"""Copper at 20 degC against a printed resistance: temperature, leads and rounding of the wire stay below."""

_TURNS_SHARE = 0.15
_MASS_SHARE = 0.05


def check_magnet(magnet: Magnet) -> list[AuditFinding]:
    """The magnet's mass against its volume times density."""
    volume = math.pi / 4.0 * (magnet.diameter_mm * _MM) ** 2 * magnet.height_mm * _MM
    grams = 1e3 * volume * magnet.density_kg_m3
    off = abs(magnet.mass_g / grams - 1.0) > _MASS_SHARE
    sentence = (
        f"{magnet.diameter_mm:g} x {magnet.height_mm:g} mm at {magnet.density_kg_m3:g} kg/m3 weigh {grams:.3g} g; "
        f"{magnet.mass_g:g} g are given" + (", so that is the magnet with its body, or another magnet." if off else ".")
    )
    return [AuditFinding("magnet_mass", "note" if off else "holds", "mass", sentence, magnet.mass_g, grams)]


def check_coil(coil: CoilSection, force: ForceSection | None) -> list[AuditFinding]:
    """The winding's wire, room, and the turns that each of its constants implies.

    Parameters
    ----------
    force : ForceSection or None
        Whose slope in the current tells turns too.
    """
    implied: dict[str, float] = {}
    findings = []
    if coil.turns is not None:
        implied["as printed"] = coil.turns
    one_turn = _resistance_of_one_turn(coil)
    if one_turn is not None and coil.resistance_ohm is not None:
        implied["by its resistance"] = coil.resistance_ohm / one_turn
        if coil.turns is not None:
            findings.append(_resistance(coil.turns * one_turn, coil))
    if coil.inductance_H is not None and coil.inductance_per_turn2_H is not None:
        implied["by its inductance"] = math.sqrt(coil.inductance_H / coil.inductance_per_turn2_H)
    if force is not None and coil.force_per_ampere_turn_N is not None and coil.force_distance_mm is not None:
        slope = current_slope(force.terms, coil.force_distance_mm * _MM, 0.0)
        implied["by its force per ampere"] = slope / coil.force_per_ampere_turn_N
    if len(implied) > 1:
        findings.append(_one_coil(implied))
    return findings + _room(coil)


def _resistance_of_one_turn(coil: CoilSection) -> float | None:
    if coil.inner_diameter_mm is None or coil.outer_diameter_mm is None or coil.wire_diameter_mm is None:
        return None
    mean_radius = 0.25 * (coil.inner_diameter_mm + coil.outer_diameter_mm) * _MM
    return wire_resistance(1.0, mean_radius, coil.wire_diameter_mm * _MM)


def _resistance(expected: float, coil: CoilSection) -> AuditFinding:
    stated = coil.resistance_ohm or 0.0
    wrong = abs(stated / expected - 1.0) > _RESISTANCE_SHARE
    text = (
        f"{coil.turns:g} turns of {coil.wire_diameter_mm:g} mm copper have {expected:.3g} ohm; {stated:.3g} are given."
    )
    return AuditFinding("coil_resistance", "wrong" if wrong else "holds", "resistance", text, stated, expected)


def _one_coil(implied: dict[str, float]) -> AuditFinding:
    low, high = min(implied.values()), max(implied.values())
    wrong = high / low - 1.0 > _TURNS_SHARE
    listed = ", ".join(f"{turns:.3g} {how}" for how, turns in implied.items())
    verdict = "one coil has one number" if wrong else "one coil has them all"
    return AuditFinding("one_coil", "wrong" if wrong else "holds", "turns", f"{listed}: {verdict}.", low, high)


def _room(coil: CoilSection) -> list[AuditFinding]:
    """Whether the turns fit into the winding's section."""
    sizes = (coil.turns, coil.wire_diameter_mm, coil.inner_diameter_mm, coil.outer_diameter_mm, coil.height_mm)
    if any(size is None for size in sizes):
        return []
    turns, wire, inner, outer, height = (float(size or 0.0) for size in sizes)
    room, needed = 0.5 * (outer - inner) * height, smallest_winding_area(turns, wire)
    text = f"{turns:g} turns of {wire:g} mm need at least {needed:.3g} mm2 of the section's {room:.3g}."
    return [AuditFinding("coil_room", "wrong" if needed > room else "holds", "winding", text, needed, room)]
