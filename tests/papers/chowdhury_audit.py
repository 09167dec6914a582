"""What the levitation paper prints, beside what its other numbers make of it.

    python tests/papers/chowdhury_audit.py

The printed numbers stand in ``data/chowdhury2016.toml``, in SI but for lengths (mm) and masses (g) whose keys say so.

References
----------
E. P. Furlani, Permanent Magnet and Electromechanical Devices (Academic Press, 2001), section 3.11: the field on the
axis of a cylinder. S. J. Julier, The scaled unscented transformation, American Control Conference (2002) 4555.
"""

import sys
import tomllib
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from femfit.core.numerics import GRAVITY
from femfit.device.parts import wire_resistance

sys.path.insert(0, str(Path(__file__).parents[1]))

from papers.chowdhury_force import quadratic_f_test

from support.exact import axis_field_of_cylinder

PRINTED = Path(__file__).parents[2] / "data" / "chowdhury2016.toml"
EPSILON = 2.0**-24
"""Rounding of single precision, IEEE 754."""


@dataclass(frozen=True)
class Figure:
    """A printed number, what follows from the others, and why they differ; nothing where they agree."""

    about: str
    printed: float
    recomputed: float
    why: str = ""

    def __str__(self):
        return f"{self.about}: {self.printed:.4g} is printed, {self.recomputed:.4g} recomputed. {self.why}".strip()


def force(d, i):
    """F = a d^-4 + m i d^-2 in N, equations (7) and (10)."""
    return 5.996e-9 * d**-4.0 + 4.509e-6 * i * d**-2.0


def of_coil(coil):
    """Resistance grows with the turns N, force per ampere with N, inductance with N^2: each tells its own number."""
    mean_radius = 0.25e-3 * (coil.inner_diameter_mm + coil.outer_diameter_mm)
    one_turn = wire_resistance(1.0, mean_radius, 1e-3 * coil.wire_diameter_mm)
    per_ampere = force(1e-3 * coil.force_distance_mm, 1.0) - force(1e-3 * coil.force_distance_mm, 0.0)
    why = "One coil has one number."
    yield Figure("resistance in ohm", coil.resistance_ohm, coil.turns * one_turn, "The wire is too short.")
    yield Figure("turns by the resistance", coil.turns, coil.resistance_ohm / one_turn, why)
    yield Figure("turns by the inductance", coil.turns, np.sqrt(coil.inductance_H / coil.inductance_per_turn2_H), why)
    yield Figure("turns by the force", coil.turns, per_ampere / coil.force_per_ampere_turn_N, why)


def of_law(law):
    """The fit's bounds, its rows by current, the law printed twice and its differences over a step of the current."""
    current, a, b, misfit, c = (
        np.array([row[name] for row in law.rows]) for name in ("current_A", "a", "b", "J1", "c")
    )
    slope, d = float(current @ b / (current @ current)), 1e-3 * np.linspace(15.0, 45.0, law.points)
    step = force(d, law.difference_step_A) - force(d, 0.0)
    rms = float(np.sqrt(misfit.mean() / law.points))
    yield Figure("upper bound of the fit", law.upper_bound, b.max(), "The printed solution lies outside.")
    yield Figure("upper bound of the slacks in N", law.upper_bound, rms, "The fit misses by more.")
    yield Figure("coefficient of i / d^2 in Table 5", law.terms_again[1]["value"], law.terms[1]["value"], "A misprint.")
    yield Figure("mean of the differences in N", law.difference_mean_N, step.mean(), "Not that of the law.")
    yield Figure("deviation of the differences in N", law.difference_sd_N, step.std(ddof=1), "It is printed in mN.")
    yield Figure("mean of a", law.mean_a, a.mean())
    yield Figure("slope of b over the current", law.slope_b, slope)
    yield Figure("J3", law.J3, np.sum((b - slope * current) ** 2))
    chance = quadratic_f_test(current, b, through_origin=True)[1]
    yield Figure("chance of no i^2 in b", 1.0, chance, "b is not linear in the current.")
    yield Figure("c at 0.8 A", c[4], np.sqrt(c[3] * c[5]), "A misprint between its neighbours.")


def of_motion(p, mass, equations, supply, noise):
    """The range that the clamped voltage holds, the equations of motion, and the least noise of a causal filter.

    A body that runs away with lambda = sqrt(-F_d / m) has at most 1 / sqrt(2 lambda t_s) times less noise.
    """
    d = 1e-3 * np.arange(15.0, 45.0, 0.01)
    hold = (mass * GRAVITY - force(d, 0.0)) / (force(d, 1.0) - force(d, 0.0))
    volts = p.coil.resistance_ohm * hold
    held = d[(volts >= supply.voltage_min_V) & (volts <= supply.voltage_max_V)]
    yield Figure("farthest distance that is held in mm", supply.held_max_mm, 1e3 * held[-1], "It would need 18.9 V.")
    yield Figure("gravity in m/s^2", equations.gravity_m_s2[0], GRAVITY, "No place on earth has as much.")
    passive, active = (term["value"] for term in equations.acceleration_terms)
    yield Figure("coefficient of d^-4 in d''", passive, -5.996e-9 / mass, "The division by the mass is missing.")
    yield Figure("coefficient of i d^-2 in d''", active, -4.509e-6 / mass, "The sign pushes away, too.")
    near = 1e-3 * supply.held_min_mm
    yield Figure("back-EMF in V s/m", 0.0, force(near, 1.0) - force(near, 0.0), "By reciprocity it is dF/di.")
    at = np.searchsorted(d, 1e-3 * np.array([supply.held_min_mm, supply.held_max_mm]))
    slope = (force(d[at] * 1.0001, hold[at]) - force(d[at] * 0.9999, hold[at])) / (2e-4 * d[at])
    reachable = 1.0 / np.sqrt(2.0 * np.sqrt(-slope / mass) * noise.sample_time_s)
    said = max(a / b for a, b in zip(noise.direct_rms_m, noise.filtered_rms_m, strict=True))
    yield Figure("noise, direct over filtered", said, reachable.max(), "No causal filter of white noise passes that.")


def of_filter(noise, span):
    """Sums of the sigma points' weights, rounding of the centre's, and the noise as a length."""
    spread = noise.alpha**2 * (noise.states + noise.kappa)
    centre, more = 1.0 - noise.states / spread, 1.0 - noise.alpha**2 + noise.beta
    why = "The digits do not cancel."
    yield Figure("sum of the mean's weights", np.sum(noise.mean_weights), 1.0, why)
    yield Figure("sum of the covariance's weights", np.sum(noise.covariance_weights), 1.0 + more, why)
    yield Figure("part of a mean lost in single precision", 0.0, abs(centre) * EPSILON, "alpha = 1 is safe.")
    yield Figure("noise of the distance in m", span, np.sqrt(noise.measurement_noise), "No unit; in m it is this.")


def of_hall(hall, magnet):
    """The polynomial of distance in mm at no field, and in the magnet's field on its axis."""
    as_printed, subtracted = (np.polyval(hall.polynomial_mm, (1 + sign) * hall.quiescent_V) for sign in (1.0, -1.0))
    yield Figure("distance in mm without any field", as_printed, subtracted, "The constant must be subtracted.")
    d = np.linspace(22.0, 30.0, 17)
    field = axis_field_of_cylinder(magnet.remanence_T, 0.5 * magnet.diameter_mm, magnet.height_mm, d)
    ratio = np.polyval(hall.polynomial_mm, hall.sensitivity_V_per_T * field) / d
    yield Figure("distance of the polynomial over that of the field", 1.0, ratio[np.argmax(np.abs(ratio - 1.0))])


def figures():
    """Every printed number that others tell, in the order of the file's sections."""
    data = tomllib.loads(PRINTED.read_text(encoding="utf-8"))
    p = SimpleNamespace(**{name: SimpleNamespace(**one) for name, one in data.items() if isinstance(one, dict)})
    magnet, mass = p.magnet, 1e-3 * p.magnet.mass_g
    grams = 7500e3 * np.pi / 4.0 * (1e-3 * magnet.diameter_mm) ** 2 * 1e-3 * magnet.height_mm
    yield Figure("mass in g", magnet.mass_g, grams, "That is the magnet with its body, or another magnet.")
    yield from of_coil(p.coil)
    yield from of_law(p.force)
    yield from of_motion(p, mass, p.equations, p.supply, p.filter)
    yield from of_filter(p.filter, 1e-3 * (p.supply.held_max_mm - p.supply.held_min_mm))
    yield from of_hall(p.hall, magnet)
    zero = np.abs(np.roots(p.pid.error)).max()
    yield Figure(
        "largest zero of the controller", zero, 1.0, "Outside of the unit circle it works against the integral."
    )


if __name__ == "__main__":
    sys.stdout.write("\n".join(map(str, figures())) + "\n")
