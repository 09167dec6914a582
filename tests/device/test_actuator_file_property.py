"""Whatever numbers, polygons and parameters a drawing has, it becomes an actuator or an ActuatorFileError."""

import contextlib

from benchmarks.mutants import use_actuator
from hypothesis import given, settings
from hypothesis import strategies as st

from femfit.core.errors import ActuatorFileError
from femfit.device.load import actuator_from_toml
from femfit.device.rewrite import variants_from_toml
from support.actuators import GEOMETRY

PLUNGER, RIG = ((GEOMETRY / f"{name}.toml").read_text(encoding="utf-8") for name in ("plunger-solenoid", "emaws-rig"))
SETTINGS = settings(max_examples=60, deadline=None, derandomize=True)
NUMBERS = st.floats(-30, 60, allow_nan=False).map(lambda value: round(value, 2))


@SETTINGS
@given(st.lists(st.tuples(NUMBERS, NUMBERS), min_size=1, max_size=8))
def test_any_polygon_is_drawn_or_refused(corners):
    before, after = PLUNGER.split("r_mm = [0, 5]\nz_mm = [0, 35]")
    with contextlib.suppress(ActuatorFileError):
        use_actuator(actuator_from_toml(f"{before}polygon_mm = {[list(corner) for corner in corners]}{after}"))


@settings(max_examples=30, deadline=None, derandomize=True)
@given(st.integers(-50, 50), st.integers(1, 400), st.integers(1, 200), st.integers(0, 4))
def test_a_range_is_the_decimals_counted_by_hand(start, count, step, digits):
    scale = 10**digits
    axis = f"{{ start = {start / scale}, stop = {(start + count * step) / scale}, step = {step / scale} }}"
    currents = actuator_from_toml(PLUNGER.replace("{ start = 0, stop = 1, step = 0.25 }", axis)).sweep.currents_A
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
