"""No text, however damaged, brings anything but an actuator or an ActuatorFileError."""

import contextlib

import numpy as np
from benchmarks.mutants import DRAWINGS, damaged_file, use_actuator
from hypothesis import given, settings
from hypothesis import strategies as st

from femfit.core.errors import ActuatorFileError
from femfit.device.load import actuator_from_toml
from femfit.device.rewrite import variants_from_toml
from support.actuators import GEOMETRY

PLUNGER, RIG = ((GEOMETRY / f"{name}.toml").read_text(encoding="utf-8") for name in ("plunger-solenoid", "emaws-rig"))
SETTINGS = settings(max_examples=60, deadline=None, derandomize=True)


def load_or_refuse(text, directory=GEOMETRY):
    with contextlib.suppress(ActuatorFileError):
        use_actuator(actuator_from_toml(text, "mutant", directory))


@SETTINGS
@given(st.integers(0, 10**6))
def test_drawings_with_damaged_lines_load_or_are_refused(seed):
    random = np.random.default_rng(seed)
    path = DRAWINGS[random.integers(len(DRAWINGS))]
    content = damaged_file(path.read_bytes(), ".toml", PLUNGER.encode(), random)
    load_or_refuse(content.decode(errors="replace"), path.parent)


NUMBERS = st.floats(-30, 60, allow_nan=False).map(lambda value: round(value, 2))


@SETTINGS
@given(st.lists(st.tuples(NUMBERS, NUMBERS), min_size=1, max_size=8))
def test_any_polygon_is_drawn_or_refused(corners):
    text = PLUNGER
    assert "r_mm = [0, 5]\nz_mm = [0, 35]" in text
    polygon = f"polygon_mm = {[list(corner) for corner in corners]}"
    load_or_refuse(text.replace("r_mm = [0, 5]\nz_mm = [0, 35]", polygon))


@settings(max_examples=30, deadline=None, derandomize=True)
@given(st.integers(-50, 50), st.integers(1, 400), st.integers(1, 200), st.integers(0, 4))
def test_a_range_is_the_decimals_counted_by_hand(start, count, step, digits):
    scale = 10**digits
    axis = f"{{ start = {start / scale}, stop = {(start + count * step) / scale}, step = {step / scale} }}"
    text = PLUNGER.replace("{ start = 0, stop = 1, step = 0.25 }", axis)
    currents = actuator_from_toml(text).sweep.currents_A
    # Integers divided once are the doubles nearest to the decimals.
    assert currents == tuple((start + k * step) / scale for k in range(count + 1))


VALUES = st.sampled_from([
    *("nan", "inf", "1e300", "-1", "true", '"x"', "[]", "{}", "[[1]]", "{ min = 1 }", "{ start = 0, stop = 1 }"),
    *("[1, 2]", "{ min = 1, max = 2 }", '{ keys = ["coils.coil.turns"], values = [1, 2] }'),
])  # fmt: skip
NAMES = st.sampled_from(
    ['"coils.coil.turns"', "coils.coil.turns", "coil", "a_mm", "current_A", '"sensors.hall.z_mm"', '""', "'[0]'", "n"]
)
HEADS = ["", 'design = "latin_hypercube"\nsamples = 20\nseed = 7', 'design = "list"', "seed = 3"]


@SETTINGS
@given(st.dictionaries(NAMES, VALUES, max_size=3), st.sampled_from(HEADS))
def test_any_table_of_parameters_gives_variants_or_an_actuator_error(parameters, head):
    lines = "\n".join(f"{name} = {value}" for name, value in parameters.items())
    with contextlib.suppress(ActuatorFileError):
        swept = variants_from_toml(RIG.replace("[sweep]", f"[sweep.parameters]\n{lines}\n[sweep]\n{head}\n", 1))
        assert len(swept.variants) >= 1
        assert all(len(one.values) == len(swept.columns) for one in swept.variants)
