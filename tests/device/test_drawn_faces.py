"""Which numbers of a file are one face, and what a machinist calls it: a face with the cone beside it is one number."""

import math
import tomllib
from functools import cache

import pytest
import shapely

from femfit.core.errors import UsageError
from femfit.device.drawn_faces import drawn_faces
from femfit.device.drawn_numbers import in_picture, numbers_from_toml, read_numbers
from femfit.device.load import parse, read_text
from femfit.device.outlines import arc_points, circle, flattened, reversed_outline
from femfit.identify.calibration.numbers import Drawing
from support.actuators import GEOMETRY
from support.small_drawing import CONICAL, TWO_WINDINGS


@cache
def facts(name):
    return {one.facts.key: one.facts for one in read_numbers(GEOMETRY / f"{name}.toml")}


@pytest.mark.parametrize(
    ("name", "key", "moves"),
    [
        ("emaws-rig", "fixed.regions.upper_flange.z_mm[1]", ("fixed.regions.sleeve.z_mm[0]", "coils.coil.z_mm[0]")),
        ("emaws-rig", "fixed.regions.upper_flange.r_mm[1]", ()),  # in line with the coil, which it meets in a point
        ("solenoid", "fixed.regions.frame.polygon_mm[3][0]", ("fixed.regions.frame.polygon_mm[4][0]",)),
        ("ball", "moving.regions.ball.circle_mm[2]", ("moving.regions.ball.circle_mm[1]",)),  # it stands on its zero
        ("emaws-rig", "moving.regions.magnet.z_mm[0]", None),  # from which the drawing counts
        ("emaws-rig", "moving.regions.magnet.r_mm[0]", None),  # the axis
    ],
)
def test_a_face_moves_all_that_touches_it_and_what_the_drawing_counts_from_is_none(name, key, moves):
    assert getattr(facts(name).get(key), "also", None) == moves


def test_what_the_catalogue_has_exactly_is_left_to_it():
    one = {number.key: number.effect for number in facts("voice-coil").values() if number.effect}
    two = {each.facts.key: each.facts.effect for each in numbers_from_toml(TWO_WINDINGS) if each.facts.kind == "turns"}
    assert one == {"coils.voice.turns": "turns", "materials.n42.remanence_T": "remanence"}
    assert two == {"coils.inner.turns": "turns:inner", "coils.outer.turns": "turns:outer"}


@pytest.mark.parametrize("name", ["solenoid", "bearing", "voice-coil"])
def test_the_side_of_a_polygons_face_does_not_depend_on_the_sense_of_its_corners(name):
    def faces():
        return sorted((face.axis, face.value, len(face.locations)) for face in drawn_faces(data))

    data = parse(read_text(GEOMETRY / f"{name}.toml"), name)
    before = faces()
    for table in data["fixed"]["regions"].values():
        if "polygon_mm" in table:
            table["polygon_mm"] = table["polygon_mm"][::-1]
    assert faces() == before


def test_a_coil_and_a_part_of_one_name_are_told_apart():
    regions = {"bottom": {"material": "air", "polygon_mm": [[10, 0], [30, 0], [34, 4, 4], [34, 8], [30, 8], [10, 8]]}}
    coils = {"bottom": {"r_mm": [12, 20], "z_mm": [2, 6]}}
    labels = {face.label.partition(":")[0] for face in drawn_faces({"fixed": {"regions": regions}, "coils": coils})}
    assert labels == {"bottom", "coil bottom"}


FRAME = "fixed.regions.frame.polygon_mm"
POLE = f"{FRAME}[8..10][1]"


@pytest.fixture(scope="module")
def numbers():
    return {one.facts.key: one for one in numbers_from_toml(CONICAL)}


def test_a_pole_face_moves_with_its_cone(numbers):
    pole = numbers[POLE]
    assert pole.facts.also == tuple(f"{FRAME}[{corner}][1]" for corner in (8, 9, 10))
    assert (pole.facts.value, pole.facts.unit, pole.facts.stands_for) == (5.0, "mm", f"{FRAME}[8][1]")
    before, after = (one.fixed[0].vertices_m for one in (pole.smaller, pole.larger))
    moved = {k: 1e3 * (b[1] - a[1]) for k, (a, b) in enumerate(zip(before, after, strict=True)) if a != b}
    assert moved == pytest.approx(dict.fromkeys((8, 9, 10), 2.0 * pole.step))


@pytest.mark.parametrize("name", ["emaws-rig", "plunger-solenoid", "bearing", "voice-coil"])
def test_no_two_numbers_of_a_drawing_have_one_name(name):
    titles = [number.title for number in facts(name).values()]
    assert len(set(titles)) == len(titles)


def test_a_picture_marks_a_face_with_its_cone_for_the_one_without(numbers):
    marked = {one.key: one for one in in_picture(one.facts for one in numbers.values())}
    assert POLE in marked
    assert f"{FRAME}[8][1]" not in marked
    assert f"{FRAME}[10][1]" in marked
    assert marked[POLE].at == (7.0, 5.0)


@pytest.mark.parametrize("name", ["frame: face at z = 5 mm with its cone", "5 mm with its cone", POLE])
def test_a_face_is_asked_for_by_its_name(name, tmp_path):
    drawing = Drawing(CONICAL, "conical.toml", tmp_path)
    (wanted,) = drawing.wanted(tuple(piece.strip() for piece in name.split(",")))  # as the command takes lists apart
    assert wanted.key == POLE
    written = tomllib.loads(drawing.with_values([wanted], [4.8]).text)["fixed"]["regions"]["frame"]["polygon_mm"]
    assert [corner[1] for corner in written[8:]] == [4.8, 4.8, -0.0889]
    assert written[:8] == tomllib.loads(CONICAL)["fixed"]["regions"]["frame"]["polygon_mm"][:8]
    assert "# turned" in drawing.with_values([wanted], [4.8]).text


def test_a_face_and_a_corner_of_it_are_not_calibrated_together(tmp_path):
    drawing = Drawing(CONICAL, "conical.toml", tmp_path)
    with pytest.raises(UsageError, match="corner"):
        drawing.wanted((POLE, f"{FRAME}[10][1]"))
    both = drawing.wanted(("frame.polygon_mm[9][1]", "frame.polygon_mm[10][1]"))
    assert [one.key for one in both] == [f"{FRAME}[8][1]", f"{FRAME}[10][1]"]
    assert not any(one.is_contour for one in drawing.wanted("all"))


def test_a_tolerance_of_its_flat_part_or_of_its_own_is_a_faces_tolerance():
    def tolerance(line):
        every = numbers_from_toml(f"{CONICAL}\n[tolerances]\n{line}\n")
        (pole,) = (one.facts for one in every if one.facts.key == POLE)
        return pole.tolerance, pole.declared

    assert tolerance(f'"{FRAME}[8][1]" = 0.02') == (0.02, True)
    assert tolerance(f'"{POLE}" = 0.03') == (0.03, True)
    assert tolerance("length_mm = 0.04") == (0.04, True)
    assert tolerance('"coils.winding.turns" = 2') == (0.05, False)


@pytest.mark.parametrize(("centre", "area"), [((0.0, 3.0), 2.0 * math.pi), ((5.0, 1.0), 4.0 * math.pi)])
def test_a_circle_has_its_area_and_turns_counter_clockwise(centre, area):
    polygon = shapely.Polygon(flattened(*circle(centre, 2.0)))
    assert polygon.exterior.is_ccw
    assert polygon.area == pytest.approx(area, rel=3e-4)
    assert polygon.bounds[0] >= 0.0


def test_the_other_sense_of_an_outline_and_of_an_arc_has_the_same_points():
    corners, bulges = [(0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (0.0, 1.0)], [0.3, 0.0, -0.2, 0.0]
    there = shapely.Polygon(flattened(corners, bulges))
    back = shapely.Polygon(flattened(*reversed_outline(corners, bulges)))
    assert not back.exterior.is_ccw
    assert there.symmetric_difference(back).area < 1e-12
    there = arc_points((1.0, 0.0), (0.0, 1.0), 0.4)
    back = arc_points((0.0, 1.0), (1.0, 0.0), -0.4)
    for one, other in zip(there, back[::-1], strict=True):
        assert one == pytest.approx(other, abs=1e-14)
