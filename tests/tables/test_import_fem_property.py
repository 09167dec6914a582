"""Whatever happens to a FEMM file, it becomes an actuator or one of femfit's errors."""

import re

from hypothesis import example, given, settings
from hypothesis import strategies as st

from femfit.core.errors import FemfitError
from femfit.device.load import actuator_from_toml
from femfit.tables.femm.options import FemOptions, axis_option
from femfit.tables.femm.read import import_fem
from support.fem_files import AIR, COPPER, MAGNET, STEEL, suspension

MODEL = suspension()
MODEL.materials[STEEL]["curve"] = ((0, 0), (1.1, 180.5), (1.6, 3000), (1.9, 16000), (2.2, 110000))
TEXT = MODEL.text()
LINES = TEXT.splitlines()
NUMBERS = [match.span() for match in re.finditer(r"-?\d+\.?\d*(?:e-?\d+)?", TEXT)]
QUICK = settings(max_examples=60, deadline=None)


def outcome(content, options=None):
    """The imported model, or None for an error of ours; anything else fails the test."""
    try:
        imported = import_fem(content, "model.fem", options)
    except FemfitError:
        return None
    assert actuator_from_toml(imported.toml) == imported.actuator
    assert imported.current_A in imported.actuator.sweep.currents_A
    assert imported.distance_m in imported.actuator.sweep.distances_m
    return imported


def test_the_unchanged_model_is_imported():
    assert outcome(TEXT.encode()) is not None


@QUICK
@given(content=st.binary(max_size=300))
@example(content=b"[Format]\n[NumPoints]\n[NumBlockLabels]")
def test_random_bytes(content):
    outcome(content)


@QUICK
@given(lines=st.lists(st.sampled_from([*LINES, "", "<BeginBlock>", "[NumHoles] = 1", "[", "<", '"']), max_size=80))
def test_lines_of_a_model_in_any_order(lines):
    outcome("\n".join(["[Format] = 4.0", *lines]).encode())


@QUICK
@given(drop=st.sets(st.integers(0, len(LINES) - 1), min_size=1, max_size=4))
def test_lines_left_out(drop):
    outcome("\n".join(line for n, line in enumerate(LINES) if n not in drop).encode())


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


@QUICK
@given(
    shifts=st.lists(st.tuples(st.integers(0, len(MODEL.points) - 1), st.floats(-3, 3), st.floats(-3, 3)), max_size=6),
    extra=st.lists(st.tuples(st.floats(0, 10), st.floats(-15, 15), st.floats(0, 10), st.floats(-15, 15)), max_size=3),
    default=st.booleans(),
)
def test_points_moved_and_lines_added(shifts, extra, default):
    drawing = suspension()
    for n, dr, dz in shifts:
        r, z, prop = drawing.points[n]
        drawing.points[n] = (r + dr, z + dz, prop)
    for r0, z0, r1, z1 in extra:
        drawing.line((r0, z0), (r1, z1))
    if default:
        drawing.relabel("Air", flags=2)
    outcome(drawing.content())


@QUICK
@given(
    group=st.sampled_from([1, 2, 3, 9]),
    side=st.sampled_from(["auto", "above", "below"]),
    face=st.none() | st.floats(-20, 20),
    axis=st.sampled_from(["1:9:0.5", "-1,4", "4", "0.1:40:0.1", "1e-7,3"]),
    degrees=st.floats(0.1, 30),
)
def test_options_of_any_kind(group, side, face, axis, degrees):
    options = FemOptions(
        moving_groups=(group,),
        mover_side=side,
        face_mm=face,
        distances_mm=axis_option(axis, "--distance-mm"),
        arc_degrees=degrees,
    )
    outcome(TEXT.encode(), options)


@QUICK
@given(text=st.text(max_size=30))
def test_axes_as_typed(text):
    try:
        values = axis_option(text, "--current-A")
    except FemfitError:
        return
    assert list(values) == sorted(set(values))


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
        st.tuples(st.integers(0, 12), st.integers(1, 6), st.integers(-20, 30), st.integers(1, 10), LABELS), max_size=3
    ),
    arc=st.booleans(),
    moving=st.lists(st.integers(1, 7), max_size=2),
)
def test_labels_and_bodies_of_every_kind(changes, boxes, arc, moving):
    drawing = suspension(distance=5.0)
    drawing.materials |= {"Current": {"J_re": 3}, "Back": {"J_re": -3}}
    drawing.circuits["second"] = {"TotalAmps_re": -1, "CircuitType": 1}
    for name, values in changes.items():
        drawing.relabel(name, **values)
    for r, width, z, height, values in boxes:
        drawing.box(r, r + width, z, z + height)
        drawing.label(
            r + width / 2 + 0.01, z + height / 2 + 0.01, values.get("name", STEEL), group=values.get("group", 0)
        )
    if arc:
        drawing.arc((0, 40), (0, 46), 180)
        drawing.label(1, 43, STEEL, group=3)
    outcome(drawing.content(), FemOptions(moving_labels=tuple(moving)))
