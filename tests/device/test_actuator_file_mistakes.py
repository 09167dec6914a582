"""Each mistake of an actuator file has a message with its key path and remedy; all come at once."""

import pickle
from pathlib import Path

import pytest

from femfit.core.errors import ActuatorFileError, FemfitError
from femfit.device.load import actuator_from_toml, read_actuator

VALID = """\
schema = 1
name = "test-rig"
description = "A small rig"

[materials.iron]
relative_permeability = 450

[materials.magnet]
remanence_T = 1.2
relative_permeability = 1.05

[electromagnet.regions.flange]
material = "iron"
r_mm = [2.5, 20]
z_mm = [-5, 0]

[electromagnet.regions.sleeve]
material = "iron"
polygon_mm = [[2.5, -20], [10, -20], [10, -5], [2.5, -5]]

[coil]
r_mm = [10, 20]
z_mm = [-20, -5]
turns = 308
wire_diameter_mm = 0.49
resistance_ohm = 2.69

[moving]
mass_g = 4.35

[moving.regions.disc]
material = "magnet"
magnetization = "+z"
r_mm = [0, 5.5]
z_mm = [0, 5]

[hall]
r_mm = 0
z_mm = 0
adc_bits = 12

[supply]
voltage_min_V = 0.5
voltage_max_V = 3.0

[sweep]
current_A = [0, 0.5, 1]
distance_mm = { start = 15, stop = 45, step = 0.5 }

[reference]
distance_mm = [22, 30, 22]
"""

MISTAKES = {
    # what: (text, replacement, every fragment that the only problem's line must hold)
    "unknown top-level key": ('name = "test-rig"', 'name = "a"\nnane = 2', ["nane is no known key", "'name'"]),
    "unknown table": ("[reference]", "[sweeep]\n[reference]", ["sweeep is no known key", "'sweep'"]),
    "unknown key": (
        "turns = 308",
        "turns = 308\nturnz = 3",
        ["coil.turnz is no known key", "'turns'", "resistance_ohm"],
    ),
    "unknown key in brackets": ("[reference]", '"<x>" = 1\n[reference]', ["sweep.'<x>' is no known key"]),
    "unknown key of a region": ("z_mm = [0, 5]", "z_mm = [0, 5]\nsize = 1", ["moving.regions.disc.size is no known"]),
    "unknown key of a range": ("step = 0.5", "step = 0.5, n = 3", ["sweep.distance_mm.n is no known key"]),
    "missing schema": ("schema = 1", "", ["schema is missing", "schema = 2"]),
    "schema zero": ("schema = 1", "schema = 0", ["schema must be at least 1", "it is 0"]),
    "schema as text": ("schema = 1", 'schema = "1"', ["schema must be a valid integer", "'1'"]),
    "missing name": ('name = "test-rig"', "", ["name is missing"]),
    "name with a path": ('"test-rig"', '"../x"', ["name must match", "'../x'", "letters"]),
    "missing section": ("[supply]\nvoltage_min_V = 0.5\nvoltage_max_V = 3.0", "", ["supply is missing", "[supply]"]),
    "section of the wrong type": ("[hall]\nr_mm = 0\nz_mm = 0\nadc_bits = 12", "[[hall]]", ["hall must be a table"]),
    "missing turns": ("turns = 308\n", "", ["coil.turns is missing", "number of turns"]),
    "coil without turns": ("turns = 308", "turns = 0", ["coil.turns must be at least 1", "it is 0"]),
    "negative turns": ("turns = 308", "turns = -3", ["coil.turns must be at least 1", "it is -3"]),
    "text for a number": ("turns = 308", 'turns = "308"', ["coil.turns must be a valid number", "'308'"]),
    "truth value for a number": ("turns = 308", "turns = true", ["coil.turns must be a valid number", "True"]),
    "nan": ("turns = 308", "turns = nan", ["coil.turns must be a finite number", "nan"]),
    "infinite length": ("z_mm = [0, 5]", "z_mm = [0, inf]", ["moving.regions.disc.z_mm[1]", "finite", "inf"]),
    "nan in a list": ("[0, 0.5, 1]", "[0, nan, 1]", ["sweep.current_A[1] must be a finite number"]),
    "three numbers for a range": ("z_mm = [0, 5]", "z_mm = [0, 5, 6]", ["moving.regions.disc.z_mm", "at most 2"]),
    "half a polygon": ("[10, -5], [2.5, -5]]", "]", ["sleeve.polygon_mm", "at least 3"]),
    "polygon corner with one number": ("[10, -5]", "[10]", ["sleeve.polygon_mm[2]", "at least 2"]),
    "no outline": ("r_mm = [10, 20]\n", "", ["coil must have an outline", "r_mm missing"]),
    "two outlines": ("polygon_mm = ", "r_mm = [1, 2]\npolygon_mm = ", ["sleeve must have either", "has both"]),
    "range reversed": ("r_mm = [10, 20]", "r_mm = [20, 10]", ["coil.r_mm must ascend", "[20, 10]"]),
    "region without height": ("z_mm = [-5, 0]", "z_mm = [-5, -5]", ["flange.z_mm must ascend", "[-5, -5]"]),
    "polygon without area": (
        "[[2.5, -20], [10, -20], [10, -5], [2.5, -5]]",
        "[[2.5, -20], [2.5, -10], [2.5, -5]]",
        ["sleeve.polygon_mm must enclose an area"],
    ),
    "polygon that crosses itself": (
        "[10, -20], [10, -5], [2.5, -5]]",
        "[10, -5], [10, -20], [2.5, -5]]",
        ["sleeve.polygon_mm must not cross", "Self-intersection"],
    ),
    "polygon of two corners closed": (
        "[[2.5, -20], [10, -20], [10, -5], [2.5, -5]]",
        "[[2.5, -20], [10, -20], [2.5, -20]]",
        ["sleeve.polygon_mm must have at least 3 corners", "it has 2"],
    ),
    "current beyond all bounds": ("[0, 0.5, 1]", "[0, 0.5, 1e300]", ["sweep.current_A[2]", "at most"]),
    "corner given twice": ("[10, -20], ", "[10, -20], [10, -20], ", ["sleeve.polygon_mm[2] must differ"]),
    "region across the axis": ("r_mm = [0, 5.5]", "r_mm = [-5.5, 5.5]", ["disc.r_mm must have r >= 0", "-5.5"]),
    "polygon that touches the axis in a point": (
        "r_mm = [0, 5.5]\nz_mm = [0, 5]",
        "polygon_mm = [[0, 2], [5, 0], [5, 5]]",
        ["disc.polygon_mm must meet the axis in a whole edge", "single point"],
    ),
    "coil on the axis": (
        "[hall]\nr_mm = 0\nz_mm = 0\nadc_bits = 12",
        "",
        ["coil must lie off the axis"],
    ),
    "foil that cannot be meshed": (
        "z_mm = [0, 5]",
        "z_mm = [0, 0.001]",
        ["moving.regions.disc must be at least 1/1000 as thick", "0.001 mm by 5.5 mm", "at least 0.0055 mm"],
    ),
    "overlapping fixed regions": (
        "[10, -5], [2.5, -5]]",
        "[10, -4], [2.5, -4]]",
        ["flange and electromagnet.regions.sleeve must not overlap", "7.5 mm^2", "r_mm [2.5, 10], z_mm [-5, -4]"],
    ),
    "coil in the iron": ("z_mm = [-20, -5]", "z_mm = [-20, -3]", ["flange and coil must not overlap", "20 mm^2"]),
    "unknown material": ('"magnet"\nm', '"magnit"\nm', ["disc.material", "'magnit'", "mean 'magnet'", "iron", "n52"]),
    "invalid material": (
        "relative_permeability = 450",
        "mu = 450\nrelative_permeability = 4",
        ["materials.iron.mu is no"],
    ),
    "permeability of zero": (
        "= 450",
        "= 0",
        ["materials.iron.relative_permeability must be at least 0.000001"],
    ),
    "remanence in gauss": ("= 1.2", "= 12000", ["materials.magnet.remanence_T", "at most 3", "10 kG"]),
    "magnet without direction": ('magnetization = "+z"\n', "", ["disc.magnetization is missing", '"+z"']),
    "unknown direction": ('"+z"', '"north"', ["disc.magnetization", "'+z' or '-z'", "'north'"]),
    "iron with a direction": (
        'material = "iron"\nr_mm',
        'material = "iron"\nmagnetization = "+z"\nr_mm',
        ["flange.magnetization must be left out", "no remanence"],
    ),
    "region called coil": ("regions.disc]", "regions.coil]", ["moving.regions.coil must be named"]),
    "region with a blank": ("regions.disc]", 'regions."my disc"]', ["moving.regions.'my disc' must be named"]),
    "the same name twice": ("regions.disc]", "regions.sleeve]", ["moving.regions.sleeve must have a name of its own"]),
    "wire that does not fit": ("= 0.49", "= 0.9", ["coil.wire_diameter_mm", "308 turns of 0.9 mm", "150 mm^2"]),
    "neither wire nor resistance": (
        "wire_diameter_mm = 0.49\nresistance_ohm = 2.69",
        "",
        ["coil.resistance_ohm is missing, and so is wire_diameter_mm"],
    ),
    "no mass": ("mass_g = 4.35", "mass_g = 0", ["moving.mass_g must be at least 0.000001"]),
    "empty moving part": (
        '[moving.regions.disc]\nmaterial = "magnet"\nmagnetization = "+z"\nr_mm = [0, 5.5]\nz_mm = [0, 5]',
        "regions = {}",
        ["moving.regions must hold a part"],
    ),
    "nothing that feels a force": (
        'material = "magnet"\nmagnetization = "+z"',
        'material = "copper"',
        ["moving.regions must hold a magnet or something permeable", "copper"],
    ),
    "moving part in two pieces": (
        "[hall]",
        '[moving.regions.tip]\nmaterial = "iron"\nr_mm = [0, 1]\nz_mm = [6, 7]\n[hall]',
        ["moving.regions must touch each other", "2 separate bodies"],
    ),
    "moving part drawn in its place": ("z_mm = [0, 5]", "z_mm = [15, 20]", ["moving must have its nearest", "z_mm 15"]),
    "electromagnet drawn elsewhere": (
        "[2.5, 20]\nz_mm = [-5, 0]",
        "[2.5, 20]\nz_mm = [-5, -1]",
        ["electromagnet must have its face at z = 0", "-20 to -1"],
    ),
    "voltages reversed": (
        "voltage_min_V = 0.5",
        "voltage_min_V = 5",
        ["supply.voltage_min_V must be below", "5 and 3"],
    ),
    "currents not ascending": ("[0, 0.5, 1]", "[0, 1, 0.5]", ["sweep.current_A must be ascending", "0.5 follows 1"]),
    "current twice": ("[0, 0.5, 1]", "[0, 0.5, 0.5]", ["sweep.current_A must be ascending", "0.5 repeats 0.5"]),
    "no currents": ("[0, 0.5, 1]", "[]", ["sweep.current_A", "at least 1"]),
    "axis as text": ("[0, 0.5, 1]", '"0..1"', ["sweep.current_A must be a list of numbers or a table", "'0..1'"]),
    "step that does not divide": (
        "step = 0.5",
        "step = 0.7",
        ["sweep.distance_mm", "0.7 does not divide 15 to 45", "45.1"],
    ),
    "step of zero": ("step = 0.5", "step = 0", ["sweep.distance_mm.step must be greater than 0"]),
    "range without stop": ("stop = 45, ", "", ["sweep.distance_mm.stop is missing"]),
    "range reversed in the sweep": ("stop = 45", "stop = 5", ["sweep.distance_mm must have stop > start"]),
    "too many points": ("step = 0.5", "step = 1e-9", ["sweep.distance_mm must have at most 10000 values"]),
    "distance zero": ("start = 15", "start = 0", ["sweep.distance_mm must be > 0", "starts at 0"]),
    "reference outside of the sweep": (
        "[22, 30, 22]",
        "[22, 50]",
        ["reference.distance_mm", "15 to 45", "50 is outside"],
    ),
    "sensor in the iron": ("r_mm = 0\nz_mm = 0", "r_mm = 4\nz_mm = -2", ["hall must lie outside", "regions.flange"]),
    "sensor in the winding": (
        "r_mm = 0\nz_mm = 0",
        "r_mm = 15\nz_mm = -9",
        ["hall must lie outside", "inside of coil"],
    ),
    "sensor in the way": ("r_mm = 0\nz_mm = 0", "r_mm = 0\nz_mm = 16", ["hall must lie out of the moving part's way"]),
    "sensor beyond its radius": (
        "r_mm = 0\nz_mm = 0",
        "r_mm = -1\nz_mm = 0",
        ["hall.r_mm", "at least 0"],
    ),
    "bits as a fraction": ("adc_bits = 12", "adc_bits = 12.5", ["hall.adc_bits must be a valid integer", "12.5"]),
    "sensor that sees nothing": (
        "adc_bits = 12",
        "sensitivity_V_per_T = 0",
        ["hall.sensitivity_V_per_T must not be 0"],
    ),
    "sensor range reversed": ("adc_bits = 12", "output_max_V = -1", ["hall.output_min_V must be below", "0 and -1"]),
    "sensor at rest beyond its range": ("adc_bits = 12", "quiescent_V = 6", ["hall.quiescent_V must lie between"]),
}
EXTRA_CHANGES = {
    # The coil reaches the axis only once the parts in its way are gone.
    "coil on the axis": [
        ("r_mm = [10, 20]\nz_mm = [-20, -5]", "r_mm = [0, 20]\nz_mm = [-40, -20]"),
    ],
}


def problems_of(text: str) -> tuple[str, ...]:
    with pytest.raises(ActuatorFileError) as caught:
        actuator_from_toml(text, "test.toml")
    return caught.value.problems


def changed(old: str, new: str, text: str = VALID) -> str:
    assert text.count(old) == 1, f"{old!r} must occur once"
    return text.replace(old, new)


def test_the_file_without_mistakes_loads():
    actuator = actuator_from_toml(VALID)
    assert (actuator.name, len(actuator.fixed), len(actuator.moving.regions)) == ("test-rig", 2, 1)


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_the_only_problem_and_says_where_and_what_to_do(mistake):
    old, new, fragments = MISTAKES[mistake]
    text = changed(old, new)
    for change in EXTRA_CHANGES.get(mistake, []):
        text = changed(*change, text)
    (problem,) = problems_of(text)
    for fragment in fragments:
        assert fragment in problem
    # A problem ends with its remedy: one more sentence.
    assert problem.endswith((".", "?"))
    assert ". " in problem


PLUNGER = (Path(__file__).parents[2] / "geometry" / "plunger-solenoid.toml").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("old", "new", "fragments"),
    [
        # The plunger is 10 mm wide; 0 mm of clearance touches, -0.5 mm enters the plate, both at every distance.
        ("r_mm = [5.5, 15]", "r_mm = [5, 15]", ["regions.plunger", "regions.upper_plate", "first at 0.5 mm"]),
        ("r_mm = [5.5, 15]", "r_mm = [4.5, 15]", ["regions.plunger", "regions.upper_plate", "first at 0.5 mm"]),
        # A lid from 41.2 mm on meets the 35 mm plunger once the distance reaches 6.2 mm: 6.5 mm is the next point.
        (
            "[coils.coil]",
            '[fixed.regions.lid]\nmaterial = "low_carbon_steel"\nr_mm = [0, 5]\nz_mm = [41.2, 42]\n[coils.coil]',
            ["regions.plunger collides with fixed.regions.lid first at 6.5 mm"],
        ),
    ],
)
def test_a_collision_names_both_parts_and_the_first_distance(old, new, fragments):
    (problem,) = problems_of(changed(old, new, PLUNGER))
    for fragment in fragments:
        assert fragment in problem


def test_a_collision_between_two_swept_distances_is_found():
    # A 0.1 mm foil in the way of a 0.1 mm disc: at 1 and 2 mm they are apart.
    text = changed("z_mm = [0, 5]", "z_mm = [0, 0.1]")
    text = changed("{ start = 15, stop = 45, step = 0.5 }", "[1, 2]", text)
    text = changed("[reference]\ndistance_mm = [22, 30, 22]", "", text)
    text = changed(
        "[coil]", '[electromagnet.regions.foil]\nmaterial = "iron"\nr_mm = [0, 5]\nz_mm = [1.4, 1.5]\n[coil]', text
    )
    (problem,) = problems_of(text)
    assert "disc collides with electromagnet.regions.foil between two swept distances" in problem


def test_all_mistakes_are_reported_at_once_and_none_hides_another():
    text = VALID
    for mistake in (
        "unknown top-level key",
        "unknown key",
        "magnet without direction",
        "region without height",
        "no mass",
        "voltages reversed",
        "current twice",
        "reference outside of the sweep",
        "wire that does not fit",
        "bits as a fraction",
    ):
        old, new, _ = MISTAKES[mistake]
        text = changed(old, new, text)
    problems = "\n".join(problems_of(text))
    for path in (
        "nane is",
        "coil.turnz is",
        "disc.magnetization is",
        "flange.z_mm must ascend",
        "moving.mass_g must",
        "supply.voltage_min_V must",
        "sweep.current_A must",
        "reference.distance_mm must",
        "coil.wire_diameter_mm must",
        "hall.adc_bits must",
    ):
        assert path in problems


def test_geometry_is_checked_although_keys_are_wrong():
    text = changed("turns = 308", "turnz = 308", changed("[10, -5], [2.5, -5]]", "[10, -4], [2.5, -4]]"))
    problems = "\n".join(problems_of(text))
    assert "coil.turnz is no known key. Did you mean 'turns'?" in problems
    assert "coil.turns is missing" in problems
    assert "flange and electromagnet.regions.sleeve must not overlap" in problems


def test_a_wrong_number_in_a_table_does_not_hide_where_its_part_lies():
    text = changed("turns = 308", "turns = 0")
    text = changed("z_mm = [-20, -5]", "z_mm = [-20, -3]", text)
    text = changed("[0, 0.5, 1]", "[0, nan]", text)
    text = changed("start = 15, stop = 45, step = 0.5", "start = 0, stop = 45, step = 0.5", text)
    text = changed('material = "magnet"', "material = 3", text)
    text = changed("r_mm = [0, 5.5]", "r_mm = [-1, 5.5]", text)
    text = changed("r_mm = 0\nz_mm = 0\nadc_bits = 12", "r_mm = 4\nz_mm = -2\nadc_bits = 1.5", text)
    problems = "\n".join(problems_of(text))
    for fragment in (
        "coil.turns must be at least 1",
        "flange and coil must not overlap",
        "sweep.current_A[1] must be a finite",
        "sweep.distance_mm must be > 0",
        "disc.material must be a valid string",
        "disc.r_mm must have r >= 0",
        "hall.adc_bits must be",
        "hall must lie outside of solid parts",
    ):
        assert fragment in problems


def test_an_invalid_material_is_reported_once_and_not_again_where_it_is_used():
    (problem,) = problems_of(changed("remanence_T = 1.2", 'remanence_T = "1.2"'))
    assert problem.startswith("materials.magnet.remanence_T must be a valid number")


def test_a_syntax_error_names_its_line():
    (problem,) = problems_of(changed("turns = 308", "turns = = 308"))
    assert "must be TOML" in problem
    assert f"line {VALID[: VALID.index('turns = 308')].count(chr(10)) + 1}" in problem


def test_a_newer_schema_is_said_alone():
    (problem,) = problems_of(changed("schema = 1", "schema = 7\nsomething_new = true"))
    assert problem == "schema is 7; this femfit reads up to schema 2. Update femfit, or write it so."


@pytest.mark.parametrize(
    ("content", "fragment"),
    [
        (None, "does not exist"),
        (b"name = '\xff'", "must be UTF-8 text; byte 8"),
        (b"", "schema is missing"),
        (b"x = " + b"[" * 5000, "nested too deeply"),
        (b"x = " + b"9" * 5000, "must be TOML"),
    ],
)
def test_a_file_that_cannot_be_read_says_why(tmp_path, content, fragment):
    path = tmp_path / "actuator.toml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ActuatorFileError, match=fragment) as caught:
        read_actuator(path)
    assert caught.value.source == str(path)


def test_a_directory_in_place_of_a_file_is_an_error_of_the_file(tmp_path):
    with pytest.raises(ActuatorFileError, match="cannot be read"):
        read_actuator(tmp_path)


def test_a_byte_order_mark_is_no_mistake(tmp_path):
    path = tmp_path / "actuator.toml"
    path.write_text(VALID, encoding="utf-8-sig")
    assert read_actuator(path).name == "test-rig"


def test_the_error_is_ours_and_survives_a_process_boundary():
    with pytest.raises(FemfitError) as caught:
        actuator_from_toml(changed("turns = 308", "turns = 0"), "a.toml")
    copy = pickle.loads(pickle.dumps(caught.value))  # noqa: S301  our own bytes
    assert str(copy) == str(caught.value)
    assert str(copy).startswith("a.toml has 1 problem:\n  - coil.turns must be at least 1")
