"""FEMM files: the same actuator however it is drawn, every offer is taken, no text brings another error."""

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from femfit.core.errors import FemFileError, FemfitError
from femfit.device.load import actuator_from_toml
from femfit.tables.femm.model import FemOptions
from femfit.tables.femm.read import axis_option, import_fem
from support.fem_files import AIR, COPPER, MAGNET, STEEL, UNIT_MM, suspension

MODEL = suspension()
MODEL.materials[STEEL]["curve"] = ((0, 0), (1.1, 180.5), (1.6, 3000), (1.9, 16000), (2.2, 110000))
TEXT = MODEL.text()
LINES = TEXT.splitlines()
NUMBERS = [match.span() for match in re.finditer(r"-?\d+\.?\d*(?:e-?\d+)?", TEXT)]
QUICK = settings(max_examples=40, deadline=None)
NANOMETRE = 1e-9


def imported(drawing, **options):
    return import_fem(drawing.content(), "model.fem", FemOptions(**options))


def outcome(content, options=None):
    """The imported model, or None for an error of ours; anything else fails the test."""
    try:
        result = import_fem(content, "model.fem", options)
    except FemfitError:
        return None
    assert actuator_from_toml(result.toml) == result.actuator
    assert result.current_A in result.actuator.sweep.currents_A
    assert result.distance_m in result.actuator.sweep.distances_m
    return result


@settings(max_examples=15, deadline=None)
@given(unit=st.sampled_from(sorted(UNIT_MM)), below=st.booleans(), face=st.sampled_from([0.0, -37.25, 12.5]))
def test_a_drawing_in_other_units_upside_down_or_shifted_is_the_same_actuator(unit, below, face):
    expected, actuator = (
        imported(suspension()).actuator,
        imported(suspension(unit=unit, below=below, face=face)).actuator,
    )
    assert actuator.sweep == expected.sweep
    pairs = zip(
        (*actuator.fixed, *actuator.moving.regions, *actuator.coils),
        (*expected.fixed, *expected.moving.regions, *expected.coils),
        strict=True,
    )
    for part, same in pairs:
        np.testing.assert_allclose(sorted(part.vertices_m), sorted(same.vertices_m), atol=NANOMETRE)
        # a mirror at a plane z = const leaves axial moments and currents as they are
        assert getattr(part, "material", None) == getattr(same, "material", None)


def test_every_mover_that_a_message_offers_is_taken_at_once():
    drawing = suspension()  # no magnet, and a body behind the first; the core has neither group nor material of its own
    drawing.relabel(MAGNET, name=STEEL)
    drawing.box(0, 3, 20, 25)
    drawing.label(1, 22, STEEL, group=8)
    drawing.relabel(COPPER, group=0)
    drawing.labels[0][5] = 0
    with pytest.raises(FemFileError) as refused:
        imported(drawing)
    (problem,) = refused.value.problems
    offered = re.findall(r"(--moving-\w+) (\S+) for block '(.*?)' at \(r, z\) = \((\S+), (\S+)\)", problem)
    kinds = {"--moving-group": "moving_groups", "--moving-label": "moving_labels", "--moving-block": "moving_blocks"}
    assert {option for option, *_ in offered} == set(kinds)
    for option, value, name, _, z in offered:
        toml = imported(drawing, **{kinds[option]: (value if option == "--moving-block" else int(value),)}).toml
        _, moving = toml.split("[mechanics]")
        assert (f"'{name}'" in moving and f", {z})" in moving) or "moves = true" in toml


@pytest.mark.parametrize(
    "text", ["", "a", "1:2", "1:2:-1", "1:2:0.3", "2:1:0.5", "1,,2", "1:2:1,3", "nan", "1e9", "0:1:1e-9"]
)
def test_axes_that_are_none_are_refused(text):
    with pytest.raises(FemFileError, match="--distance-mm"):
        axis_option(text, "--distance-mm")


@QUICK
@given(lines=st.lists(st.sampled_from([*LINES, "", "<BeginBlock>", "[NumHoles] = 1", "[", "<", '"']), max_size=80))
def test_lines_of_a_model_in_any_order(lines):
    outcome("\n".join(["[Format] = 4.0", *lines]).encode())


@QUICK
@given(
    places=st.lists(st.sampled_from(NUMBERS), min_size=1, max_size=3, unique=True),
    value=st.one_of(
        st.sampled_from(["0", "-1", "1", "2", "1e300", "nan", "1e-300", "", "x", "1_0", "9" * 21, "0x1"]),
        st.floats(-100, 100, allow_subnormal=False).map(repr),
    ),
)
def test_numbers_replaced(places, value):
    text = TEXT
    for start, stop in sorted(places, reverse=True):
        text = text[:start] + value + text[stop:]
    outcome(text.encode())


LABELS = st.fixed_dictionaries(
    {},
    optional={
        "name": st.sampled_from([AIR, STEEL, MAGNET, COPPER, "Current", "Back"]),
        "circuit": st.integers(0, 2),
        "magdir": st.sampled_from([0, 45, 90, -90, 180]),
        "group": st.integers(0, 3),
        "turns": st.sampled_from([1, 100, -50]),
        "flags": st.integers(0, 2),
    },
)


@QUICK
@given(
    changes=st.dictionaries(st.sampled_from([AIR, STEEL, MAGNET, COPPER]), LABELS, max_size=4),
    boxes=st.lists(
        st.tuples(st.integers(0, 12), st.integers(1, 6), st.integers(-20, 30), st.integers(1, 10), LABELS), max_size=2
    ),
    shifts=st.lists(st.tuples(st.integers(0, 13), st.floats(-3, 3), st.floats(-3, 3)), max_size=3),
    arc=st.booleans(),
    options=st.builds(
        FemOptions,
        moving_labels=st.lists(st.integers(1, 7), max_size=2).map(tuple),
        moving_groups=st.lists(st.sampled_from([1, 3, 9]), max_size=1).map(tuple),
        mover_side=st.sampled_from(["auto", "above", "below"]),
        face_mm=st.none() | st.floats(-20, 20),
        distances_mm=st.sampled_from([(), (-1.0, 4.0), (4.0,), (1e-7, 3.0)]),
        arc_degrees=st.sampled_from([1.0, 5.0, 30.0]),
    ),
)
def test_drawings_and_options_of_every_kind(changes, boxes, shifts, arc, options):
    drawing = suspension(distance=5.0)
    drawing.materials |= {"Current": {"J_re": 3}, "Back": {"J_re": -3}}
    drawing.circuits["second"] = {"TotalAmps_re": -1, "CircuitType": 1}
    for name, values in changes.items():
        drawing.relabel(name, **values)
    for n, dr, dz in shifts:
        r, z, prop = drawing.points[n]
        drawing.points[n] = (r + dr, z + dz, prop)
    for r, width, z, height, values in boxes:
        drawing.box(r, r + width, z, z + height)
        drawing.label(
            r + width / 2 + 0.01, z + height / 2 + 0.01, values.get("name", STEEL), group=values.get("group", 0)
        )
    if arc:
        drawing.arc((0, 40), (0, 46), 180)
        drawing.label(1, 43, STEEL, group=3)
    outcome(drawing.content(), options)
