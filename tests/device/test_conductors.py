"""What conducts is a number of a drawing where its field changes with time, and stays where a curve is calibrated."""

import numpy as np
import pytest

from femfit.device.drawn_numbers import numbers_from_toml
from femfit.device.load import actuator_from_toml, starter_text
from femfit.device.materials import LIBRARY
from femfit.device.rewrite import rewritten
from support.actuators import GEOMETRY

POT = starter_text("pot-magnet")
CONDUCTIVITY = "conductivity_MS_per_m = 6 # at 20 degC; lamination_mm = 0.5 would be a stack of radial sheets"


@pytest.mark.parametrize("name", ["pot-magnet", "relay", "voice-coil", "bearing", "emaws-rig", "emaws-saturable"])
def test_numbers_of_a_field_at_rest_are_without_conductivities(name):
    path = GEOMETRY / f"{name}.toml"
    text = path.read_text() if path.exists() else starter_text(name)
    static = [one.facts for one in numbers_from_toml(text, directory=GEOMETRY)]
    every = [one.facts for one in numbers_from_toml(text, directory=GEOMETRY, harmonic=True)]
    assert static == [one for one in every if one.kind not in ("conductivity", "lamination")]
    actuator = actuator_from_toml(text, directory=GEOMETRY)
    materials = {one.material.name: one.material for one in (*actuator.fixed, *actuator.moving.regions)}
    conducting = {name for name, material in materials.items() if material.conductivity_S_per_m}
    assert {one.key for one in every} - {one.key for one in static} == {
        f"materials.{name}.conductivity_MS_per_m" for name in conducting
    }


def test_conductivity_and_thickness_of_sheets_are_numbers_of_the_drawing():
    lines = "conductivity_MS_per_m = 2\nlamination_mm = 0.5"
    text = POT.replace(CONDUCTIVITY, lines) + '\n[tolerances]\n"materials.solid_steel.lamination_mm" = 0.01\n'
    numbers = {one.facts.key: one for one in numbers_from_toml(text, harmonic=True)}
    sheets, conductivity = (
        numbers[f"materials.solid_steel.{key}"] for key in ("lamination_mm", "conductivity_MS_per_m")
    )
    assert (sheets.facts.value, sheets.facts.tolerance) == (0.5, pytest.approx(0.02))
    assert (conductivity.facts.value, conductivity.facts.tolerance) == (2.0, 0.1)
    assert "solid_steel" in conductivity.facts.subject
    material = conductivity.larger.fixed[0].material
    assert material.conductivity_S_per_m == pytest.approx(2e6 * (1 + conductivity.step), rel=1e-12)
    assert sheets.smaller.moving.regions[0].material.lamination_m == pytest.approx(
        0.5e-3 * (1 - sheets.step), rel=1e-12
    )
    text = rewritten(text, [(conductivity.facts, 2.5), (sheets.facts, 0.48)], "pot")
    assert (actuator_from_toml(text).fixed[0].material.conductivity_S_per_m) == 2.5e6
    assert (actuator_from_toml(text).fixed[0].material.lamination_m) == 0.48e-3


def test_a_library_steel_whose_curve_is_calibrated_still_conducts():
    text = POT.replace('material = "solid_steel"', 'material = "steel_1010"')
    (curve,) = (one.facts for one in numbers_from_toml(text) if one.facts.key == "materials.steel_1010.H_A_per_m")
    material = actuator_from_toml(rewritten(text, [(curve, 0.9)], "pot")).fixed[0].material
    library = LIBRARY["steel_1010"].material
    assert material.conductivity_S_per_m == library.conductivity_S_per_m
    np.testing.assert_allclose(material.field_A_per_m, 0.9 * np.array(library.field_A_per_m), rtol=1e-8)
