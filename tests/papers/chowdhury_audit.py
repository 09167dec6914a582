"""What a published parameter set says of itself: dimensions, signs, bounds, range, coil, filter, precision.

    python tests/papers/chowdhury_audit.py data/chowdhury2016.toml

Numbers stand in the file as they are printed, in SI but for lengths (mm) and masses (g) whose keys say so. Each check
recomputes one of them from the others.

References
----------
E. P. Furlani, Permanent Magnet and Electromechanical Devices (Academic Press, 2001), section 3.11: the field on the
axis of a cylinder. S. J. Julier, The scaled unscented transformation, American Control Conference (2002) 4555.
"""

import argparse
import sys
import tomllib
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from femfit.audit.audit_model import Audit, AuditFinding
from femfit.core.numerics import GRAVITY
from femfit.device.parts import smallest_winding_area, wire_resistance

sys.path.insert(0, str(Path(__file__).parents[1]))

from papers.chowdhury_force import quadratic_f_test

from support.exact import axis_field_of_cylinder

WORDS = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
MM = 1e-3
ROUNDING = 2e-3
"""Relative difference that printing four digits and fitting rounded numbers can make."""

J3_ROUNDING = 0.1
"""The same of a sum of squares of small differences."""

RESISTANCE_SHARE = 0.15
"""Copper at 20 degC against a printed resistance: temperature, leads and rounding of the wire stay below."""

TURNS_SHARE, MASS_SHARE, FIELD_SHARE = 0.15, 0.05, 0.1
LEVEL = 0.05
MISPRINT = 5.0
"""Factor to what the neighbours of a row give from which it is a misprint."""

SAME = 1e-3
GRAVITY_SHARE = 2e-3
"""Gravity on earth at sea level is within 0.27 % of the standard value (equator to pole)."""

EPSILON = 2.0**-24
"""Rounding of single precision, IEEE 754."""

LOST = 1e-3
"""Part of every sigma point's mean that rounding of the centre weight may cost."""

REACHABLE = 1.1
OPTIONAL = {"terms_again": (), "upper_bound": None, "bounds_hold_for_slacks": False, "J3": None,
            "difference_step_A": None, "sensitivity_V_per_T": None, "single_precision": False,
            "noise_unit": "", "density_kg_m3": 7500.0}  # fmt: skip


@dataclass(frozen=True)
class Claim(AuditFinding):
    """A conclusion on what a paper prints, with its own words."""

    text: str = ""

    @property
    def sentence(self):
        return self.text


def finding(code, wrong, about, stated=None, recomputed=None, words=None, **numbers):
    """A finding that is wrong or holds; a severity in place of the truth value is taken as it is."""
    severity = wrong if isinstance(wrong, str) else "wrong" if wrong else "holds"
    text = WORDS[words or code].format(stated=stated, recomputed=recomputed, **numbers)
    return Claim(code, severity, about, stated, recomputed, text=text)


def listed(values, form="{:.3g}", last=" and "):
    return last.join(form.format(value) for value in values)


def powers(terms):
    """The coefficient of each d^p i^q."""
    return {(term["distance_power"], term.get("current_power", 0)): term["value"] for term in terms}


def force(terms, d, i):
    """F = sum c d^p i^q in N."""
    return sum(c * d**p * i**q for (p, q), c in powers(terms).items()) + 0.0 * np.asarray(d)


def current_slope(terms, d):
    """dF/di without current in N/A, which is the back-EMF per velocity too, in V s/m."""
    return float(sum(c * d**p for (p, q), c in powers(terms).items() if q == 1))


def holding_current(terms, d, weight):
    """Current at which a law that is linear in it carries a weight."""
    passive = force(terms, d, 0.0)
    return (weight - passive) / (force(terms, d, 1.0) - passive)


def unstable_rate(p, d):
    """The rate at which the held body leaves, sqrt(-F_d/m), in rad/s; 0 where it does not."""
    mass = MM * p.magnet.mass_g
    current, step = holding_current(p.force.terms, d, mass * GRAVITY), 1e-4 * d
    slope = (force(p.force.terms, d + step, current) - force(p.force.terms, d - step, current)) / (2.0 * step)
    return float(np.sqrt(max(-float(slope) / mass, 0.0)))


def check_magnet(p):
    """The magnet's mass against its volume times density."""
    p = p.magnet
    grams = 1e3 * np.pi / 4.0 * (p.diameter_mm * MM) ** 2 * p.height_mm * MM * p.density_kg_m3
    off = abs(p.mass_g / grams - 1.0) > MASS_SHARE
    words = "magnet_with_body" if off else "magnet_mass"
    yield finding("magnet_mass", "note" if off else "holds", "mass", p.mass_g, grams, words, p=p)


def check_coil(p):
    """Resistance grows with the turns N, force per ampere with N, inductance with N^2: each tells its own number."""
    law, p = p.force, p.coil
    mean_radius = 0.25 * (p.inner_diameter_mm + p.outer_diameter_mm) * MM
    one_turn = wire_resistance(1.0, mean_radius, p.wire_diameter_mm * MM)
    expected = p.turns * one_turn
    wrong = abs(p.resistance_ohm / expected - 1.0) > RESISTANCE_SHARE
    yield finding("coil_resistance", wrong, "resistance", p.resistance_ohm, expected, p=p)
    slope = current_slope(law.terms, p.force_distance_mm * MM)
    implied = {
        "as printed": p.turns,
        "by its resistance": p.resistance_ohm / one_turn,
        "by its inductance": np.sqrt(p.inductance_H / p.inductance_per_turn2_H),
        "by its force per ampere": slope / p.force_per_ampere_turn_N,
    }
    low, high = min(implied.values()), max(implied.values())
    wrong = high / low - 1.0 > TURNS_SHARE
    turns = ", ".join(f"{number:.3g} {how}" for how, number in implied.items())
    yield finding("one_coil", wrong, "turns", low, high, "several_coils" if wrong else None, turns=turns)
    room = 0.5 * (p.outer_diameter_mm - p.inner_diameter_mm) * p.height_mm
    needed = smallest_winding_area(p.turns, p.wire_diameter_mm)
    yield finding("coil_room", needed > room, "winding", needed, room, p=p)


def check_bounds(p):
    """Bounds that exclude the printed solution, or every solution; and a law that is printed twice."""
    p = p.force
    if p.upper_bound is not None:
        low, high, about = p.lower_bound, p.upper_bound, "bounds of the fit"
        outside = [value for row in p.rows for value in (row["a"], row["b"]) if not low <= value <= high]
        if outside:
            yield finding("bounds", True, about, high, max(outside), p=p)
        rms = float(np.sqrt(np.mean([row["J1"] for row in p.rows]) / p.points))
        if p.bounds_hold_for_slacks and rms > high:
            yield finding("slack_bounds", True, about, high, rms)
    first = powers(p.terms)
    for (d, i), value in powers(p.terms_again).items():
        stated = first.get((d, i))
        if stated is not None and abs(value - stated) > ROUNDING * abs(stated):
            yield finding("law_twice", True, p.terms_again_where, value, stated, d=d, i=i)


def check_differences(p):
    """Mean and standard deviation over the distances of what a step of the current adds to the force."""
    p = p.force
    if p.difference_step_A is None:
        return
    d = np.linspace(p.distance_min_mm, p.distance_max_mm, p.points) * MM
    step = force(p.terms, d, p.difference_step_A) - force(p.terms, d, 0.0)
    for code, about, stated, value in (
        ("difference_mean", "mean of the differences", p.difference_mean_N, float(step.mean())),
        ("difference_sd", "standard deviation of the differences", p.difference_sd_N, float(step.std(ddof=1))),
    ):
        ratio = stated / value
        words = "difference_in_mN" if 500.0 < ratio < 2000.0 else "difference"
        severity = "wrong" if max(ratio, 1.0 / ratio) > 1.5 else "note"
        yield finding(code, severity, about, stated, value, words, p=p)


def check_stages(p):
    """The printed mean of a, slope of b through the origin and its sum of squares, from the rows; and an F test."""
    p = p.force
    i, a, b = (np.array([row[name] for row in p.rows]) for name in ("current_A", "a", "b"))
    slope = float(i @ b / (i @ i))
    for code, about, value, tolerance in (
        ("mean_a", "mean of a", float(a.mean()), ROUNDING),
        ("slope_b", "slope of b over the current", slope, ROUNDING),
        ("J3", "J3", float(np.sum((b - slope * i) ** 2)), J3_ROUNDING),
    ):
        stated = getattr(p, code)
        if stated is not None:
            yield finding(code, abs(stated - value) > tolerance * abs(value), about, stated, value, "stage")
    ratio, chance = quadratic_f_test(i, b, through_origin=True)
    linear = chance >= LEVEL
    severity = "holds" if linear else "wrong" if p.says_linear_in_current else "note"
    words = "linear" if linear else "not_linear"
    yield finding("linear_in_current", severity, "linearity in the current", None, chance, words, ratio=ratio)


def check_residuals(p):
    """What the sums of squares mean as a force, whether they know of the current; and rows that others contradict."""
    p = p.force
    sums = np.array([row["J1"] for row in p.rows])
    rms, spread = float(np.sqrt(sums.mean() / p.points)), float(np.ptp(sums) / sums.mean())
    middle = 0.5 * (p.distance_min_mm + p.distance_max_mm)
    share = rms / abs(float(force(p.terms, middle * MM, 0.0)))
    numbers = {"mN": 1e3 * rms, "percent": 100.0 * share, "middle_mm": middle, "spread": 100.0 * spread}
    words = "residual_of_magnet" if spread < 0.05 else "residual_rms"
    yield finding("residual_rms", "note", "J1", float(sums.mean()), rms, words, p=p, **numbers)
    for name in ("a", "b", "J1", "c"):
        values = [row.get(name, 0.0) for row in p.rows]
        for k, (before, value, after) in enumerate(zip(values, values[1:], values[2:], strict=False), start=1):
            if min(before, value, after) <= 0.0:
                continue
            between = float(np.sqrt(before * after))
            steady = max(before, after) < MISPRINT**2 * min(before, after)
            if steady and max(value / between, between / value) > MISPRINT:
                about = f"row {p.rows[k]['current_A']:g} A"
                yield finding("misprint", True, about, value, between, name=name, before=before, after=after)


def check_range(p):
    """The distances at which the supply's clamp can hold the body, against the range that is said."""
    law, ohm, weight, p = p.force, p.coil.resistance_ohm, MM * p.magnet.mass_g * GRAVITY, p.supply
    d = np.arange(law.distance_min_mm, law.distance_max_mm + 0.01, 0.01)
    voltage = ohm * holding_current(law.terms, d * MM, weight)
    held = d[(voltage >= p.voltage_min_V) & (voltage <= p.voltage_max_V)]
    far = float(holding_current(law.terms, p.held_max_mm * MM, weight))
    needs, about = {"p": p, "far_A": far, "far_V": far * ohm}, "range that the supply can hold"
    if not len(held):
        yield finding("held_range", True, about, words="nothing_held", **needs)
        return
    wrong = held[0] > p.held_min_mm + 0.5 or held[-1] < p.held_max_mm - 0.5
    yield finding("held_range", wrong, about, p.held_max_mm, float(held[-1]), near=held[0], **needs)


def check_equations(p):
    """Gravity, and each term of d'': it must be the law's, with the other sign and over the mass; and di/dt."""
    equations, law, mass = p.equations, powers(p.force.terms), MM * p.magnet.mass_g
    worst = max(equations.gravity_m_s2, key=lambda g: abs(abs(g) - GRAVITY))
    wrong = abs(abs(worst) / GRAVITY - 1.0) > GRAVITY_SHARE
    printed, be = listed(equations.gravity_m_s2, "{:g}"), "are" if len(equations.gravity_m_s2) > 1 else "is"
    yield finding("gravity", wrong, "gravity", worst, GRAVITY, printed=printed, be=be)
    terms = {at: value for at, value in powers(equations.acceleration_terms).items() if at in law}
    undivided = [at for at, value in terms.items() if abs(abs(value) - abs(law[at])) < SAME * abs(law[at])]
    turned = [at for at, value in terms.items() if value * law[at] > 0.0]
    about, named = "velocity equation", "d^{0[0]} i^{0[1]}"
    if undivided:
        words = {"terms": listed(undivided, named), "grams": 1e3 * mass}
        yield finding("mass_missing", True, about, 1.0, 1.0 / mass, **words)
    if turned:
        yield finding("force_sign", True, about, terms=listed(turned, named))
    if not undivided and not turned:
        yield finding("acceleration", False, about)
    about = "current equation"
    if not equations.has_back_emf:
        slope = current_slope(p.force.terms, p.supply.held_min_mm * MM)
        yield finding("back_emf", True, about, 0.0, slope, held_min_mm=p.supply.held_min_mm)
    if equations.current_per_A >= 0.0 or equations.current_per_V <= 0.0:
        yield finding("current_signs", True, about)


def check_weights(p):
    """Sigma-point weights: their exact values and sums, the printed digits, and single precision."""
    p = p.filter
    spread = p.alpha**2 * (p.states + p.kappa)
    centre, other, more = 1.0 - p.states / spread, 0.5 / spread, 1.0 - p.alpha**2 + p.beta
    for name, expected, first in (("mean_weights", 1.0, centre), ("covariance_weights", 1.0 + more, centre + more)):
        total = float(np.sum(getattr(p, name)))
        wrong = abs(total - expected) > SAME * max(1.0, abs(expected))
        words = "other_weights" if wrong else "weights"
        yield finding(name, wrong, name.replace("_", " "), total, expected, words, centre=first, other=other)
    lost = abs(centre) * EPSILON
    safe = lost <= LOST
    severity = "holds" if safe else "wrong" if p.single_precision else "note"
    words = "single_precision" if safe else "lost_precision"
    yield finding("single_precision", severity, "alpha", p.alpha, lost, words, centre=centre, percent=100.0 * lost)


def check_noise(p):
    """Whether the noise has a unit; and whether white noise can be reduced as much as is said: 1/sqrt(2 lambda t_s)."""
    noise, root, wide = p.filter, np.sqrt(p.filter.measurement_noise), p.supply.held_max_mm - p.supply.held_min_mm
    words = "noise_unit" if noise.noise_unit else "no_noise_unit"
    stated, spans = noise.measurement_noise, root / (MM * wide)
    yield finding("noise_unit", not noise.noise_unit, "Q and R", stated, root, words, p=noise, spans=spans)
    ratios = [a / b for a, b in zip(noise.direct_rms_m, noise.filtered_rms_m, strict=True)]
    rates = [unstable_rate(p, MM * d) for d in (p.supply.held_min_mm, p.supply.held_max_mm)]
    low, high = sorted(1.0 / np.sqrt(2.0 * rate * noise.sample_time_s) for rate in rates)
    wrong = max(ratios) > REACHABLE * high
    yield finding("noise_reduction", wrong, "noise reduction", max(ratios), high, said=listed(ratios), low=low)


def check_hall(p):
    """Hall output to distance, d = sum_k p_k (v + c)^k: the sign of its constant, and the magnet's own field."""
    magnet, supply, p, about = p.magnet, p.supply, p.hall, "Hall output to distance"
    as_printed, subtracted = (
        float(np.polyval(p.polynomial_mm, p.quiescent_V + sign * p.constant_V)) for sign in (1.0, -1.0)
    )
    sensible = 0.0 < as_printed < 1e3
    words = "hall_constant" if sensible else "hall_sign"
    yield finding("hall_constant", not sensible, about, as_printed, subtracted, words, p=p)
    if p.sensitivity_V_per_T is None:
        return
    d = np.linspace(supply.held_min_mm, supply.held_max_mm, 17)
    field = axis_field_of_cylinder(magnet.remanence_T, 0.5 * magnet.diameter_mm, magnet.height_mm, d)
    off = float(np.max(np.abs(np.polyval(p.polynomial_mm, p.sensitivity_V_per_T * field) / d - 1.0)))
    severity = "note" if off > FIELD_SHARE else "holds"
    yield finding("hall_field", severity, about, None, off, m=magnet, p=p, percent=100.0 * off)


def check_pid(p):
    """Poles and zeros of a printed difference equation, u(k) = sum past_k u(k - k) + sum error_k e(k - k)."""
    p = p.pid
    poles, zeros = (np.sort(np.abs(np.roots(line)))[::-1] for line in ([1.0, *(-k for k in p.past)], p.error))
    outside = [float(z) for z in zeros if z > 1.0 + SAME]
    side = "with" if float(np.sum(p.error)) * p.error[0] > 0.0 else "against"
    words = {"poles": listed(poles, "{:.4g}", ", "), "zeros": listed(zeros, "{:.4g}", ", "), "side": side}
    if outside:
        yield finding("pid", True, "controller", outside[0], 1.0, "pid_zero", **words)
    else:
        yield finding("pid", False, "controller", **words)


CHECKS = (check_magnet, check_coil, check_bounds, check_differences, check_stages, check_residuals, check_range,
          check_equations, check_weights, check_noise, check_hall, check_pid)  # fmt: skip


def audit_parameters(data):
    """Everything that follows from the numbers themselves, in the order of the file's sections."""
    sections = {name: SimpleNamespace(**(OPTIONAL | one)) for name, one in data.items() if isinstance(one, dict)}
    parameters = SimpleNamespace(**sections)
    return [one for check in CHECKS for one in check(parameters)]


def main():
    """Print the findings."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("file", type=Path)
    data = tomllib.loads(parser.parse_args().file.read_text(encoding="utf-8"))
    sys.stdout.write(f"{Audit(tuple(audit_parameters(data)))}\n")


if __name__ == "__main__":
    main()
