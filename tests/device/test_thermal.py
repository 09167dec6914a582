"""What materials are taken to conduct and to store."""

import pytest

from femfit.device.file_numbers import library_table
from femfit.device.load import actuator_from_toml
from femfit.device.materials import LIBRARY
from femfit.device.parts import LinearMaterial
from femfit.device.thermal import CERAMIC, MAGNET, PLASTIC, ThermalMaterial, thermal_of
from support.actuators import GEOMETRY

HANDBOOK = {  # W/(m K) and J/(m^3 K): F. P. Incropera and D. P. DeWitt, table A.1, at 300 K
    "copper": (401.0, 8933 * 385),
    "aluminium": (237.0, 2702 * 903),
    "steel_1010": (63.9, 7832 * 434),
    "steel_1018": (60.5, 7854 * 434),
}


@pytest.mark.parametrize("name", HANDBOOK)
def test_metals_are_near_the_handbook(name):
    """Wiedemann and Franz leave out what the lattice conducts: a fifth in steel."""
    found, (conductivity, capacity) = thermal_of(LIBRARY[name].material), HANDBOOK[name]
    assert found.conductivity_W_per_m_K == pytest.approx(conductivity, rel=0.35)
    assert found.heat_capacity_J_per_m3_K == pytest.approx(capacity, rel=0.03)


def test_the_kind_says_what_a_table_does_not():
    assert thermal_of(LinearMaterial("m", 1.05, -1.2)) == MAGNET
    assert thermal_of(LinearMaterial("f", 2000.0)) == CERAMIC
    assert thermal_of(LinearMaterial("p")) == PLASTIC


def test_a_material_of_the_file_may_say_its_own():
    own = "thermal_conductivity_W_per_m_K = 9\nheat_capacity_MJ_per_m3_K = 3.3\nworking_temperature_C = 60"
    text = (GEOMETRY / "emaws-rig.toml").read_text().replace("remanence_T = 1.45", f"remanence_T = 1.45\n{own}")
    known = actuator_from_toml(text).moving.regions[0].material.thermal
    assert known == ThermalMaterial(9.0, 3.3e6, 60.0)


@pytest.mark.parametrize("name", LIBRARY)
def test_a_material_of_the_library_written_into_a_file_keeps_what_is_known_of_it(name):
    table = library_table(name)
    known = LIBRARY[name].material.thermal
    assert table.get("working_temperature_C") == known.working_temperature_C
    capacity = table.get("heat_capacity_MJ_per_m3_K")
    assert (capacity and pytest.approx(capacity * 1e6)) == known.heat_capacity_J_per_m3_K
