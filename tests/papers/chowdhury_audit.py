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
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from scipy import stats

from femfit.audit.audit_model import Audit, AuditFinding
from femfit.core.numerics import GRAVITY
from femfit.device.parts import smallest_winding_area, wire_resistance

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


def finding(code, wrong, about, text, stated=None, recomputed=None):
    """A finding that is wrong or holds; a severity in place of the truth value is taken as it is."""
    severity = wrong if isinstance(wrong, str) else "wrong" if wrong else "holds"
    return AuditFinding(code, severity, about, text, stated, recomputed)


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
    magnet = p.magnet
    volume = np.pi / 4.0 * (magnet.diameter_mm * MM) ** 2 * magnet.height_mm * MM
    grams = 1e3 * volume * magnet.density_kg_m3
    off = abs(magnet.mass_g / grams - 1.0) > MASS_SHARE
    text = (
        f"{magnet.diameter_mm:g} x {magnet.height_mm:g} mm at {magnet.density_kg_m3:g} kg/m3 weigh {grams:.3g} g; "
        f"{magnet.mass_g:g} g are given" + (", so that is the magnet with its body, or another magnet." if off else ".")
    )
    yield finding("magnet_mass", "note" if off else "holds", "mass", text, magnet.mass_g, grams)


def check_coil(p):
    """Resistance grows with the turns N, force per ampere with N, inductance with N^2: each tells its own number."""
    coil = p.coil
    mean_radius = 0.25 * (coil.inner_diameter_mm + coil.outer_diameter_mm) * MM
    one_turn = wire_resistance(1.0, mean_radius, coil.wire_diameter_mm * MM)
    expected = coil.turns * one_turn
    wrong = abs(coil.resistance_ohm / expected - 1.0) > RESISTANCE_SHARE
    text = f"{coil.turns:g} turns of {coil.wire_diameter_mm:g} mm copper have {expected:.3g} ohm; "
    text += f"{coil.resistance_ohm:.3g} are given."
    yield finding("coil_resistance", wrong, "resistance", text, coil.resistance_ohm, expected)
    slope = current_slope(p.force.terms, coil.force_distance_mm * MM)
    implied = {
        "as printed": coil.turns,
        "by its resistance": coil.resistance_ohm / one_turn,
        "by its inductance": np.sqrt(coil.inductance_H / coil.inductance_per_turn2_H),
        "by its force per ampere": slope / coil.force_per_ampere_turn_N,
    }
    low, high = min(implied.values()), max(implied.values())
    wrong = high / low - 1.0 > TURNS_SHARE
    listed = ", ".join(f"{turns:.3g} {how}" for how, turns in implied.items())
    text = f"{listed}: {'one coil has one number' if wrong else 'one coil has them all'}."
    yield finding("one_coil", wrong, "turns", text, low, high)
    room = 0.5 * (coil.outer_diameter_mm - coil.inner_diameter_mm) * coil.height_mm
    needed = smallest_winding_area(coil.turns, coil.wire_diameter_mm)
    text = f"{coil.turns:g} turns of {coil.wire_diameter_mm:g} mm need at least {needed:.3g} mm2 of the section's "
    yield finding("coil_room", needed > room, "winding", f"{text}{room:.3g}.", needed, room)


def check_bounds(p):
    """Bounds that exclude the printed solution, or every solution; and a law that is printed twice."""
    law = p.force
    if law.upper_bound is not None:
        low, high, about = law.lower_bound, law.upper_bound, "bounds of the fit"
        outside = [value for row in law.rows for value in (row["a"], row["b"]) if not low <= value <= high]
        if outside:
            text = f"the bounds {low:g} to {high:g} exclude {max(outside):.4g}, which is printed as the solution."
            yield finding("bounds", True, about, text, high, max(outside))
        rms = float(np.sqrt(np.mean([row["J1"] for row in law.rows]) / law.points))
        if law.bounds_hold_for_slacks and rms > high:
            text = (
                f"bounds on the slacks too would hold every point within {high:g} N; the printed fit misses by "
                f"{rms:.3g} N rms: the problem is infeasible as printed."
            )
            yield finding("slack_bounds", True, about, text, high, rms)
    first = powers(law.terms)
    for (d, i), value in powers(law.terms_again).items():
        stated = first.get((d, i))
        if stated is not None and abs(value - stated) > ROUNDING * abs(stated):
            text = f"the coefficient of d^{d} i^{i} is {value:.4g} there and {stated:.4g} in the law."
            yield finding("law_twice", True, law.terms_again_where, text, value, stated)


def check_differences(p):
    """Mean and standard deviation over the distances of what a step of the current adds to the force."""
    law = p.force
    if law.difference_step_A is None:
        return
    d = np.linspace(law.distance_min_mm, law.distance_max_mm, law.points) * MM
    step = force(law.terms, d, law.difference_step_A) - force(law.terms, d, 0.0)
    for code, about, stated, value in (
        ("difference_mean", "mean", law.difference_mean_N, float(step.mean())),
        ("difference_sd", "standard deviation", law.difference_sd_N, float(step.std(ddof=1))),
    ):
        ratio = stated / value
        unit = ", a thousand times less: mN is meant" if 500.0 < ratio < 2000.0 else ""
        text = f"the law gives {value:.3g} N for a step of {law.difference_step_A:g} A; {stated:.4g} is printed{unit}."
        severity = "wrong" if max(ratio, 1.0 / ratio) > 1.5 else "note"
        yield finding(code, severity, f"{about} of the differences", text, stated, value)


def check_stages(p):
    """The printed mean of a, slope of b through the origin and its sum of squares, from the rows; and an F test."""
    law = p.force
    i, a, b = (np.array([row[name] for row in law.rows]) for name in ("current_A", "a", "b"))
    slope = float(i @ b / (i @ i))
    for code, about, value, tolerance in (
        ("mean_a", "mean of a", float(a.mean()), ROUNDING),
        ("slope_b", "slope of b over the current", slope, ROUNDING),
        ("J3", "J3", float(np.sum((b - slope * i) ** 2)), J3_ROUNDING),
    ):
        stated = getattr(law, code)
        if stated is not None:
            text = f"the rows give {value:.4g}; {stated:.5g} is printed."
            yield finding(code, abs(stated - value) > tolerance * abs(value), about, text, stated, value)
    line, curve = i[:, None], np.column_stack([i, i**2])
    left = [float(np.sum((b - x @ np.linalg.lstsq(x, b, rcond=None)[0]) ** 2)) for x in (line, curve)]
    ratio = (left[0] - left[1]) / (left[1] / (len(b) - 2))
    chance = float(stats.f.sf(ratio, 1, len(b) - 2))
    severity = "holds" if chance >= LEVEL else "wrong" if law.says_linear_in_current else "note"
    text = f"a term in i^2 beside the line for b has F = {ratio:.3g}, p = {chance:.2g}: " + (
        "b is linear in the current as far as the rows tell." if chance >= LEVEL else "b is not linear in the current."
    )
    yield finding("linear_in_current", severity, "linearity in the current", text, None, chance)


def check_residuals(p):
    """What the sums of squares mean as a force, whether they know of the current; and rows that others contradict."""
    law = p.force
    sums = np.array([row["J1"] for row in law.rows])
    rms, spread = float(np.sqrt(sums.mean() / law.points)), float(np.ptp(sums) / sums.mean())
    middle = 0.5 * (law.distance_min_mm + law.distance_max_mm) * MM
    share = rms / abs(float(force(law.terms, middle, 0.0)))
    text = (
        f"J1 = {sums.mean():.3g} N2 over {law.points} points is {1e3 * rms:.3g} mN rms, {100 * share:.2g} % of the "
        f"force without current at {1e3 * middle:g} mm"
    )
    same = f"; it differs by {100 * spread:.2g} % between currents, so the misfit is in the part without current."
    yield finding("residual_rms", "note", "J1", text + (same if spread < 0.05 else "."), float(sums.mean()), rms)
    for name in ("a", "b", "J1", "c"):
        values = [row.get(name, 0.0) for row in law.rows]
        for k, (before, value, after) in enumerate(zip(values, values[1:], values[2:], strict=False), start=1):
            if min(before, value, after) <= 0.0:
                continue
            between = float(np.sqrt(before * after))
            steady = max(before, after) < MISPRINT**2 * min(before, after)
            if steady and max(value / between, between / value) > MISPRINT:
                text = f"{name} = {value:.4g} stands between {before:.4g} and {after:.4g}: a misprint."
                yield finding("misprint", True, f"row {law.rows[k]['current_A']:g} A", text, value, between)


def check_range(p):
    """The distances at which the supply's clamp can hold the body, against the range that is said."""
    law, supply, weight = p.force, p.supply, MM * p.magnet.mass_g * GRAVITY
    d = np.arange(law.distance_min_mm, law.distance_max_mm + 0.01, 0.01)
    voltage = p.coil.resistance_ohm * holding_current(law.terms, d * MM, weight)
    held = d[(voltage >= supply.voltage_min_V) & (voltage <= supply.voltage_max_V)]
    clamp = f"with {supply.voltage_min_V:g} to {supply.voltage_max_V:g} V "
    far = float(holding_current(law.terms, supply.held_max_mm * MM, weight))
    needs = f"{supply.held_max_mm:g} mm would need {far:.2g} A and {far * p.coil.resistance_ohm:.3g} V"
    about = "range that the supply can hold"
    if not len(held):
        yield finding("held_range", True, about, f"{clamp}no distance of the law's range can be held; {needs}.")
        return
    wrong = held[0] > supply.held_min_mm + 0.5 or held[-1] < supply.held_max_mm - 0.5
    said = f"{supply.held_min_mm:g} to {supply.held_max_mm:g} mm"
    text = f"{clamp}the law holds {held[0]:.1f} to {held[-1]:.1f} mm; {said} are said, and {needs}."
    yield finding("held_range", wrong, about, text, supply.held_max_mm, float(held[-1]))


def check_equations(p):
    """Gravity, and each term of d'': it must be the law's, with the other sign and over the mass; and di/dt."""
    equations, law, mass = p.equations, powers(p.force.terms), MM * p.magnet.mass_g
    worst = max(equations.gravity_m_s2, key=lambda g: abs(abs(g) - GRAVITY))
    several = len(equations.gravity_m_s2) > 1
    text = f"{' and '.join(f'{g:g}' for g in equations.gravity_m_s2)} m/s2 {'are' if several else 'is'} printed; "
    wrong = abs(abs(worst) / GRAVITY - 1.0) > GRAVITY_SHARE
    yield finding("gravity", wrong, "gravity", f"{text}standard gravity is {GRAVITY:.4g}.", worst, GRAVITY)
    terms = {at: value for at, value in powers(equations.acceleration_terms).items() if at in law}
    undivided = [at for at, value in terms.items() if abs(abs(value) - abs(law[at])) < SAME * abs(law[at])]
    turned = [at for at, value in terms.items() if value * law[at] > 0.0]
    named = {at: f"d^{at[0]} i^{at[1]}" for at in terms}
    about = "velocity equation"
    if undivided:
        text = (
            f"{' and '.join(named[at] for at in undivided)} stand in an acceleration as in the force: the division by "
            f"the mass of {1e3 * mass:g} g is missing, a factor of {1.0 / mass:.3g}."
        )
        yield finding("mass_missing", True, about, text, 1.0, 1.0 / mass)
    if turned:
        text = f"{' and '.join(named[at] for at in turned)} pushes away, where the law attracts: the sign must be the "
        yield finding("force_sign", True, about, f"{text}other.")
    if not undivided and not turned:
        yield finding("acceleration", False, about, "it is g minus the law over the mass.")
    about = "current equation"
    if not equations.has_back_emf:
        slope = current_slope(p.force.terms, p.supply.held_min_mm * MM)
        text = "it has no back-EMF; by reciprocity that is k_m = dF/di = "
        text += f"{slope:.3g} V s/m at {p.supply.held_min_mm:g} mm."
        yield finding("back_emf", True, about, text, 0.0, slope)
    if equations.current_per_A >= 0.0 or equations.current_per_V <= 0.0:
        text = "di/dt must fall with the current and rise with the voltage: -R/L and 1/L."
        yield finding("current_signs", True, about, text)


def check_weights(p):
    """Sigma-point weights: their exact values and sums, the printed digits, and single precision."""
    section = p.filter
    spread = section.alpha**2 * (section.states + section.kappa)
    centre, other, more = 1.0 - section.states / spread, 0.5 / spread, 1.0 - section.alpha**2 + section.beta
    for name, expected, first in (("mean_weights", 1.0, centre), ("covariance_weights", 1.0 + more, centre + more)):
        total = float(np.sum(getattr(section, name)))
        wrong = abs(total - expected) > SAME * max(1.0, abs(expected))
        text = f"the printed digits sum to {total:.6g} and should to {expected:.6g}"
        text += f"; exactly W_0 = {first:.0f} and W_i = {other:.2f}." if wrong else "."
        yield finding(name, wrong, name.replace("_", " "), text, total, expected)
    lost = abs(centre) * EPSILON
    severity, text = "holds", f"the centre weight {centre:.3g} is safe in single precision."
    if lost > LOST:
        severity = "wrong" if section.single_precision else "note"
        text = (
            f"alpha = {section.alpha:g} gives a centre weight of {centre:.3g}: single precision rounds "
            f"{100 * lost:.2g} % of every mean away and loses the covariance; alpha = 1 in difference form is safe."
        )
    yield finding("single_precision", severity, "alpha", text, section.alpha, lost)


def check_noise(p):
    """Whether the noise has a unit; and whether white noise can be reduced as much as is said: 1/sqrt(2 lambda t_s)."""
    section, root = p.filter, np.sqrt(p.filter.measurement_noise)
    text = f"R = {section.measurement_noise:g} {section.noise_unit} is a standard deviation of {root:.3g}."
    if not section.noise_unit:
        spans = root / (MM * (p.supply.held_max_mm - p.supply.held_min_mm))
        text = (
            f"no unit: R = {section.measurement_noise:g} in m2 is a standard deviation of {root:.2g} m, "
            f"{spans:.2g} times the whole range; in mm2 it is {root:.2g} mm."
        )
    yield finding("noise_unit", not section.noise_unit, "Q and R", text, section.measurement_noise, root)
    ratios = [a / b for a, b in zip(section.direct_rms_m, section.filtered_rms_m, strict=True)]
    rates = [unstable_rate(p, MM * d) for d in (p.supply.held_min_mm, p.supply.held_max_mm)]
    bounds = sorted(1.0 / np.sqrt(2.0 * rate * section.sample_time_s) for rate in rates)
    text = (
        f"{' and '.join(f'{ratio:.3g}' for ratio in ratios)} times less noise is said; with white noise no causal "
        f"filter of this unstable body passes 1/sqrt(2 lambda t_s) = {bounds[0]:.2g} to {bounds[1]:.2g}."
    )
    wrong = max(ratios) > REACHABLE * bounds[-1]
    yield finding("noise_reduction", wrong, "noise reduction", text, max(ratios), bounds[-1])


def check_hall(p):
    """Hall output to distance, d = sum_k p_k (v + c)^k: the sign of its constant, and the magnet's own field."""
    section, magnet, about = p.hall, p.magnet, "Hall output to distance"
    as_printed, subtracted = (
        float(np.polyval(section.polynomial_mm, section.quiescent_V + sign * section.constant_V))
        for sign in (1.0, -1.0)
    )
    sensible = 0.0 < as_printed < 1e3
    text = (
        f"without any field the printed constant of {section.constant_V:+g} V gives a distance of {as_printed:.3g} mm"
    )
    text += "." if sensible else f"; subtracted it gives {subtracted:.3g} mm, the far end: it must be subtracted."
    yield finding("hall_constant", not sensible, about, text, as_printed, subtracted)
    if section.sensitivity_V_per_T is None:
        return
    d = np.linspace(p.supply.held_min_mm, p.supply.held_max_mm, 17)
    volts = section.sensitivity_V_per_T * axis_field(magnet, d)
    off = float(np.max(np.abs(np.polyval(section.polynomial_mm, volts) / d - 1.0)))
    text = (
        f"the field of a {magnet.diameter_mm:g} x {magnet.height_mm:g} mm magnet of {magnet.remanence_T:g} T at "
        f"{section.sensitivity_V_per_T:g} V/T gives the distance within {100 * off:.2g} %."
    )
    yield finding("hall_field", "note" if off > FIELD_SHARE else "holds", about, text, None, off)


def axis_field(magnet, d):
    """B on the axis of a cylinder magnet, Br/2 ((d + h)/sqrt((d + h)^2 + R^2) - d/sqrt(d^2 + R^2))."""
    far, radius = d + magnet.height_mm, 0.5 * magnet.diameter_mm
    return 0.5 * magnet.remanence_T * (far / np.hypot(far, radius) - d / np.hypot(d, radius))


def check_pid(p):
    """Poles and zeros of a printed difference equation, u(k) = sum past_k u(k - k) + sum error_k e(k - k)."""
    poles, zeros = (
        np.sort(np.abs(np.roots(equation)))[::-1] for equation in ([1.0, *(-k for k in p.pid.past)], p.pid.error)
    )
    outside = [float(z) for z in zeros if z > 1.0 + SAME]
    text = f"its poles have the magnitudes {', '.join(f'{one:.4g}' for one in poles)}, its zeros "
    text += f"{', '.join(f'{one:.4g}' for one in zeros)}"
    if not outside:
        yield finding("pid", False, "controller", text + ".")
        return
    side = "with" if float(np.sum(p.pid.error)) * p.pid.error[0] > 0.0 else "against"
    text += f": a zero at {outside[0]:.4g}, outside of the unit circle, works against the integrator: with it the "
    yield finding(
        "pid", True, "controller", f"{text}static part acts {side} the sign of the fast part.", outside[0], 1.0
    )


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
