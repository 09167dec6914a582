"""FEMM drawings to actuator files: units, faces, arcs, sides, signs. Lengths in mm unless named otherwise."""

import math
import tomllib

import numpy as np
import pytest
import shapely

from femfit.core.constants import MU_0
from femfit.device.outlines import LARGEST_STEP, flattened
from femfit.tables.femm.options import FemOptions, axis_option
from femfit.tables.femm.read import import_fem
from support.fem_files import AIR, COPPER, MAGNET, STEEL, UNIT_MM, FemDrawing, suspension

NANOMETRE = 1e-9


def imported(drawing, **options):
    return import_fem(drawing.content(), "model.fem", FemOptions(**options))


def polygon(region):
    return shapely.Polygon(1e3 * np.asarray(region.vertices_m))


def area(regions):
    return sum(polygon(region).area for region in regions)


def codes(result):
    return {finding.code for finding in result.findings}


def said(result, code):
    (finding,) = [finding for finding in result.findings if finding.code == code]
    return finding


@pytest.mark.parametrize("unit", UNIT_MM)
def test_the_same_drawing_in_every_unit_is_the_same_actuator(unit):
    expected, actuator = imported(suspension()).actuator, imported(suspension(unit=unit)).actuator
    assert actuator.sweep == expected.sweep
    assert actuator.coil == expected.coil
    assert len(actuator.fixed) == len(expected.fixed) == 1
    np.testing.assert_allclose(actuator.fixed[0].vertices_m, expected.fixed[0].vertices_m, atol=NANOMETRE)
    moved, magnet = actuator.moving.regions[0], expected.moving.regions[0]
    np.testing.assert_allclose(moved.vertices_m, magnet.vertices_m, atol=NANOMETRE)


def test_the_actuator_is_what_was_drawn():
    result = imported(suspension())
    actuator = result.actuator
    assert set(actuator.fixed[0].vertices_m) == {(0, -0.012), (0.004, -0.012), (0.004, 0), (0, 0)}
    assert set(actuator.moving.regions[0].vertices_m) == {(0, 0), (0.003, 0), (0.003, 0.005), (0, 0.005)}
    assert actuator.coil.turns == 200
    assert actuator.fixed[0].material.relative_permeability == 500
    # B_r = mu_0 mu_r H_c; the file keeps twelve digits
    assert actuator.moving.regions[0].material.remanence_T == pytest.approx(MU_0 * 1.05 * 970000, rel=1e-11)
    assert actuator.sweep.currents_A == (2.0,)
    assert actuator.sweep.distances_m == (0.004,)
    assert (result.current_A, result.distance_m) == (2.0, 0.004)
    # 9 pi 5 mm^3 of magnet at 7.5 g/cm^3; five digits are written
    assert actuator.mechanics.mass_kg == pytest.approx(math.pi * 9 * 5 * 7.5e-6, rel=1e-4)


def test_a_drawing_upside_down_or_shifted_is_the_same_actuator():
    expected = imported(suspension()).actuator
    for drawing in (suspension(below=True), suspension(face=-37.25), suspension(below=True, face=12.5)):
        actuator = imported(drawing).actuator
        assert actuator.fixed[0].material == expected.fixed[0].material
        assert set(actuator.fixed[0].vertices_m) == set(expected.fixed[0].vertices_m)
        assert set(actuator.coil.vertices_m) == set(expected.coil.vertices_m)
        # a mirror at a plane z = const leaves axial moments and currents as they are
        assert actuator.moving.regions[0].material == expected.moving.regions[0].material
        assert actuator.sweep == expected.sweep


@pytest.mark.parametrize(
    ("magdir", "coercivity", "turns", "current", "reversed_field"),
    [
        (90, 970000, 200, 2.0, False),
        (-90, 970000, 200, -2.0, True),
        (270, 970000, 200, -2.0, True),
        (90, -970000, 200, -2.0, True),
        (90, 970000, -200, -2.0, False),
        (-90, 970000, -200, 2.0, True),
    ],
)
def test_positive_current_attracts_whatever_the_files_polarity(magdir, coercivity, turns, current, reversed_field):
    drawing = suspension()
    drawing.relabel(MAGNET, magdir=magdir)
    drawing.relabel(COPPER, turns=turns)
    drawing.materials[MAGNET]["H_c"] = coercivity
    result = imported(drawing)
    assert result.actuator.moving.regions[0].material.remanence_T > 0
    assert result.actuator.coil.turns == 200
    assert result.actuator.sweep.currents_A == (current,)
    assert ("field-sign" in codes(result)) is reversed_field
    assert ("current-sign" in codes(result)) is (current < 0)


def test_the_label_gives_the_direction_and_an_angle_of_the_material_is_said():
    drawing = suspension()
    drawing.materials[MAGNET]["H_cAngle"] = -90
    result = imported(drawing)
    assert "material-angle" in codes(result)
    assert result.actuator.moving.regions[0].material.remanence_T > 0


def test_lines_that_overlap_cross_or_end_on_others_are_split():
    drawing = suspension()
    drawing.line((0, 4), (0, 9))  # along the axis and the magnet's edge, once more
    drawing.line((0, -12), (3, 20))  # crosses core, gap and magnet
    drawing.line((1, -7), (4, -7 + 3 * 32 / 3))  # ends on nothing, crosses what is there
    drawing.labels.clear()
    plain = suspension()
    faces = shapely.polygonize(
        [
            shapely.unary_union(
                [shapely.LineString([drawing.points[a][:2], drawing.points[b][:2]]) for a, b, _ in drawing.segments]
            )
        ]
    )
    boxes = {
        STEEL: shapely.box(0, -12, 4, 0),
        MAGNET: shapely.box(0, 4, 3, 9),
        COPPER: shapely.box(5, -11, 9, -1),
    }
    for face in faces.geoms:
        point = face.representative_point()
        name = next((name for name, shape in boxes.items() if shape.contains(point)), AIR)
        extra = {"circuit": 1, "turns": 200} if name == COPPER else {"magdir": 90} if name == MAGNET else {}
        drawing.label(point.x, point.y, name, group=1, **extra)
    drawing.label(30, 30, AIR)
    actuator, expected = imported(drawing).actuator, imported(plain).actuator
    assert len(drawing.labels) > 8
    # points of a slanted cut are rounded to a nanometre
    assert area(actuator.fixed) == pytest.approx(area(expected.fixed), abs=1e-4)
    assert area(actuator.moving.regions) == pytest.approx(15, abs=1e-4)
    assert set(actuator.coil.vertices_m) == set(expected.coil.vertices_m)


def test_a_part_drawn_in_two_blocks_becomes_one_region():
    drawing = suspension()
    drawing.line((0, -5), (4, -5))
    drawing.label(2, -2, STEEL, group=1)
    actuator = imported(drawing).actuator
    assert len(actuator.fixed) == 1
    assert len(actuator.fixed[0].vertices_m) == 4


def drawn(region):
    """A region's polygon in mm, with its arcs as chords of at most 2 degrees."""
    return 1e6 * shapely.Polygon(flattened(region.vertices_m, region.bulges)).area


CHORDS = LARGEST_STEP**2 / 6 * 1.02
"""Share of a sector that chords cut off; the next term of 1 - sin t / t is t^2 / 20 of the first."""


def test_a_ball_is_a_ball_however_its_arcs_are_divided():
    drawing = suspension()
    drawing.materials["Ball"] = {"Mu_x": 100, "Mu_y": 100}
    drawing.line((0, 30), (0, 36))
    drawing.arc((0, 30), (0, 36), 180)
    drawing.label(1, 33, "Ball", group=7)
    for degrees in (1.0, 3.0, 10.0):
        (ball,) = imported(drawing, moving_groups=(7,), arc_degrees=degrees).actuator.moving.regions
        assert set(ball.vertices_m) == {(0, 0), (0, 0.006)}
        assert drawn(ball) == pytest.approx(math.pi * 9 / 2, rel=CHORDS)


def test_arcs_run_counter_clockwise_and_bulge_to_the_right():
    drawing = FemDrawing()
    drawing.box(5, 9, -11, -1)
    drawing.line((0, 2), (4, 2))
    drawing.arc((4, 2), (0, 6), 90)  # quarter disc about (0, 2)
    drawing.line((0, -60), (0, 60))
    drawing.arc((0, -60), (0, 60), 180, 1)
    drawing.label(7, -6, COPPER, circuit=1, turns=200)
    drawing.label(1, 3, STEEL)
    drawing.label(30, 30, AIR)
    result = imported(drawing)
    (moved,) = result.actuator.moving.regions
    assert drawn(moved) == pytest.approx(math.pi * 16 / 4, rel=CHORDS)
    assert len(moved.vertices_m) == 3
    assert tomllib.loads(result.toml)["schema"] == 2
    below = imported(drawing, mover_side="below").actuator.moving.regions[0]  # mirrored: its flat side is on top
    assert drawn(below) == pytest.approx(math.pi * 16 / 4, rel=CHORDS)
    assert sorted(below.vertices_m) == [(0, 0), (0, 0.004), (0.004, 0.004)]


def test_parts_that_share_an_arc_have_its_corners_in_common():
    drawing = suspension()
    drawing.materials["Shell"] = {"Mu_x": 100, "Mu_y": 100}
    drawing.line((0, 26), (0, 40))
    drawing.arc((0, 30), (0, 36), 180)  # a ball
    drawing.arc((0, 26), (0, 40), 180)  # in a shell, which is a ring with a hole that is cut
    drawing.line((3, 33), (7, 33))  # of two halves in different groups
    drawing.label(1, 33, STEEL, group=7)
    drawing.label(5, 31, "Shell", group=7)
    drawing.label(5, 35, "Shell", group=8)
    regions = imported(drawing, moving_groups=(7, 8)).actuator.moving.regions  # read back: nothing overlaps
    assert sum(map(drawn, regions)) == pytest.approx(math.pi * 49 / 2, rel=CHORDS)
    ball = next(region for region in regions if "steel" in region.name)
    assert (0.003, 0.007) in ball.vertices_m


def test_a_closed_pot_is_cut_into_pieces_without_holes():
    drawing = suspension()
    drawing.box(0, 12, -16, 0)  # steel all round the coil
    drawing.segments = [line for line in drawing.segments if not {line[0], line[1]} <= core_points(drawing)]
    drawing.labels[0][:2] = [10, -14]
    actuator = imported(drawing).actuator
    assert len(actuator.fixed) == 2
    assert area(actuator.fixed) == pytest.approx(12 * 16 - 4 * 10)
    assert polygon(actuator.fixed[0]).intersection(polygon(actuator.fixed[1])).area == pytest.approx(0)
    assert "cut into 2 pieces" in imported(drawing).toml


def core_points(drawing):
    return {drawing.points.index((r, z, 0)) for r, z in ((0, -12), (4, -12), (4, 0), (0, 0))}


def test_two_blocks_of_one_circuit_are_one_winding():
    drawing = suspension()
    drawing.line((5, -6), (9, -6))
    drawing.relabel(COPPER, turns=100, z=-9)
    drawing.label(7, -3, COPPER, circuit=1, turns=100, group=2)
    coil = imported(drawing).actuator.coil
    assert coil.turns == 200
    assert set(coil.vertices_m) == set(imported(suspension()).actuator.coil.vertices_m)


def test_the_wire_of_the_file_gives_diameter_and_resistance():
    drawing = suspension()
    drawing.materials[COPPER] = {"Sigma": 58, "LamType": 3, "NStrands": 1, "WireD": 0.4}
    coil = imported(drawing).actuator.coil
    assert coil.wire_diameter_m == pytest.approx(0.4e-3)
    # 200 turns of mean radius 7 mm; IEC copper has 58.0 MS/m
    assert coil.resistance_ohm == pytest.approx(200 * 2 * math.pi * 7e-3 / (58e6 * math.pi * 0.2e-3**2), rel=1e-3)
    drawing.materials[COPPER] = {"Sigma": 58, "LamType": 5, "NStrands": 7, "WireD": 0.1}
    coil = imported(drawing).actuator.coil
    assert coil.wire_diameter_m is None
    assert coil.resistance_ohm == pytest.approx(200 * 2 * math.pi * 7e-3 / (7 * 58e6 * math.pi * 0.05e-3**2), rel=1e-3)


def test_options_give_what_the_file_has_not():
    options = {"mass_g": 12.5, "resistance_ohm": 3.5, "wire_diameter_mm": 0.3, "name": "given"}
    result = imported(suspension(), **options)
    actuator = result.actuator
    assert (actuator.name, actuator.coil.resistance_ohm) == ("given", 3.5)
    assert actuator.mechanics.mass_kg == pytest.approx(12.5e-3)
    assert not codes(result) & {"assumed-mass", "assumed-wire"}
    heavier = imported(suspension(), density_g_per_cm3=15.0).actuator
    assert heavier.mechanics.mass_kg == pytest.approx(2 * imported(suspension()).actuator.mechanics.mass_kg, rel=1e-4)


def test_the_sweep_holds_the_files_own_point():
    distances, currents = axis_option("1:3:0.5", "--distance-mm"), axis_option("0,1", "--current-A")
    sweep = imported(suspension(), distances_mm=distances, currents_A=currents).actuator.sweep
    assert sweep.distances_m == (0.001, 0.0015, 0.002, 0.0025, 0.003, 0.004)
    assert sweep.currents_A == (0.0, 1.0, 2.0)
    text = imported(suspension(), distances_mm=axis_option("1:6:0.5", "--distance-mm")).toml
    assert tomllib.loads(text)["sweep"]["distance_mm"] == {"start": 1, "stop": 6, "step": 0.5}


def test_shells_of_an_open_boundary_are_left_out():
    drawing = suspension(radius=80.0, boundary=0)
    for n, radius in enumerate((83.0, 86.0)):
        drawing.materials[f"u{n + 1}"] = {"Mu_x": 2.0 + n, "Mu_y": 2.0 + n}
        drawing.line((0, radius - 3), (0, radius))
        drawing.line((0, -radius + 3), (0, -radius))
        drawing.arc((0, -radius), (0, radius), 180, boundary=n)  # A = 0 on the outermost
        drawing.label(radius - 1.5, 0, f"u{n + 1}")
    result = imported(drawing)
    assert "open-boundary" in codes(result)
    assert len(result.actuator.fixed) == 1


@pytest.mark.parametrize("boundary", ["A = 0", "natural"])
def test_a_plain_boundary_is_left_out_with_its_distance(boundary):
    drawing = suspension(boundary=1 if boundary == "A = 0" else 0)
    (finding,) = [finding for finding in imported(drawing).findings if finding.code == "near-boundary"]
    assert boundary in finding.text
    # the half circle is 80 mm about (0, 0); the corner of the core is at (4, -12), of the coil at (9, -11)
    assert finding.size == pytest.approx(80 - math.hypot(9, 11), rel=1e-3)


@pytest.mark.parametrize(("kind", "code"), [(2, "mixed-boundary"), (3, "dual-image")])
def test_a_boundary_that_stands_for_an_open_one_is_left_out(kind, code):
    drawing = suspension()
    drawing.boundaries = {"ABC": {"BdryType": kind, "c0": 9.9e6}}
    assert code in codes(imported(drawing))


def test_a_default_label_names_the_faces_without_label():
    drawing = suspension()
    drawing.relabel(AIR, flags=2)
    drawing.box(20, 25, 20, 25)
    assert imported(drawing).actuator == imported(suspension()).actuator


def test_a_plunger_counts_its_distance_from_the_pole_before_it():
    drawing = FemDrawing()
    drawing.box(0, 5, -20, 0)  # pole
    drawing.box(6, 12, -18, 30)  # coil
    drawing.box(0, 5, 6, 50)  # plunger in the coil
    drawing.line((0, -200), (0, 200))
    drawing.arc((0, -200), (0, 200), 180, 1)
    drawing.label(2, -10, STEEL, group=1)
    drawing.label(9, 0, COPPER, circuit=1, turns=400, group=2)
    drawing.label(2, 20, STEEL, group=3)
    drawing.label(100, 0, AIR)
    result = imported(drawing, moving_groups=(3,))
    assert result.distance_m == 0.006
    assert "--face-mm: 30 or -18 or -20" in said(result, "frame").remedy
    other = imported(drawing, moving_groups=(3,), face_mm=-18.0)
    assert other.distance_m == 0.024
    assert said(other, "frame").remedy == ""
    mirrored = imported(drawing, moving_groups=(1,))  # the pole moves: it lies below the plunger
    assert mirrored.frame.up == -1
    assert mirrored.distance_m == 0.006


def test_in_an_open_bore_the_distance_counts_from_the_corner_passed_last():
    drawing = FemDrawing()
    drawing.box(6, 12, -20, 20)  # coil in a steel tube
    drawing.box(12, 15, -25, 25)
    drawing.box(0, 5, -4, 40)
    drawing.line((0, -200), (0, 200))
    drawing.arc((0, -200), (0, 200), 180, 1)
    drawing.label(9, 0, COPPER, circuit=1, turns=400, group=2)
    drawing.label(13, 0, STEEL, group=1)
    drawing.label(2, 20, STEEL, group=3)
    drawing.label(100, 0, AIR)
    result = imported(drawing, moving_groups=(3,))
    assert "open-bore" in codes(result)
    assert result.distance_m == 0.016  # from the coil's lower end
    assert imported(drawing, moving_groups=(3,), face_mm=-25.0).distance_m == 0.021


def test_a_block_can_be_named_to_move():
    drawing = suspension()
    drawing.materials["Nickel"] = {"Mu_x": 100, "Mu_y": 100}
    drawing.box(0, 3, 20, 22)
    drawing.label(1, 21, "Nickel", group=9)
    by_rule = imported(drawing).actuator
    assert [region.name for region in by_rule.moving.regions] == ["n40"]
    by_name = imported(drawing, moving_blocks=("Nickel",)).actuator
    assert [region.name for region in by_name.moving.regions] == ["nickel"]
    assert {region.name for region in by_name.fixed} == {"pure_steel", "n40"}


def test_pieces_that_move_together_are_joined_by_their_spacer():
    drawing = suspension()
    drawing.materials["Brass"] = {"Sigma": 15}
    drawing.box(0, 3, 9, 11)
    drawing.box(0, 3, 11, 14)
    drawing.label(1, 10, "Brass", group=3)
    drawing.label(1, 12, STEEL, group=3)
    actuator = imported(drawing, moving_groups=(3,)).actuator
    assert {region.name for region in actuator.moving.regions} == {"n40", "pure_steel_2", "brass"}


def test_names_that_toml_or_a_region_cannot_hold_are_escaped():
    drawing = suspension()
    drawing.materials["1018 \\ St\u00e4hl"] = drawing.materials[STEEL]
    drawing.relabel(STEEL, name="1018 \\ St\u00e4hl")
    (region,) = imported(drawing).actuator.fixed
    assert region.name == "part_1018_st_hl"
    assert region.material.name == "1018 \\ St\u00e4hl"
