"""A magnet's remanence at its temperature."""

import pytest

from femfit.core.errors import ActuatorFileError
from femfit.device.load import actuator_from_toml
from femfit.device.materials import LIBRARY
from support.actuators import GEOMETRY

TEXT = (GEOMETRY / "emaws-rig.toml").read_text(encoding="utf-8")
OWN = "remanence_T = 1.45"


def magnet(temperature, coefficient="", direction="+z"):
    text = TEXT.replace('magnetization = "+z"', f'magnetization = "{direction}"\n{temperature}')
    return actuator_from_toml(text.replace(OWN, f"{OWN}\n{coefficient}")).moving.regions[0].material


def test_a_hot_magnet_is_weaker_by_its_coefficient():
    assert magnet("temperature_C = 80", "remanence_coefficient_per_K = -0.0012").remanence_T == pytest.approx(
        1.45 * (1.0 - 0.0012 * 60.0)
    )
    turned = magnet("temperature_C = 80", "remanence_coefficient_per_K = -0.0012", "-z")
    assert turned.remanence_T == pytest.approx(-1.45 * (1.0 - 0.0012 * 60.0))


def test_values_hold_at_20_degrees():
    given = magnet("temperature_C = 20", "remanence_coefficient_per_K = -0.0012")
    assert given.remanence_T == magnet("").remanence_T == 1.45


def test_every_neodymium_grade_of_the_library_loses_twelve_hundredths_of_a_per_cent_a_kelvin():
    for name in ("n35", "n42", "n52"):
        cold, hot = (LIBRARY[name].material.at_temperature(t).remanence_T for t in (20.0, 30.0))
        assert hot / cold == pytest.approx(0.988)


def test_samarium_cobalt_has_the_coercive_field_of_its_entry_and_loses_little():
    material = LIBRARY["smco26"].material
    assert material.remanence_T * material.reluctivity == pytest.approx(758741, rel=1e-3)
    assert material.at_temperature(120.0).remanence_T == pytest.approx(0.97 * material.remanence_T)


@pytest.mark.parametrize(
    ("temperature", "coefficient", "message"),
    [
        ("temperature_C = 80", "", "temperature_C must be left out.*no remanence_coefficient_per_K"),
        ("temperature_C = 400", "remanence_coefficient_per_K = -0.004", "temperature_C must leave a remanence"),
        ("temperature_C = 900", "remanence_coefficient_per_K = -0.001", "temperature_C must be at most 500"),
        ("", "remanence_coefficient_per_K = -0.12", "remanence_coefficient_per_K must be at least -0.02"),
    ],
)
def test_a_temperature_that_means_nothing_is_refused(temperature, coefficient, message):
    with pytest.raises(ActuatorFileError, match=message):
        magnet(temperature, coefficient)
