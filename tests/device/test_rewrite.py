"""A drawing written with other numbers: comments and layout stay, and the numbers are those that were asked for."""

import pytest

from femfit.device.drawn_numbers import numbers_from_toml
from femfit.device.load import actuator_from_toml
from femfit.device.rewrite import rewritten
from support.actuators import GEOMETRY
from support.small_drawing import SMALL

RIG = (GEOMETRY / "emaws-rig.toml").read_text()


def number_of(text, key, directory=None):
    (facts,) = (one.facts for one in numbers_from_toml(text, "text", directory) if one.facts.key == key)
    return facts


def test_only_the_lines_of_changed_numbers_change_and_keep_their_comments():
    values = {"moving.regions.magnet.z_mm[1]": 5.148, "materials.ferrite.relative_permeability": 431.2}
    text = rewritten(RIG, [(number_of(RIG, key), value) for key, value in values.items()], "rig")
    changed = [new for old, new in zip(RIG.splitlines(), text.splitlines(), strict=True) if old != new]
    assert changed == ["relative_permeability = 431.2 # Table 1", "z_mm = [0, 5.148]"]
    numbers = [one.facts for one in numbers_from_toml(RIG, "rig")]
    assert rewritten(RIG, [(n, n.value) for n in numbers], "rig") == RIG
    windows = SMALL.replace("\n", "\r\n")
    text = rewritten(windows, [(number_of(windows, "moving.regions.magnet.r_mm[1]"), 4.02)], "small")
    assert text == windows.replace("r_mm = [0, 4]", "r_mm = [0, 4.02]")


def test_a_material_of_the_library_gets_a_table_of_its_own():
    library = SMALL.replace("[materials.hard]\nremanence_T = 1.2\nrelative_permeability = 1.05\n", "")
    library = library.replace('material = "hard"', 'material = "N42"').replace('"N42"', '"n42"')
    text = rewritten(library, [(number_of(library, "materials.n42.relative_permeability"), 1.07)], "small")
    material = actuator_from_toml(text).moving.regions[0].material
    assert (material.relative_permeability, material.remanence_T) == (1.07, 1.312)


@pytest.mark.parametrize("material", ["hard", "n42"], ids=["in the file", "of the library"])
def test_a_warm_magnets_remanence_is_written_as_it_is_at_20_degrees(material):
    """The number is that of the warm magnet, since the field is solved with it; the file's is not."""
    text = SMALL.replace("remanence_T = 1.2", "remanence_T = 1.2\nremanence_coefficient_per_K = -0.0012")
    text = text.replace('material = "hard"', f'material = "{material}"\ntemperature_C = 100')
    before = actuator_from_toml(text).moving.regions[0].material
    assert before.remanence_T < 0.95 * (1.2 if material == "hard" else 1.312)
    number = number_of(text, f"materials.{material}.remanence_T")
    after = actuator_from_toml(rewritten(text, [(number, 1.03 * number.value)], "small")).moving.regions[0].material
    assert after.remanence_T == pytest.approx(1.03 * before.remanence_T, rel=1e-8)
    assert number.value == pytest.approx(before.remanence_T, rel=1e-12)


LISTS = "B_T = [0, 1.0, 1.5, 1.8] # own\nH_A_per_m = [0, 200, 2000, 20000]"


@pytest.mark.parametrize(
    ("curve", "name", "axis"),
    [(LISTS, "iron", "H_A_per_m"), ('bh_curve = "steel.csv"', "iron", "B_T"), (LISTS, "steel_1010", "H_A_per_m")],
    ids=["lists", "file", "library"],
)
def test_a_curve_is_scaled_as_a_whole_and_written_into_the_drawing(tmp_path, curve, name, axis):
    text = SMALL.replace("relative_permeability = 500", curve)
    text = text.replace('"materials.iron.relative_permeability" = 50', "")
    if name != "iron":
        text = text.replace(f"[materials.iron]\n{curve}\n", "").replace('material = "iron"', f'material = "{name}"')
    (tmp_path / "steel.csv").write_text("B_T,H_A_per_m\n0,0\n1,200\n1.5,2000\n1.8,20000\n")
    before = actuator_from_toml(text, directory=tmp_path).fixed[0].material
    after = rewritten(text, [(number_of(text, f"materials.{name}.{axis}", tmp_path), 1.1)], "small", tmp_path)
    assert "steel.csv" not in after
    assert ("# own" in after) == ("# own" in text)
    material = actuator_from_toml(after).fixed[0].material
    kept = len(material.field_A_per_m)  # one that rises with less than mu_0 is cut there when it is read
    assert kept > 0.8 * len(before.field_A_per_m)
    b_factor, h_factor = (1.1, 1.0) if axis == "B_T" else (1.0, 1.1)
    assert material.flux_density_T == pytest.approx([b_factor * b for b in before.flux_density_T[:kept]])
    assert material.field_A_per_m == pytest.approx([h_factor * h for h in before.field_A_per_m[:kept]])
