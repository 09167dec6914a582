"""Which numbers of a file are one face."""

import tomllib

import pytest

from femfit.device.drawn_faces import drawn_faces
from femfit.device.drawn_numbers import numbers_from_toml, read_numbers
from femfit.device.load import parse, read_text
from support.actuators import GEOMETRY
from support.eddy_pot import TWO_WINDINGS


def _keys(name):
    return {number.facts.key: number.facts.also for number in read_numbers(GEOMETRY / f"{name}.toml")}


def test_parts_that_touch_share_the_face_between_them():
    keys = _keys("emaws-rig")
    flange, sleeve = (f"fixed.regions.{name}" for name in ("upper_flange", "sleeve"))
    assert keys[f"{flange}.z_mm[1]"] == (f"{sleeve}.z_mm[0]", "coils.coil.z_mm[0]")
    assert keys[f"{flange}.r_mm[1]"] == ()  # in line with the coil's outside, which it meets in a point


def test_a_face_of_a_polygon_is_all_corners_along_it():
    assert _keys("solenoid")["fixed.regions.frame.polygon_mm[3][0]"] == ("fixed.regions.frame.polygon_mm[4][0]",)


def test_what_the_drawing_counts_from_is_no_number():
    keys = _keys("emaws-rig")
    assert "moving.regions.magnet.z_mm[0]" not in keys
    assert "moving.regions.magnet.r_mm[0]" not in keys  # the axis


def test_a_ball_stays_on_its_zero_as_its_radius_changes():
    assert _keys("ball")["moving.regions.ball.circle_mm[2]"] == ("moving.regions.ball.circle_mm[1]",)


def test_what_the_catalogue_has_exactly_is_left_to_it():
    numbers = read_numbers(GEOMETRY / "voice-coil.toml")
    left = {number.facts.key: number.facts.effect for number in numbers if number.facts.effect}
    assert left == {"coils.voice.turns": "turns", "materials.n42.remanence_T": "remanence"}


def test_turns_of_several_circuits_are_effects_of_each():
    left = {one.facts.key: one.facts.effect for one in numbers_from_toml(TWO_WINDINGS) if one.facts.kind == "turns"}
    assert left == {"coils.inner.turns": "turns:inner", "coils.outer.turns": "turns:outer"}


@pytest.mark.parametrize("name", ["solenoid", "bearing", "voice-coil"])
def test_the_side_of_a_polygons_face_does_not_depend_on_the_sense_of_its_corners(name):
    data = parse(read_text(GEOMETRY / f"{name}.toml"), name)
    regions = {**data["fixed"]["regions"]}
    turned = {key: {**table} for key, table in regions.items()}
    for table in turned.values():
        if "polygon_mm" in table:
            table["polygon_mm"] = table["polygon_mm"][::-1]
    before = sorted((face.axis, face.value, len(face.locations)) for face in drawn_faces(data))
    data["fixed"] = {"regions": turned}
    assert sorted((face.axis, face.value, len(face.locations)) for face in drawn_faces(data)) == before


ROUNDED = """
[fixed.regions.bottom]
material = "air"
polygon_mm = [[10, 0], [30, 0], [34, 4, 4], [34, 8], [30, 8], [10, 8]]
[coils.bottom]
r_mm = [12, 20]
z_mm = [2, 6]
"""


def test_a_coil_and_a_part_of_one_name_are_told_apart():
    labels = {face.label.partition(":")[0] for face in drawn_faces(tomllib.loads(ROUNDED))}
    assert labels == {"bottom", "coil bottom"}


@pytest.mark.parametrize(
    ("corners", "label"),
    [
        ([[10, 0], [34, 0, 60], [34, 8], [10, 8]], "bottom: rounded edge at r = 34 mm"),
        ([[10, 0], [30, 0], [34, 4, 45], [34, 8], [30, 8], [10, 8]], "bottom: rounded edge from r = 30 to 34 mm"),
    ],
)
def test_an_arc_is_a_rounded_edge_and_no_slanted_face(corners, label):
    data = tomllib.loads(f'[fixed.regions.bottom]\nmaterial = "air"\npolygon_mm = {corners}')
    assert label in {face.label for face in drawn_faces(data)}
