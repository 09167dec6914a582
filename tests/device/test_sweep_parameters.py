"""Parameters of a sweep: designs, columns, key paths that follow together, and what is wrong with them."""

import contextlib
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from femfit.core.errors import ActuatorFileError
from femfit.device.load import actuator_from_toml
from femfit.device.parts import REFERENCE_TEMPERATURE
from femfit.device.variants import variants_from_toml
from femfit.device.winding import wire_resistance
from support.actuators import GEOMETRY

RIG = (GEOMETRY / "emaws-rig.toml").read_text(encoding="utf-8")
PLUNGER = (GEOMETRY / "plunger-solenoid.toml").read_text(encoding="utf-8")
AXES = "current_A = { start = 0, stop = 1.4, step = 0.2 }\ndistance_mm = { start = 15, stop = 45, step = 0.5 }\n"


def sweep(parameters, head="", text=RIG, axes=AXES):
    """The rig's file with parameters, and with keys of [sweep] itself."""
    return text.replace(AXES, axes).replace("[sweep]", f"[sweep.parameters]\n{parameters}\n[sweep]\n{head}\n", 1)


def variants(*arguments, **options):
    return variants_from_toml(sweep(*arguments, **options))


def test_a_grid_has_every_combination_the_last_parameter_fastest():
    found = variants(
        '"coils.coil.turns" = [250, 308]\n"materials.n52.remanence_T" = { start = 1.4, stop = 1.48, step = 0.04 }'
    )
    assert found.columns == ("coils.coil.turns", "materials.n52.remanence_T")
    assert [one.values for one in found.variants] == [(n, b) for n in (250, 308) for b in (1.4, 1.44, 1.48)]
    for one in found.variants:
        assert one.actuator.coil.turns == one.values[0]
        assert one.actuator.moving.regions[0].material.remanence_T == one.values[1]
        assert one.actuator.sweep == found.actuator.sweep
    assert found.actuator == actuator_from_toml(RIG)


def test_a_list_takes_the_values_line_by_line():
    found = variants(
        '"coils.coil.turns" = [308, 250, 300]\n"coils.coil.resistance_ohm" = [2.69, 2.2, 2.6]', 'design = "list"'
    )
    assert [one.values for one in found.variants] == [(308, 2.69), (250, 2.2), (300, 2.6)]
    assert [one.actuator.coil.resistance_ohm for one in found.variants] == [2.69, 2.2, 2.6]


HYPERCUBE = 'design = "latin_hypercube"\nsamples = 20\nseed = 7'


def test_a_latin_hypercube_has_one_sample_in_each_slice_of_each_range():
    ranges = '"coils.coil.turns" = { min = 100, max = 300 }\n'
    ranges += '"materials.ferrite.relative_permeability" = { min = 300, max = 600 }'
    found = variants(ranges, HYPERCUBE)
    for place, (low, high) in enumerate([(100, 300), (300, 600)]):
        slices = sorted(int(20 * (one.values[place] - low) / (high - low)) for one in found.variants)
        assert slices == list(range(20))
    assert variants(ranges, HYPERCUBE) == found  # the seed alone decides
    assert variants(ranges, HYPERCUBE.replace("7", "8")) != found


def test_a_step_keeps_turns_whole_and_draws_each_equally_often():
    found = variants('"coils.coil.turns" = { min = 301, max = 305, step = 1 }', HYPERCUBE)
    turns = [one.values[0] for one in found.variants]
    assert {value: turns.count(value) for value in turns} == dict.fromkeys((301, 302, 303, 304, 305), 4)


def test_current_and_distance_may_be_drawn_with_the_parameters():
    ranges = "current_A = { min = 0, max = 1.4 }\ndistance_mm = { min = 15, max = 45 }\n"
    ranges += '"coils.coil.turns" = { min = 100, max = 300 }'
    found = variants(ranges, HYPERCUBE, axes="")
    assert found.columns == ("coils.coil.turns",)
    assert all(len(one.sweep.currents_A) == len(one.sweep.distances_m) == 1 for one in found.variants)
    assert len({one.sweep.distances_m for one in found.variants}) == 20
    assert found.actuator.sweep.distances_m == tuple(sorted(one.sweep.distances_m[0] for one in found.variants))


def test_numbers_that_touch_follow_one_parameter_together():
    keys = (
        '["fixed.regions.sleeve.r_mm[1]", "coils.coil.r_mm[0]", '
        '{ key = "coils.coil.wire_diameter_mm", factor = -0.01, offset = 0.59 }]'
    )
    found = variants(f"[sweep.parameters.sleeve_radius_mm]\nkeys = {keys}\nvalues = [9, 10, 11]")
    assert found.columns == ("sleeve_radius_m",)
    assert [one.values for one in found.variants] == [(0.009,), (0.01,), (0.011,)]
    for (radius,), actuator in ((one.values, one.actuator) for one in found.variants):
        sleeve = next(region for region in actuator.fixed if region.name == "sleeve")
        assert max(r for r, _ in sleeve.vertices_m) == min(r for r, _ in actuator.coil.vertices_m) == radius
    assert [one.actuator.coil.wire_diameter_m for one in found.variants] == [0.0005, 0.00049, 0.00048]


@pytest.mark.parametrize(
    ("path", "column"),
    [
        ("mechanics.mass_g", "mechanics.mass_kg"),
        ("moving.regions.magnet.r_mm[1]", "moving.regions.magnet.r[1]_m"),
        ("supply.sample_time_ms", "supply.sample_time_s"),
        ("sensors.hall.z_mm", "sensors.hall.z_m"),
        ("sensors.hall.sensitivity_V_per_T", "sensors.hall.sensitivity_V_per_T"),
        ("coils.coil.turns", "coils.coil.turns"),
    ],
)
def test_a_column_ends_in_its_si_unit_and_holds_it(path, column):
    low, high = {"sensors.hall.z_mm": (-0.2, -0.1), "moving.regions.magnet.r_mm[1]": (5, 5.5)}.get(path, (4, 5))
    found = variants(f'"{path}" = [{low}, {high}]')
    assert found.columns == (column,)
    factor = 1e-3 if any(unit in path for unit in ("_mm", "_g", "_ms")) else 1.0
    assert [one.values[0] for one in found.variants] == [float(f"{factor * v:.12g}") for v in (low, high)]


def test_a_corner_of_a_polygon_can_be_swept():
    path = "fixed.regions.pole_and_bottom.polygon_mm"
    keys = f'["{path}[3][0]", "{path}[4][0]"]'
    text = PLUNGER.replace(
        "[sweep]", f"[sweep.parameters]\npole_radius_mm = {{ keys = {keys}, values = [4, 5] }}\n[sweep]"
    )
    found = variants_from_toml(text)
    assert [one.actuator.fixed[0].vertices_m[3:5] for one in found.variants] == [
        ((r, -0.015), (r, 0.0)) for r in (0.004, 0.005)
    ]


def test_a_magnets_temperature_lowers_its_remanence_and_the_windings_raises_its_resistance():
    text = RIG.replace("resistance_ohm = 2.69", "#").replace('material = "n52"', 'material = "n42"')
    parameters = (
        'magnet_temperature_C = { keys = ["moving.regions.magnet.temperature_C"], values = [20, 80] }\n'
        '"coils.coil.temperature_C" = [20, 100]'
    )
    found = variants(parameters, text=text)
    for one in found.variants:
        magnet, copper = one.values
        expected = 1.312 * (1.0 - 1.2e-3 * (magnet - REFERENCE_TEMPERATURE))
        assert one.actuator.moving.regions[0].material.remanence_T == pytest.approx(expected)
        assert one.actuator.coil.resistance_ohm == pytest.approx(wire_resistance(308, 0.015, 0.49e-3, copper))


def test_a_library_materials_constant_can_be_swept_without_copying_the_material():
    found = variants(
        '"materials.n42.remanence_T" = [1.29, 1.33]', text=RIG.replace('material = "n52"', 'material = "n42"')
    )
    materials = [one.actuator.moving.regions[0].material for one in found.variants]
    assert [material.remanence_T for material in materials] == [1.29, 1.33]
    assert {(m.relative_permeability, m.remanence_coefficient_per_K) for m in materials} == {(1.05, -1.2e-3)}


def test_key_paths_without_quotes_are_understood():
    assert variants("coils.coil.turns = [250, 308]") == variants('"coils.coil.turns" = [250, 308]')


CORE = """core = { values = ["ferrite_k10", "soft_ferrite"], keys = [
  "fixed.regions.upper_flange.material",
  "fixed.regions.sleeve.material",
  "fixed.regions.lower_flange.material",
] }
"""
GRADES = '"moving.regions.magnet.material" = ["n42", "n52"]'


def test_materials_are_swept_by_their_names_alone_or_as_a_whole_core():
    found = variants(CORE + GRADES + '\n"coils.coil.turns" = [250, 308]')
    assert found.columns == ("core", "moving.regions.magnet.material", "coils.coil.turns")
    assert [one.values for one in found.variants] == [
        (core, grade, turns)
        for core in ("ferrite_k10", "soft_ferrite")
        for grade in ("n42", "n52")
        for turns in (250, 308)
    ]
    for one in found.variants:
        assert {part.material.name for part in one.actuator.fixed} == {one.values[0]}
        assert one.actuator.moving.regions[0].material.name == one.values[1]


def test_a_list_takes_materials_and_numbers_line_by_line():
    found = variants(f'{GRADES}\n"mechanics.mass_g" = [4.2, 4.35]', 'design = "list"')
    assert [one.values for one in found.variants] == [("n42", 0.0042), ("n52", 0.00435)]


def test_a_latin_hypercube_draws_each_material_equally_often_beside_a_range():
    found = variants(f'{CORE}{GRADES}\n"coils.coil.turns" = {{ min = 100, max = 300 }}', HYPERCUBE)
    for place in (0, 1):
        names = [one.values[place] for one in found.variants]
        assert sorted(names.count(name) for name in set(names)) == [10, 10]
    assert len({one.values[2] for one in found.variants}) == 20


def test_a_material_that_does_not_suit_its_region_is_a_variant_with_its_problem():
    found = variants('"moving.regions.magnet.material" = ["n42", "steel_1010"]')
    assert [one.actuator is None for one in found.variants] == [False, True]
    assert "magnetization must be left out; steel_1010 has no remanence" in found.variants[1].problem


def test_a_variant_that_cannot_be_built_keeps_its_problem_and_the_others_go_on():
    found = variants('"fixed.regions.sleeve.r_mm[1]" = [9, 10, 11]')
    bad = found.variants[2]
    assert [one.actuator is None for one in found.variants] == [False, False, True]
    assert "fixed.regions.sleeve and coils.coil must not overlap" in bad.problem
    assert bad.sweep == found.actuator.sweep


MISTAKES = {
    "misspelt key": ('"coils.coil.turn" = [1, 2]', "", ["'coils.coil.turn' is none", "Nearest: coils.coil.turns"]),
    "a table": ('"coil" = [1, 2]', "", ["'coil' is none", "Nearest: coils.coil.turns"]),
    "an interval": (
        '"coils.coil.r_mm" = [1, 2]',
        "",
        ["'coils.coil.r_mm' is none", "Nearest: coils.coil.r_mm[0], coils.coil.r_mm[1]"],
    ),
    "text": ('"moving.regions.magnet.magnetization" = [1, 2]', "", ["number or a material in this file", "moving."]),
    "numbers for a material": ('"moving.regions.magnet.material" = [1]', "", ["values[0] must be a valid string"]),
    "a range of materials": (
        '"moving.regions.magnet.material" = { min = 1, max = 2 }',
        HYPERCUBE,
        ["must be a list of names of materials", '["air", "ferrite"]'],
    ),
    "unknown material": (
        '"moving.regions.magnet.material" = ["n42", "N53"]',
        "",
        [
            "must name materials",
            "'N53' is none",
            "Did you mean",
            "Known: air, copper",
            "n50, n52, smco26, ferrite_y30, ferrite.",
        ],
    ),
    "repeated material": ('"moving.regions.magnet.material" = ["n42", "n42"]', "", ["must not repeat a value"]),
    "material and number": (
        'a = { keys = ["coils.coil.turns", "moving.regions.magnet.material"], values = [1, 2] }',
        "",
        ["must all be materials or all be numbers"],
    ),
    "factor of a material": (
        'a = { keys = [{ key = "moving.regions.magnet.material", factor = 2 }], values = ["n42"] }',
        "",
        ["neither factor nor offset"],
    ),
    "material set twice": (
        'a = { keys = ["moving.regions.magnet.material"], values = ["n42"] }\nmoving.regions.magnet.material = ["n45"]',
        "",
        ["must not set moving.regions.magnet.material; a does"],
    ),
    "whole number of bits": (
        '"sensors.hall.adc_bits" = [10, 12]',
        "",
        ["'sensors.hall.adc_bits': a converter has a whole number of bits"],
    ),
    "nothing like it": ('"xyzzy" = [1, 2]', "", ["'xyzzy' is none", 'An example: "coils.NAME.turns"']),
    "position beyond the list": ('"coils.coil.r_mm[2]" = [1, 2]', "", ["Nearest: coils.coil.r_mm"]),
    "the sweep itself": ('"sweep.current_A[0]" = [1, 2]', "", ["it is of the grid itself"]),
    "text for values": ('"coils.coil.turns" = "many"', "", ["must be a list of numbers", "'many'"]),
    "text in values": (
        '"coils.coil.turns" = [1, "2"]',
        "",
        ["'coils.coil.turns'.values[1] must be a valid number", "'2'"],
    ),
    "no values": ('"coils.coil.turns" = []', "", ["at least 1 item"]),
    "repeated value": ('"coils.coil.turns" = [250, 250]', "", ["must not repeat a value"]),
    "step that does not divide": (
        '"coils.coil.turns" = { start = 1, stop = 4, step = 2 }',
        "",
        ["step that divides its range"],
    ),
    "unknown key of a range": (
        '"coils.coil.turns" = { start = 1, stop = 4, step = 1, n = 2 }',
        "",
        ["n is no known key"],
    ),
    "sampled without the design": ('"coils.coil.turns" = { min = 1, max = 4 }', "", ['for design = "grid"']),
    "list for a hypercube": ('"coils.coil.turns" = [1, 2]', HYPERCUBE, ["{ min, max }"]),
    "hypercube without samples": (
        '"coils.coil.turns" = { min = 1, max = 2 }',
        'design = "latin_hypercube"',
        ["sweep.samples is missing"],
    ),
    "reversed range": ('"coils.coil.turns" = { min = 4, max = 2 }', HYPERCUBE, ["max > min"]),
    "sampled step that does not divide": (
        '"coils.coil.turns" = { min = 1, max = 4, step = 2 }',
        HYPERCUBE,
        ["step that divides max - min"],
    ),
    "samples on a grid": ('"coils.coil.turns" = [250, 308]', "samples = 3", ["sweep.samples must be left out"]),
    "lists of different length": (
        '"coils.coil.turns" = [250, 308]\n"mechanics.mass_g" = [4]',
        'design = "list"',
        ["equally many values", "coils.coil.turns 2, mechanics.mass_g 1"],
    ),
    "unknown design": ('"coils.coil.turns" = [1, 2]', 'design = "sobol"', ["sweep.design must be", "'sobol'"]),
    "axis in both": ("current_A = [1, 2]", "", ["sweep.parameters.current_A must stand in", "both"]),
    "name without its unit": (
        'sleeve = { keys = ["coils.coil.r_mm[0]"], values = [9, 10] }',
        "",
        ["sweep.parameters.sleeve must be named", "end in _mm"],
    ),
    "name with a unit of nothing": (
        'n_mm = { keys = ["coils.coil.turns"], values = [9, 10] }',
        "",
        ["not end in a unit"],
    ),
    "name of a column": (
        'status = { keys = ["coils.coil.turns"], values = [9, 10] }',
        "",
        ["status is one or comes twice"],
    ),
    "keys in two units": (
        'a_mm = { keys = ["coils.coil.r_mm[0]", "coils.coil.turns"], values = [9, 10] }',
        "",
        ["in one unit; they are in none and mm"],
    ),
    "keys without values": (
        'a_mm = { keys = ["coils.coil.r_mm[0]"] }',
        "",
        ["sweep.parameters.a_mm.values is missing"],
    ),
    "unknown key path in keys": (
        'a_mm = { keys = ["coils.coil.r_mm[0]", "coils.coil.x_mm"], values = [9, 10] }',
        "",
        ["a_mm.keys[1]", "'coils.coil.x_mm' is none"],
    ),
    "one number set twice": (
        '"coils.coil.turns" = [300, 308]\nn = { keys = ["coils.coil.turns"], values = [1, 2] }',
        "",
        ["sweep.parameters.n must not set coils.coil.turns; coils.coil.turns does"],
    ),
    "a key that another overrides": ('"coils.coil.temperature_C" = [20, 80]', "", ["20 and 80 give the same one"]),
    "no variant that can be built": (
        '"fixed.regions.sleeve.r_mm[1]" = [11, 12]',
        "",
        ["must leave a variant", "must not overlap"],
    ),
    "too many combinations": (
        """"coils.coil.turns" = { start = 1, stop = 200, step = 1 }
"mechanics.mass_g" = { start = 1, stop = 200, step = 1 }""",
        "",
        ["at most 10000 combinations; they have 40000"],
    ),
}


@pytest.mark.parametrize(("parameters", "head", "fragments"), MISTAKES.values(), ids=MISTAKES)
def test_a_mistake_has_its_own_message(parameters, head, fragments):
    with pytest.raises(ActuatorFileError) as caught:
        variants(parameters, head)
    (line,) = caught.value.problems
    for fragment in fragments:
        assert fragment in line
    assert line.endswith(".") or "Nearest" in line


def test_a_design_without_parameters_is_refused():
    with pytest.raises(ActuatorFileError, match=r"sweep\.samples must be left out without \[sweep\.parameters\]"):
        actuator_from_toml(RIG.replace("[sweep]", "[sweep]\nsamples = 3"))


def test_mistakes_in_parameters_come_with_all_others():
    text = sweep('"coils.coil.turn" = [1, 2]').replace("turns = 308", "turns = 0")
    with pytest.raises(ActuatorFileError) as caught:
        actuator_from_toml(text)
    assert len(caught.value.problems) == 2


TOKENS = ["nan", "inf", "1e300", "-1", "true", '"x"', "[]", "{}", "[[1]]", "{ min = 1 }", "{ start = 0, stop = 1 }"]
VALUES = st.sampled_from(
    [*TOKENS, "[1, 2]", "{ min = 1, max = 2 }", '{ keys = ["coils.coil.turns"], values = [1, 2] }']
)
NAMES = st.sampled_from(
    ['"coils.coil.turns"', "coils.coil.turns", "coil", "a_mm", "current_A", '"sensors.hall.z_mm"', '""', "'[0]'", "n"]
)


@settings(max_examples=150, deadline=None, derandomize=True)
@given(st.dictionaries(NAMES, VALUES, max_size=3), st.sampled_from(["", HYPERCUBE, 'design = "list"', "seed = 3"]))
def test_any_table_of_parameters_gives_variants_or_an_actuator_error(parameters, head):
    lines = "\n".join(f"{name} = {value}" for name, value in parameters.items())
    with contextlib.suppress(ActuatorFileError):
        found = variants(lines, head)
        assert len(found.variants) >= 1
        assert all(len(one.values) == len(found.columns) for one in found.variants)


def test_each_example_of_the_folder_still_loads():
    for path in sorted(Path(GEOMETRY).glob("*.toml")):
        assert variants_from_toml(path.read_text(encoding="utf-8"), directory=GEOMETRY).variants
