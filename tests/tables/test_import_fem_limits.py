"""What FEMM models may hold and femfit cannot take: each is refused with its name and a remedy."""

import pickle
import re

import pytest

from femfit.core.errors import ActuatorFileError, FemFileError, FemfitError
from femfit.tables.femm.options import FemOptions, axis_option
from femfit.tables.femm.read import import_fem
from support.fem_files import AIR, COPPER, MAGNET, STEEL, FemDrawing, suspension

CURVE = ((0, 0), (1, 200), (1.5, 2000), (1.8, 12000), (2.1, 60000))


def problems(content, **options):
    with pytest.raises(FemFileError) as caught:
        import_fem(content, "model.fem", FemOptions(**options))
    return caught.value.problems


def only_problem(drawing, **options):
    found = problems(drawing.content(), **options)
    assert len(found) == 1, found
    return found[0]


@pytest.mark.parametrize(
    ("header", "words"),
    [
        ({"ProblemType": "planar"}, ("[ProblemType]", "body of revolution")),
        ({"Format": 3.2}, ("[Format] is 3.2", "FEMM 4.2")),
        ({"PrevSoln": '"old.ans"', "PrevType": 2}, ("old.ans", "frozen permeability")),
    ],
)
def test_problems_of_another_kind_are_refused(header, words):
    message = only_problem(suspension(header=header))
    assert all(word in message for word in words), message


@pytest.mark.parametrize(
    ("name", "changes", "words"),
    [
        (STEEL, {"Mu_y": 300}, ("'Pure Steel'", "anisotropic", "500", "300")),
        (STEEL, {"LamFill": 0.95, "LamType": 1}, ("'Pure Steel'", "laminated", "0.95")),
        (STEEL, {"Mu_x": -1, "Mu_y": -1}, ("'Pure Steel'", "must be > 0")),
        (AIR, {"J_re": 2.5}, ("'Air'", "outer boundary")),
        (STEEL, {"J_re": 2.5}, ("'Pure Steel'", "magnetic", "current density J")),
        (COPPER, {"Mu_x": 5, "Mu_y": 5}, ("'Copper'", "magnetic", "'coil'")),
    ],
)
def test_materials_that_an_actuator_cannot_hold_are_refused(name, changes, words):
    drawing = suspension()
    drawing.materials[name] = {**drawing.materials[name], **changes}
    message = only_problem(drawing)
    assert all(word in message for word in words), message


def test_two_materials_of_one_name_are_refused():
    drawing = suspension()
    content = drawing.content().replace(b'"Copper"', b'"Pure Steel"')
    assert "two different materials are named 'Pure Steel'" in problems(content)[0]


def test_materials_that_no_block_uses_are_left_alone():
    drawing = suspension()
    drawing.materials["Unused"] = {"J_re": 3, "Mu_x": 2, "Mu_y": 7, "H_c": 1, "curve": CURVE}
    import_fem(drawing.content(), "model.fem")


@pytest.mark.parametrize(
    ("name", "changes", "words"),
    [
        (MAGNET, {"formula": "theta+90"}, ("'N40'", "'theta+90'", "Give an angle")),
        (AIR, {"flags": 1}, ("separate pieces", "'Pure Steel'")),
        (COPPER, {"turns": 0}, ("'Copper'", "no turns", "Give their number")),
        (STEEL, {"z": -30}, ("lie in one face", "'Pure Steel'", "'Air'")),
        (STEEL, {"r": 300}, ("'Pure Steel'", "no closed face")),
        (STEEL, {"r": 4}, ("'Pure Steel'", "on a line")),
    ],
)
def test_block_labels_that_cannot_be_taken_are_refused(name, changes, words):
    drawing = suspension()
    drawing.relabel(name, **changes)
    found = " ".join(problems(drawing.content()))
    assert all(word in found for word in words), found


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"BdryType": 4}, ("periodic", "'A=0'")),
        ({"BdryType": 5}, ("periodic", "'A=0'")),
        ({"BdryType": 1}, ("type 1",)),
        ({"BdryType": 0, "A_0": 0.01}, ("drives the field",)),
        ({"BdryType": 2, "c0": 1, "c1": 5}, ("drives the field",)),
    ],
)
def test_boundaries_that_are_not_open_are_refused(values, words):
    drawing = suspension()
    drawing.boundaries = {"A=0": values}
    message = only_problem(drawing)
    assert all(word in message for word in words), message


def test_a_field_prescribed_within_the_drawing_is_refused():
    drawing = suspension()
    drawing.line((15, 10), (25, 10), boundary=1)
    assert "inside of the drawing" in only_problem(drawing)


def test_a_part_at_the_boundary_is_a_symmetry_that_is_not_taken():
    drawing = FemDrawing()
    drawing.box(0, 60, -60, 0)  # air that ends at z = 0, as at a mirror
    drawing.box(0, 4, -12, 0)
    drawing.box(6, 9, -11, -1)
    drawing.box(0, 3, -25, -20)
    drawing.label(2, -6, STEEL)
    drawing.label(7, -6, COPPER, circuit=1, turns=100)
    drawing.label(1, -22, MAGNET, magdir=90)
    drawing.label(40, -40, AIR)
    message = only_problem(drawing)
    assert "'Pure Steel'" in message
    assert "mirror" in message


def test_point_properties_are_refused():
    drawing = suspension()
    drawing.point_properties = {"wire": {"I_re": 3}, "pinned": {"A_re": 0}}
    drawing.points += [(20.0, 20.0, 1), (25.0, 20.0, 2)]
    filament, potential = problems(drawing.content())
    assert "'wire'" in filament
    assert "3 A" in filament
    assert "'pinned'" in potential


def test_empty_regions_and_faces_without_label_are_named_with_their_place():
    drawing = suspension()
    drawing.box(20, 25, 20, 25)
    assert "(22.5, 22.5)" in only_problem(drawing)
    drawing.holes.append((22, 22))
    assert "'<No Mesh>' at (r, z) = (22, 22)" in only_problem(drawing)


def test_a_circuit_that_is_not_there_is_refused_with_those_that_are():
    assert "no circuit is named 'none': 'coil' (2 A)" in only_problem(suspension(), circuits=("none",))


def test_a_parallel_circuit_of_several_blocks_is_refused():
    drawing = suspension()
    drawing.circuits["coil"]["CircuitType"] = 0
    drawing.box(5, 9, 20, 25)
    drawing.label(7, 22, COPPER, circuit=1)
    assert "parallel" in only_problem(drawing)


def test_the_resistance_of_one_winding_is_not_taken_for_two():
    drawing = suspension()
    drawing.box(5, 9, 20, 25)
    drawing.label(7, 22, COPPER, circuit=1)
    assert "--resistance-ohm is of one winding; there are 2" in only_problem(drawing, resistance_ohm=3.0)


def test_a_face_without_label_is_the_only_reason_that_is_given():
    drawing = suspension()
    drawing.labels = [label for label in drawing.labels if label[2] != AIR]
    assert "no block label" in only_problem(drawing)


def several_bodies():
    """A core, a magnet's place taken by steel, and another body behind it."""
    drawing = suspension()
    drawing.relabel(MAGNET, name=STEEL)
    drawing.box(0, 3, 20, 25)
    drawing.label(1, 22, STEEL, group=8)
    return drawing


def test_every_mover_that_a_message_offers_is_taken_at_once():
    drawing = several_bodies()
    drawing.relabel(COPPER, group=0)
    drawing.labels[0][5] = 0  # the core, which no group and no material tells from the others
    message = only_problem(drawing)
    offered = re.findall(r"(--moving-\w+) (\S+) for block '(.*?)' at \(r, z\) = \((\S+), (\S+)\)", message)
    kinds = {"--moving-group": "moving_groups", "--moving-label": "moving_labels", "--moving-block": "moving_blocks"}
    assert {option for option, *_ in offered} == set(kinds)
    for option, value, name, _, z in offered:
        given = value if option == "--moving-block" else int(value)
        toml = import_fem(drawing.content(), "m.fem", FemOptions(**{kinds[option]: (given,)})).toml
        _, moving = toml.split("[mechanics]")
        assert (f"'{name}' at (r, z)" in moving and f", {z})" in moving) or "moves = true" in toml


def test_a_mover_that_is_not_there_is_answered_with_those_that_are():
    message = only_problem(several_bodies(), moving_groups=(77,), moving_blocks=("Gold",), moving_labels=(9,))
    assert "no part has block 'Gold' or group 77 or label 9" in message
    assert "--moving-group 8" in message


def test_a_mover_that_is_everything_is_refused():
    drawing = suspension()
    assert "everything moves" in only_problem(drawing, moving_groups=(1, 2, 3))


def test_a_touching_moving_part_is_refused_with_what_it_touches():
    message = only_problem(suspension(distance=0.0), moving_groups=(3,))
    assert "'N40'" in message
    assert "touches block 'Pure Steel'" in message


def test_a_drawing_whose_parts_all_touch_says_so():
    drawing = suspension(distance=0.0)
    drawing.line((4, -6), (5, -6))
    drawing.line((4, -7), (5, -7))
    drawing.label(4.5, -6.5, STEEL, group=1)
    assert "everything touches" in only_problem(drawing)


def test_iron_without_a_source_has_no_field():
    drawing = suspension()
    drawing.relabel(MAGNET, name=STEEL)
    drawing.relabel(COPPER, circuit=0)
    assert "no field" in only_problem(drawing)


def test_values_that_a_boundary_does_not_use_do_not_matter():
    drawing = suspension()
    drawing.boundaries = {"A=0": {"BdryType": 0, "c1": 5}}
    import_fem(drawing.content(), "m.fem")
    drawing.boundaries = {"open": {"BdryType": 2, "A_0": 5, "c0": 1}}
    import_fem(drawing.content(), "m.fem")


def test_a_lonely_winding_or_nothing_at_all_has_no_force():
    drawing = suspension()
    for name in (STEEL, MAGNET):
        drawing.relabel(name, name=AIR)
    assert "'Copper'" in only_problem(drawing)
    assert "no force acts on it alone" in only_problem(drawing)
    drawing.relabel(COPPER, name=AIR, circuit=0)
    assert "no block is magnetic and none carries current" in only_problem(drawing)


def test_everything_that_cannot_be_taken_is_said_at_once():
    drawing = suspension(header={"ProblemType": "planar", "Format": 3.2})
    drawing.materials[STEEL]["Mu_y"] = 7
    drawing.relabel(MAGNET, formula="theta")
    drawing.boundaries = {"A=0": {"BdryType": 4}}
    drawing.relabel(COPPER, turns=0)
    found = problems(drawing.content())
    wanted = ("[ProblemType]", "[Format]", "anisotropic", "'theta'", "periodic", "no turns")
    assert all(any(word in line for line in found) for word in wanted), found


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda text: text.replace("[NumPoints] = ", "[NumPoints] = 9"), "NumPoints says"),
        (lambda text: text.replace("LengthUnits] = millimeters", "LengthUnits] = furlongs"), "'furlongs'"),
        (lambda text: text.replace("<Mu_x> = 500", "<Mu_x> = many"), "'Pure Steel': mu_x must be a number"),
        (lambda text: text.replace("<Mu_x> = 500", "<Mu_x> = inf"), "'Pure Steel': mu_x must be a number"),
        (lambda text: text.replace("0\t1\t-1\t0\t0\t0", "0\t99\t-1\t0\t0\t0", 1), "segment 0 runs from point 0 to 99"),
        (lambda text: text.replace("\t180\t5", "\t400\t5"), "arc 0 must span"),
        (
            lambda text: text.replace("2.0\t-6.0\t2\t", "2.0\t-6.0\t9\t"),
            "label 1: its block property is number 9",
        ),
        (lambda text: text.replace("0.0\t80.0", "0.0\t8e9"), "within 100000 mm"),
        (lambda text: text.replace("\n4.0\t0.0\t", "\n-4.0\t0.0\t"), "r >= 0"),
        (lambda _: "hello", "no FEMM magnetics file"),
        (lambda _: "", "no FEMM magnetics file"),
        (lambda _: "[Format] = 4.0\n[NumPoints] = 0\n[NumBlockLabels] = 0", "enclose no face"),
        (lambda text: text + "\x00", "no text file"),
    ],
)
def test_files_that_cannot_be_read_are_named_with_the_place(change, words):
    found = " ".join(problems(change(suspension().text()).encode()))
    assert words in found, found


def test_a_solution_after_the_model_is_left_alone():
    content = suspension().content()
    expected = import_fem(content, "model.fem")
    assert import_fem(content + b"[Solution]\n3\n1 2 3\n[NumPoints] = 7\n", "model.fem") == expected


def test_a_sweep_into_the_electromagnet_is_refused_by_the_actuator_file():
    drawing = suspension()
    drawing.box(0, 3, -40, -35)
    drawing.label(1, -37, STEEL)
    with pytest.raises(ActuatorFileError, match="collides with fixed"):
        import_fem(drawing.content(), "m.fem", FemOptions(face_mm=-35.0, distances_mm=(10.0, 20.0), moving_groups=(3,)))


@pytest.mark.parametrize(
    "options",
    [{"mass_g": 0.0}, {"density_g_per_cm3": -1.0}, {"resistance_ohm": float("nan")}, {"arc_degrees": 0.0}],
)
def test_options_out_of_range_are_refused_with_their_name(options):
    with pytest.raises(FemFileError, match="--" + next(iter(options)).replace("_", "-")):
        FemOptions(**options)


@pytest.mark.parametrize(
    "text", ["", "a", "1:2", "1:2:-1", "1:2:0.3", "2:1:0.5", "1,,2", "1:2:1,3", "nan", "1e9", "0:1:1e-9"]
)
def test_axes_that_are_none_are_refused(text):
    with pytest.raises(FemFileError, match="--distance-mm"):
        axis_option(text, "--distance-mm")


def test_the_error_is_a_femfit_error_that_survives_a_process():
    error = FemFileError("model.fem", ["one", "two"])
    assert isinstance(error, FemfitError)
    assert isinstance(error, ValueError)
    assert str(pickle.loads(pickle.dumps(error))) == str(error)  # noqa: S301  our own bytes


def test_every_face_that_a_message_offers_is_taken_at_once():
    result = import_fem(suspension().content(), "model.fem")
    remedy = next(finding.remedy for finding in result.findings if finding.code == "frame")
    offered = [float(word) for word in re.findall(r"-?\d+\.?\d*", remedy.split("--face-mm: ")[1])]
    assert offered == [-1.0, -11.0, -12.0]
    for face in (*offered, -3.5):  # a height without a corner too
        imported = import_fem(suspension().content(), "model.fem", FemOptions(face_mm=face))
        assert imported.distance_m == pytest.approx(4e-3 - 1e-3 * face)


def test_a_refused_actuator_says_how_its_heights_lie_in_the_file():
    drawing = suspension(face=-30.0)
    with pytest.raises(ActuatorFileError) as caught:
        import_fem(drawing.content(), "model.fem", FemOptions(distances_mm=(-15.0,)))
    assert "the file's z is -30 mm + z" in caught.value.problems[-1]


def test_two_drawings_in_one_file_are_refused_with_a_part_of_each():
    drawing = suspension()
    drawing.arc((0, 200), (0, 300), 180)
    drawing.line((0, 200), (0, 240), (10, 240), (10, 260), (0, 260), (0, 300))
    drawing.line((0, 240), (0, 260))
    drawing.label(20, 250, AIR)
    drawing.label(5, 250, STEEL)
    message = only_problem(drawing)
    assert "2 separate pieces" in message
    assert "(5, 250)" in message


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        (b"<ex> = 1\n<ey> = 1\n<qv> = 0", "electrostatics (.fee)"),
        (b"<Kx> = 1\n<Ky> = 1\n<Kt> = 0", "heat flow (.feh)"),
        (b"<ox> = 1\n<oy> = 1\n<ex> = 1", "current flow (.fec)"),
    ],
)
def test_files_of_the_other_solvers_are_called_what_they_are(keys, words):
    content = b'[Format] = 1\n[ProblemType] = axisymmetric\n[BlockProps] = 1\n<BeginBlock>\n<BlockName> = "a"\n'
    content += keys + b"\n<EndBlock>\n[ConductorProps] = 0\n[NumPoints] = 0\n[NumBlockLabels] = 1\n1 1 1 -1 3\n"
    (message,) = problems(content)
    assert words in message
    assert "circuit" not in message


def test_an_arc_that_is_as_straight_as_a_segment_is_one():
    drawing = suspension()
    plain = import_fem(drawing.content(), "model.fem").toml
    *kept, (a, b, boundary) = drawing.segments
    drawing.segments = kept
    drawing.arcs.append((a, b, 3e-324, boundary))
    assert import_fem(drawing.content(), "model.fem").toml == plain
