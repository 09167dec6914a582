"""Magnetisation curves: monotone, smooth, with the energy that belongs to them, and refused where they are wrong."""

import numpy as np
import pytest

from femfit.core.numerics import MU_0
from femfit.device.bh import BHCurve, curve_problems, without_flat_end
from femfit.device.materials import LIBRARY
from femfit.device.parts import NonlinearMaterial
from support.expected import unmentioned

SATURATING = [entry.material for entry in LIBRARY.values() if isinstance(entry.material, NonlinearMaterial)]
S_SHAPED = NonlinearMaterial("s-shaped", (0.0, 0.05, 0.6, 1.2, 1.5), (0.0, 100.0, 200.0, 800.0, 5000.0))
CURVES = [pytest.param(BHCurve(m.flux_density_T, m.field_A_per_m), m, id=m.name) for m in [*SATURATING, S_SHAPED]]
EVERYWHERE = np.linspace(0.0, 4.0, 40_001)


@pytest.mark.parametrize(("curve", "material"), CURVES)
def test_curve_passes_through_its_points(curve, material):
    np.testing.assert_allclose(curve.field(np.array(material.flux_density_T)), material.field_A_per_m, rtol=1e-12)


@pytest.mark.parametrize(("curve", "material"), CURVES)
def test_field_rises_everywhere_and_never_faster_than_in_air(curve, material):
    assert (np.diff(curve.field(EVERYWHERE)) > 0).all()
    slope = curve.differential_reluctivity(EVERYWHERE) * MU_0
    assert (slope > 0).all()
    # Between points a cubic whose secant is nu_0 may overshoot it; tables are rounded, too.
    assert slope.max() < 1.01


@pytest.mark.parametrize(("curve", "material"), CURVES)
def test_slope_is_continuous_and_that_of_air_beyond_saturation(curve, material):
    kinks = np.array([*material.flux_density_T[1:], curve.saturated_T])
    below, above = (curve.differential_reluctivity(kinks + side) for side in (-1e-9, 1e-9))
    np.testing.assert_allclose(below, above, rtol=1e-4)
    beyond = curve.saturated_T + np.array([0.0, 0.5, 5.0])
    np.testing.assert_allclose(curve.differential_reluctivity(beyond), 1.0 / MU_0, rtol=1e-12)
    np.testing.assert_allclose(np.diff(curve.field(beyond)), np.diff(beyond) / MU_0, rtol=1e-9)


@pytest.mark.parametrize(("curve", "material"), CURVES)
def test_saturation_adds_at_most_a_tenth_of_the_last_flux_density(curve, material):
    def polarisation(b):
        return b - MU_0 * float(curve.field(np.array([b]))[0])

    last = material.flux_density_T[-1]
    assert -0.002 * last < polarisation(10.0) - polarisation(last) < 0.1 * last  # the tables' own rounding


@pytest.mark.parametrize(("curve", "material"), CURVES)
def test_energy_is_the_integral_of_the_field(curve, material):
    b = np.linspace(0.0, 3.5, 200_001)
    h = curve.field(b)
    integral = np.concatenate([[0.0], np.cumsum(0.5 * (h[1:] + h[:-1]) * np.diff(b))])
    np.testing.assert_allclose(curve.energy_density(b), integral, rtol=1e-6, atol=1e-6 * integral[-1] / len(b))


@pytest.mark.parametrize(("curve", "material"), CURVES)
def test_reluctivity_is_finite_and_continuous_down_to_zero(curve, material):
    at_zero = curve.reluctivity(np.zeros(1))
    assert at_zero == pytest.approx(material.field_A_per_m[1] / material.flux_density_T[1])
    assert at_zero == pytest.approx(curve.reluctivity(np.array([1e-9])), rel=1e-6)
    np.testing.assert_allclose(curve.reluctivity(EVERYWHERE) * EVERYWHERE, curve.field(EVERYWHERE), rtol=1e-14)


def test_a_straight_curve_is_a_constant_permeability():
    b = np.array([0.0, 1.0, 2.0, 3.0])
    curve = BHCurve(tuple(b), tuple(b / (450.0 * MU_0)))
    fine = np.linspace(0.0, 3.0, 301)
    np.testing.assert_allclose(curve.reluctivity(fine), 1.0 / (450.0 * MU_0), rtol=1e-13)
    np.testing.assert_allclose(curve.differential_reluctivity(fine), 1.0 / (450.0 * MU_0), rtol=1e-12)


def test_a_published_curve_that_ends_a_little_below_mu_0_is_cut_and_it_is_said():
    b, h = (0.0, 1.5, 1.9, 2.1), (0.0, 1e3, 2e4, 1e5)
    beyond = tuple(2.1 + k * 0.9 * MU_0 * 1e5 for k in (1, 2)), (2e5, 3e5)
    points, remark = without_flat_end(b + beyond[0], h + beyond[1])
    assert points == (b, h)
    assert curve_problems(*points) == []
    assert not unmentioned(["2.1 T", "0.9 mu_0"], remark)
    assert without_flat_end(b, h) == ((b, h), "")


@pytest.mark.parametrize("material", SATURATING, ids=lambda m: m.name)
def test_every_curve_of_the_library_obeys_its_own_rules(material):
    assert curve_problems(material.flux_density_T, material.field_A_per_m) == []


def test_the_nizn_ferrite_has_the_data_sheets_permeability_and_flux_density():
    ferrite = LIBRARY["ferrite_k10"].material
    assert ferrite.relative_permeability == pytest.approx(800.0, rel=0.02)  # its first point is at 5 A/m
    assert (ferrite.flux_density_T[-1], ferrite.field_A_per_m[-1]) == (0.2848, 2027.0)


def test_a_material_with_a_curve_can_be_a_key_and_has_the_permeability_of_its_first_point():
    material = NonlinearMaterial("steel", (0.0, 1.2, 1.5, 1.8), (0.0, 300.0, 2000.0, 12000.0))
    assert hash(material) is not None
    assert material.relative_permeability == pytest.approx(1.2 / 300.0 / MU_0)
