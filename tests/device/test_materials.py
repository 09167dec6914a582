"""What materials do: how they saturate, conduct and store heat, in the library and in files of today and before."""

import numpy as np
import pytest

from femfit.core.numerics import MU_0
from femfit.device.drawn_numbers import numbers_from_toml
from femfit.device.load import actuator_from_toml, read_actuator, starter_text
from femfit.device.materials import LIBRARY, BHCurve, check_curve, without_flat_end
from femfit.device.parts import LinearMaterial, NonlinearMaterial
from femfit.device.rewrite import rewritten
from femfit.device.thermal import CERAMIC, MAGNET, PLASTIC, thermal_of
from support.actuators import GEOMETRY
from support.expected import unmentioned

SATURATING = [entry.material for entry in LIBRARY.values() if isinstance(entry.material, NonlinearMaterial)]
S_SHAPED = NonlinearMaterial("s-shaped", (0.0, 0.05, 0.6, 1.2, 1.5), (0.0, 100.0, 200.0, 800.0, 5000.0))
EVERYWHERE = np.linspace(0.0, 4.0, 40_001)
STARTER = starter_text("pot-magnet")


@pytest.fixture(params=[*SATURATING, S_SHAPED], ids=lambda material: material.name)
def material(request):
    return request.param


@pytest.fixture
def curve(material):
    return BHCurve(material.flux_density_T, material.field_A_per_m)


def test_a_curve_passes_through_its_points_and_rises_never_faster_than_in_air(curve, material):
    np.testing.assert_allclose(curve.field(np.array(material.flux_density_T)), material.field_A_per_m, rtol=1e-12)
    assert (np.diff(curve.field(EVERYWHERE)) > 0).all()
    slope = curve.differential_reluctivity(EVERYWHERE) * MU_0
    assert (slope > 0).all()
    # Between points a cubic whose secant is nu_0 may overshoot it; tables are rounded, too.
    assert slope.max() < 1.01


def test_slope_is_continuous_and_that_of_air_beyond_saturation(curve, material):
    kinks = np.array([*material.flux_density_T[1:], curve.saturated_T])
    below, above = (curve.differential_reluctivity(kinks + side) for side in (-1e-9, 1e-9))
    np.testing.assert_allclose(below, above, rtol=1e-4)
    beyond = curve.saturated_T + np.array([0.0, 0.5, 5.0])
    np.testing.assert_allclose(curve.differential_reluctivity(beyond), 1.0 / MU_0, rtol=1e-12)
    np.testing.assert_allclose(np.diff(curve.field(beyond)), np.diff(beyond) / MU_0, rtol=1e-9)


def test_energy_is_the_integral_of_the_field_and_reluctivity_its_share_down_to_zero(curve, material):
    b = np.linspace(0.0, 3.5, 200_001)
    h = curve.field(b)
    integral = np.concatenate([[0.0], np.cumsum(0.5 * (h[1:] + h[:-1]) * np.diff(b))])
    np.testing.assert_allclose(curve.energy_density(b), integral, rtol=1e-6, atol=1e-6 * integral[-1] / len(b))
    at_zero = curve.reluctivity(np.zeros(1))
    assert at_zero == pytest.approx(material.field_A_per_m[1] / material.flux_density_T[1])
    assert at_zero == pytest.approx(curve.reluctivity(np.array([1e-9])), rel=1e-6)
    np.testing.assert_allclose(curve.reluctivity(EVERYWHERE) * EVERYWHERE, curve.field(EVERYWHERE), rtol=1e-14)


def test_a_published_curve_that_ends_a_little_below_mu_0_is_cut_and_it_is_said():
    b, h = (0.0, 1.5, 1.9, 2.1), (0.0, 1e3, 2e4, 1e5)
    beyond = tuple(2.1 + k * 0.9 * MU_0 * 1e5 for k in (1, 2)), (2e5, 3e5)
    points, remark = without_flat_end(b + beyond[0], h + beyond[1])
    assert points == (b, h)
    check_curve(*points, "steel", problems := [])
    assert not problems
    assert not unmentioned(["2.1 T", "0.9 mu_0"], remark)
    assert without_flat_end(b, h) == ((b, h), "")


def test_curves_of_the_library_obey_the_rules_and_the_data_sheet_and_can_be_keys():
    for material in SATURATING:
        check_curve(material.flux_density_T, material.field_A_per_m, material.name, problems := [])
        assert not problems
        assert hash(material) is not None
        first = material.flux_density_T[1] / material.field_A_per_m[1]
        assert material.relative_permeability == pytest.approx(first / MU_0)
    ferrite = LIBRARY["ferrite_k10"].material
    assert ferrite.relative_permeability == pytest.approx(800.0, rel=0.02)  # its first point is at 5 A/m
    assert (ferrite.flux_density_T[-1], ferrite.field_A_per_m[-1]) == (0.2848, 2027.0)


# Conductivity in MS/m, from resistivities in nOhm m: copper 17.2, aluminium and its alloys 26.5 to 53, carbon steels
# 130 to 200, NdFeB 1300 to 1800, SmCo 860; in W/(m K) and J/(m^3 K): F. P. Incropera and D. P. DeWitt, table A.1
CONDUCTS = {
    "copper": (58.0, 58.1),
    "aluminium": (19.0, 37.8),
    **dict.fromkeys(("low_carbon_steel", "steel_1010", "steel_1018", "steel_ss400"), (5.0, 7.7)),
    **{name: (1 / 1.8, 1 / 1.3) for name in LIBRARY if name.startswith("n")},
    "smco26": (1.0, 1.3),
    **dict.fromkeys(("air", "soft_ferrite", "ferrite_k10", "ferrite_y30"), (0.0, 0.0)),
}
HANDBOOK = {
    "copper": (401.0, 8933 * 385),
    "aluminium": (237.0, 2702 * 903),
    "steel_1010": (63.9, 7832 * 434),
    "steel_1018": (60.5, 7854 * 434),
}


def test_the_library_is_as_handbooks_say_and_names_its_sources():
    assert CONDUCTS.keys() == LIBRARY.keys()
    for name, (low, high) in CONDUCTS.items():
        material, reference = LIBRARY[name].material, LIBRARY[name].reference
        assert low <= 1e-6 * material.conductivity_S_per_m <= high
        assert (material.name, material.lamination_m) == (name, 0.0)
        assert material.relative_permeability >= 1
        assert 0 <= material.remanence_T < 1.6  # the highest NdFeB grade reaches about 1.5 T
        assert len(reference) > 20
        assert ("onductivity" in reference) == (name != "air")
    grades = [entry.material.remanence_T for name, entry in LIBRARY.items() if name.startswith("n")]
    assert len(grades) == 8
    assert grades == sorted(grades)


def test_metals_conduct_heat_as_handbooks_say_and_the_kind_says_what_a_table_does_not():
    for name, (conductivity, capacity) in HANDBOOK.items():
        usual = thermal_of(LIBRARY[name].material)
        # Wiedemann and Franz leave out what the lattice conducts: a fifth in steel
        assert usual.conductivity_W_per_m_K == pytest.approx(conductivity, rel=0.35)
        assert usual.heat_capacity_J_per_m3_K == pytest.approx(capacity, rel=0.03)
    kinds = LinearMaterial("m", 1.05, -1.2), LinearMaterial("f", 2000.0), LinearMaterial("p")
    assert [thermal_of(kind) for kind in kinds] == [MAGNET, CERAMIC, PLASTIC]


def test_a_material_of_the_file_goes_before_one_of_the_library():
    assert read_actuator(GEOMETRY / "emaws.toml").moving.regions[0].material.remanence_T == 1.45
    assert LIBRARY["n52"].material.remanence_T != 1.45


@pytest.mark.parametrize("name", LIBRARY)
def test_a_material_of_the_library_written_into_a_file_is_the_same_material(name):
    material = LIBRARY[name].material
    lines = [f"[materials.{name}]", *(f"{key} = {value}" for key, value in LIBRARY[name].table.items())]
    lines += ["[fixed.regions.pot]", *['magnetization = "+z"'] * bool(material.remanence_T), f'material = "{name}"']
    text = STARTER.replace('[fixed.regions.pot]\nmaterial = "solid_steel"', "\n".join(lines))
    assert actuator_from_toml(text).fixed[0].material == material


def test_numbers_of_a_field_at_rest_are_without_conductivities():
    static, every = ([one.facts for one in numbers_from_toml(STARTER, harmonic=harmonic)] for harmonic in (False, True))
    assert static == [one for one in every if one.kind not in ("conductivity", "lamination")]
    assert {one.key for one in every} - {one.key for one in static} == {"materials.solid_steel.conductivity_MS_per_m"}


def test_conductivity_and_thickness_of_sheets_are_numbers_of_the_drawing():
    drawn = "conductivity_MS_per_m = 6 # at 20 degC; lamination_mm = 0.5 would be a stack of radial sheets"
    text = STARTER.replace(drawn, "conductivity_MS_per_m = 2\nlamination_mm = 0.5")
    text += '\n[tolerances]\n"materials.solid_steel.lamination_mm" = 0.01\n'
    numbers = {one.facts.key.split(".")[-1]: one for one in numbers_from_toml(text, harmonic=True)}
    sheets, conductivity = numbers["lamination_mm"], numbers["conductivity_MS_per_m"]
    assert (sheets.facts.value, sheets.facts.tolerance) == (0.5, pytest.approx(0.02))
    assert (conductivity.facts.value, conductivity.facts.tolerance) == (2.0, 0.1)
    assert "solid_steel" in conductivity.facts.subject
    better, thinner = conductivity.larger.fixed[0].material, sheets.smaller.moving.regions[0].material
    assert better.conductivity_S_per_m == pytest.approx(2e6 * (1 + conductivity.step), rel=1e-12)
    assert thinner.lamination_m == pytest.approx(0.5e-3 * (1 - sheets.step), rel=1e-12)
    text = rewritten(text, [(conductivity.facts, 2.5), (sheets.facts, 0.48)], "pot")
    material = actuator_from_toml(text).fixed[0].material
    assert (material.conductivity_S_per_m, material.lamination_m) == (2.5e6, 0.48e-3)
