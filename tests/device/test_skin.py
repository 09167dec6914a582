"""Sheets that the field does not enter evenly are named with the frequency up to which they are thin."""

import pytest

from femfit.device.load import actuator_from_toml
from femfit.device.parts import skin_depth
from femfit.device.summary import remarks
from support.eddy_pot import POT
from support.expected import unmentioned

IRON = "relative_permeability = 200\nconductivity_MS_per_m = 5"


def said_of_sheets(thickness_mm):
    sheets = actuator_from_toml(POT.replace(IRON, f"{IRON}\nlamination_mm = {thickness_mm}"))
    return [one for one in remarks(sheets) if "sheets" in one]


def test_copper_has_a_skin_depth_of_9_35_mm_at_50_hz():
    text = POT.replace(IRON, "relative_permeability = 1\nconductivity_MS_per_m = 58")
    copper = actuator_from_toml(text).fixed[0].material
    assert skin_depth(copper, 50.0) == pytest.approx(9.346e-3, rel=1e-3)


def test_sheets_above_the_skin_depth_are_named_and_thin_ones_are_not():
    """The skin depth of the pot's iron is 0.503 mm at 1 kHz."""
    assert said_of_sheets(0.5) == []
    (said,) = said_of_sheets(5)
    assert not unmentioned(["iron", "0.50 mm", "1.0 kHz", "10 Hz"], said)


def test_sheets_at_rest_are_not_named():
    text = POT.replace(IRON, f"{IRON}\nlamination_mm = 5").split("[solver]")[0]
    assert not any("sheets" in one for one in remarks(actuator_from_toml(text)))
