"""FEMM files: the same actuator however it is drawn, every offer is taken, no text brings another error."""

import re

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from femfit.core.errors import FemfitError
from femfit.device.load import actuator_from_toml
from femfit.tables.femm.model import FemOptions
from femfit.tables.femm.read import import_fem
from support.fem_files import SUSPENSION, UNIT_MM, suspension

CURVE = "5\n0 0\n1.1 180.5\n1.6 3000\n1.9 16000\n2.2 110000"
TEXT = SUSPENSION.replace("<Mu_y> = 500\n    <BHPoints> = 0", f"<Mu_y> = 500\n    <BHPoints> = {CURVE}")
LINES = TEXT.splitlines()
NUMBERS = [match.span() for match in re.finditer(r"-?\d+\.?\d*(?:e-?\d+)?", TEXT)]
QUICK = settings(max_examples=40, deadline=None)
NANOMETRE = 1e-9


def imported(text, **options):
    return import_fem(text.encode(), "model.fem", FemOptions(**options))


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
        imported(suspension(unit, below=below, face=face)).actuator,
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
