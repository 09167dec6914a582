"""Magnetisation curves: monotone, smooth, with the energy that belongs to them, and refused where they are wrong."""

import numpy as np
import pytest

from femfit.core.constants import MU_0
from femfit.core.errors import ActuatorFileError
from femfit.device.bh_curve import BHCurve
from femfit.device.bh_table import curve_problems, read_bh_csv, without_flat_end
from femfit.device.load import actuator_from_toml, read_actuator
from femfit.device.materials import LIBRARY
from femfit.device.parts import NonlinearMaterial
from femfit.device.summary import remarks

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


BAD = {
    "other lengths": ([0, 1, 2], [0, 1], "as many B_T as H_A_per_m; it has 3 and 2"),
    "too few": ([0, 1], [0, 1], "3 to 1000 points; it has 2"),
    "not finite": ([0, 1, float("nan")], [0, 1, 2], "finite numbers"),
    "no start": ([0.1, 1, 1.5], [10, 100, 1000], "start at B = 0, H = 0; it starts at 0.1, 10"),
    "B falls": ([0, 1, 0.9], [0, 100, 1000], "ascending B_T; it has 0.9 after 1"),
    "H repeats": ([0, 1, 1.5], [0, 100, 100], "ascending H_A_per_m; it has 100 after 100"),
    "B in kilogauss": ([0, 10, 15], [0, 500, 3000], "B in tesla up to 5; it goes up to 15"),
    "H in kA/m": ([0, 1, 1.5], [0, 0.0001, 3], "H in A/m"),
    "polarisation": ([0, 1.5, 1.6, 1.61], [0, 1e3, 1e4, 1e5], "from 1.6 to 1.61 T it rises with 0.0884 mu_0"),
}


@pytest.mark.parametrize(("b", "h", "message"), BAD.values(), ids=BAD.keys())
def test_points_that_are_no_curve_are_refused(b, h, message):
    problems = curve_problems(b, h)
    assert len(problems) == 1
    assert message in problems[0]


def test_a_published_curve_that_ends_a_little_below_mu_0_is_cut_and_it_is_said():
    b, h = (0.0, 1.5, 1.9, 2.1), (0.0, 1e3, 2e4, 1e5)
    beyond = tuple(2.1 + k * 0.9 * MU_0 * 1e5 for k in (1, 2)), (2e5, 3e5)
    points, remark = without_flat_end(b + beyond[0], h + beyond[1])
    assert points == (b, h)
    assert curve_problems(*points) == []
    assert "cut at 2.1 T" in remark
    assert "0.9 mu_0" in remark
    assert without_flat_end(b, h) == ((b, h), "")


def test_a_cut_curve_is_said_of_the_actuator():
    steel = "B_T = [0, 1.5, 1.9, 2.1, 2.21]\nH_A_per_m = [0, 1e3, 2e4, 1e5, 2e5]"
    (remark,) = remarks(actuator_from_toml(RIG.replace("MATERIAL", steel)))
    assert remark.startswith("Material steel: the B-H curve is cut at 2.1 T")


@pytest.mark.parametrize("material", SATURATING, ids=lambda m: m.name)
def test_every_curve_of_the_library_obeys_its_own_rules(material):
    assert curve_problems(material.flux_density_T, material.field_A_per_m) == []


def test_the_nizn_ferrite_has_the_data_sheets_permeability_and_flux_density():
    ferrite = LIBRARY["ferrite_k10"].material
    assert ferrite.relative_permeability == pytest.approx(800.0, rel=0.02)  # its first point is at 5 A/m
    assert (ferrite.flux_density_T[-1], ferrite.field_A_per_m[-1]) == (0.2848, 2027.0)


RIG = """\
schema = 1
name = "rig"
[materials.steel]
MATERIAL
[electromagnet.regions.core]
material = "steel"
r_mm = [0, 5]
z_mm = [-20, 0]
[coil]
r_mm = [6, 9]
z_mm = [-19, -1]
turns = 500
resistance_ohm = 5
[moving]
mass_g = 10
[moving.regions.plate]
material = "steel_1010"
r_mm = [0, 6]
z_mm = [0, 3]
[supply]
voltage_min_V = 0
voltage_max_V = 12
[sweep]
current_A = [0, 1]
distance_mm = [1, 2]
"""
CSV = "# a comment, with commas\nB_T,H_A_per_m\n0,0\n1.2,300\n1.5,2000\n\n1.8,12000\n"


def rig(material):
    return RIG.replace("MATERIAL", material)


def test_a_curve_comes_from_a_file_beside_the_actuator_file_or_from_lists(tmp_path):
    (tmp_path / "curves").mkdir()
    (tmp_path / "curves" / "steel.csv").write_text(CSV)
    (tmp_path / "rig.toml").write_text(rig('bh_curve = "curves/steel.csv"'))
    from_file = read_actuator(tmp_path / "rig.toml").fixed[0].material
    lists = "B_T = [0, 1.2, 1.5, 1.8]\nH_A_per_m = [0, 300, 2000, 12000]"
    assert from_file == actuator_from_toml(rig(lists)).fixed[0].material
    assert from_file == NonlinearMaterial("steel", (0.0, 1.2, 1.5, 1.8), (0.0, 300.0, 2000.0, 12000.0))
    assert hash(from_file) is not None
    assert from_file.relative_permeability == pytest.approx(1.2 / 300.0 / MU_0)


def test_a_curve_of_the_library_takes_another_conductivity():
    steel = actuator_from_toml(rig('bh_curve = "steel_1010"\nconductivity_MS_per_m = 5')).fixed[0].material
    known = LIBRARY["steel_1010"].material
    assert (steel.flux_density_T, steel.field_A_per_m) == (known.flux_density_T, known.field_A_per_m)
    assert steel.conductivity_S_per_m == 5e6


def test_columns_of_a_curve_file_are_found_by_name(tmp_path):
    (tmp_path / "steel.csv").write_text("H_A_per_m, B_T ,note\n0,0,start\n300,1.2,\n2000,1.5,\n")
    points, problems = read_bh_csv(tmp_path / "steel.csv")
    assert problems == []
    assert points == ((0.0, 1.2, 1.5), (0.0, 300.0, 2000.0))


MISTAKES = {
    'bh_curve = "nowhere.csv"': [
        "materials.steel.bh_curve must name a steel of the library or an existing file",
        "relative to the actuator file",
    ],
    'bh_curve = "."': ["materials.steel.bh_curve must name a readable text file"],
    'bh_curve = "header.csv"': ["must have the columns B_T,H_A_per_m", "'B,H'"],
    'bh_curve = "text.csv"': ["must hold two numbers a line; line 3 of text.csv is '1.2,much'"],
    'bh_curve = "falling.csv"': ["materials.steel.bh_curve must have strictly ascending B_T"],
    'bh_curve = "header.csv"\nB_T = [0, 1]': ["materials.steel must have one curve"],
    "B_T = [0, 1, 1.5]": ["materials.steel.H_A_per_m is missing"],
    "H_A_per_m = [0, 1, 1.5]": ["materials.steel.B_T is missing"],
    "B_T = [0, 1, 1.5]\nH_A_per_m = [0, 100]": ["materials.steel must have as many"],
    "B_T = [0, 1, 1.5]\nH_A_per_m = [0, 100, 1000]\nrelative_permeability = 5": [
        "materials.steel.relative_permeability is no known key"
    ],
    "B_T = [0, true]\nH_A_per_m = [0, 100, 1000]": ["materials.steel.B_T[1] must be a valid number"],
}


@pytest.mark.parametrize(("material", "fragments"), MISTAKES.items(), ids=MISTAKES.keys())
def test_a_wrong_curve_is_reported_with_its_path_and_remedy(material, fragments, tmp_path):
    (tmp_path / "header.csv").write_text("B,H\n0,0\n")
    (tmp_path / "text.csv").write_text("B_T,H_A_per_m\n0,0\n1.2,much\n")
    (tmp_path / "falling.csv").write_text("B_T,H_A_per_m\n0,0\n1.2,100\n1.1,200\n")
    (tmp_path / "rig.toml").write_text(rig(material))
    with pytest.raises(ActuatorFileError) as caught:
        read_actuator(tmp_path / "rig.toml")
    assert len(caught.value.problems) == 1
    for fragment in fragments:
        assert fragment in caught.value.problems[0]


def test_a_saturating_material_takes_no_magnetization():
    with pytest.raises(ActuatorFileError, match=r"magnetization must be left out; steel_1010 has no remanence"):
        actuator_from_toml(
            rig("relative_permeability = 5").replace("r_mm = [0, 6]", 'magnetization = "+z"\nr_mm = [0, 6]')
        )
