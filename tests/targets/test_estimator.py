"""The exported file runs where only Python is, and gives femfit's numbers, for one body and for many."""

import csv
import io
import json
import runpy
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from femfit.core.errors import MissingPartError, RunDirectoryError, UsageError
from femfit.device.electrics import Drive
from femfit.device.mechanics import Stop
from femfit.estimate.kalman_filter import kalman_filter
from femfit.model.with_effects import with_effects
from femfit.simulation.plant import Plant
from femfit.targets import estimator
from femfit.targets.estimator import FILE, NEW, export_estimator
from femfit.targets.splined import NEAR, splined
from support.added_effects import added, usually
from support.eddies import with_eddies
from support.halves import cut_in_two
from support.parts import with_circuit, with_motion
from support.readings import LASER, SHUNT, predict_sensors

FILES = {FILE, "README.md", "model.json", "LICENSE"}

IN_THE_BARE_ENVIRONMENT = """
import json, runpy, sys
try:
    import numpy
except ModuleNotFoundError:
    made = runpy.run_path(sys.argv[1])
else:
    raise SystemExit("numpy is importable: the environment is not bare")
given = json.load(open(sys.argv[2]))
followed = []
for kind in ("ukf", "ekf"):
    filter_ = made["Filter"](kind)
    filter_.start(given["start"])
    for volts, readings in zip(given["volts"], given["readings"]):
        filter_.step(volts, [float("nan") if value is None else value for value in readings])
        followed.append([*filter_.mean, *filter_.deviations(), filter_.status & ~8])
plant = made["Plant"](given["start"])
moved = [list(plant.step(volts)) for volts in given["volts"]]
json.dump([followed, moved], sys.stdout)
"""


def halves(model):
    return cut_in_two(replace(model, sensor=None, other_sensors=(LASER, replace(SHUNT, circuit="inner"))))


def under_several(model):
    return with_effects(model, [
        added("core_saturation", mmf_loss_3=0.03), added("eddy_current_lag", ring_share=0.03),
        added("hall_saturation", cubic_loss=0.03), added("coulomb_friction", level=0.02),
    ])  # fmt: skip


def between_stops(model):
    return with_motion(model, near_stop=Stop(0.02195, 0.3), far_stop=Stop(0.02202))


def freewheeling(model):
    return with_circuit(model, voltage_min_V=0.0, drive=Drive(diode_V=0.7))


KINDS = {
    "freewheeling": freewheeling,
    "between stops": between_stops,
    "with eddy currents between stops": lambda model: between_stops(with_eddies(model)),
    "as fitted": lambda model: model,
    "under effects": under_several,
    "two circuits": halves,
}


@pytest.fixture(scope="module", params=KINDS)
def model(request, levitation_model):
    return KINDS[request.param](levitation_model)


@pytest.fixture(scope="module")
def exported(model, tmp_path_factory):
    place = tmp_path_factory.mktemp("export") / "estimator"
    export_estimator(model, place)
    return place


def run_bare(place, *arguments, code=None):
    """Python without site-packages and environment."""
    command = [sys.executable, "-I", "-S", "-W", "error", *(["-c", code] if code else []), *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=place)
    assert done.returncode == 0, done.stderr
    return done.stdout


def a_motion(model, steps=60, runs=1):
    """Start, voltages (steps, runs, n) and readings (steps, runs, sensors) of bodies that fall a little."""
    generator, n = np.random.default_rng(3), len(model.circuits)
    start = np.zeros((runs, model.order))
    start[:, 0], start[:, 2 : 2 + n] = 0.022 + 1e-4 * np.arange(runs), 0.32
    volts = 0.32 * model.resistances_ohm + generator.uniform(-0.2, 0.2, (steps, runs, n))
    volts[5::9] = 0.0  # where a switch is open beside a diode
    names = tuple(output.name for output in kalman_filter(model).process.outputs)
    readings = np.array([predict_sensors(model, states, names) for states in of_plant(model, start, volts)])
    readings += 1e-3 * generator.normal(size=readings.shape)
    readings[3::7, :, 0] = np.nan
    return start, volts, readings


def of_femfit(model, kind, start, volts, readings):
    """Means with deviations, and the outcome, after every step; (steps, runs, 2 states + 1)."""
    filter_ = kalman_filter(model, kind)
    first = np.zeros((len(start), filter_.process.order))
    first[:, : start.shape[1]] = start
    state, found = filter_.start(first), []
    for given, read in zip(volts, readings, strict=True):
        state = filter_.step(state, given[:, 0] if given.shape[1] == 1 else given, read)
        deviations = np.sqrt(np.diagonal(state.covariance, axis1=1, axis2=2))
        found.append(np.column_stack([state.mean, deviations, state.outcome]))
    return np.array(found)


def of_plant(model, start, volts):
    plant, states, found = Plant(model), start, []
    for given in volts:
        states = plant.step(states, given)
        found.append(states)
    return np.array(found)


def assert_alike(found, wanted, tolerance=1e-9):
    """Relative to the largest value of each number."""
    size = np.abs(wanted).max(axis=tuple(range(wanted.ndim - 1))) + 1e-12
    assert np.abs((found - wanted) / size).max() < tolerance


def test_without_any_library_one_body_is_followed_and_moved_as_by_femfit(model, exported, tmp_path):
    start, volts, readings = a_motion(model)
    sheet = np.where(np.isfinite(readings[:, 0]), readings[:, 0], None).tolist()
    given = {"start": start[0].tolist(), "volts": volts[:, 0].tolist(), "readings": sheet}
    (tmp_path / "given.json").write_text(json.dumps(given))
    followed, moved = json.loads(
        run_bare(exported, exported / FILE, tmp_path / "given.json", code=IN_THE_BARE_ENVIRONMENT)
    )
    wanted = np.concatenate([of_femfit(model, kind, start, volts, readings)[:, 0] for kind in ("ukf", "ekf")])
    assert not wanted[:, -1].any()
    assert_alike(np.array(followed), wanted)
    assert_alike(np.array(moved), of_plant(model, start, volts)[:, 0])


@pytest.mark.parametrize("kind", ["ukf", "ekf"])
def test_many_bodies_are_followed_and_moved_together_where_numpy_is(model, exported, kind):
    start, volts, readings = a_motion(model, steps=30, runs=4)
    made = runpy.run_path(str(exported / FILE))
    filter_, plant = made["Filter"](kind), made["Plant"](list(start.T))
    filter_.start(list(start.T))
    followed, moved = [], []
    for given, read in zip(volts, readings, strict=True):
        filter_.step(list(given.T), list(read.T))
        followed.append(np.array([*filter_.mean, *filter_.deviations(), np.asarray(filter_.status) & ~8]).T)
        moved.append(np.array(plant.step(list(given.T))).T)
    assert_alike(np.array(followed), of_femfit(model, kind, start, volts, readings))
    assert_alike(np.array(moved), of_plant(model, start, volts))


@pytest.mark.parametrize("eddies", [(), (8e-3, 2e-4)])
def test_the_simulated_body_has_its_freewheel_diode(levitation_model, tmp_path, eddies):
    model = freewheeling(levitation_model)
    model = with_eddies(model, eddies) if eddies else model
    (written, *_) = [path for path in export_estimator(model, tmp_path) if path.suffix == ".py"]
    volts, start = [1.5] * 5 + [0.0] * 60, [0.022, 0.0, 0.3]
    plant = runpy.run_path(str(written))["Plant"](start)
    found = np.array([plant.step([u]) for u in volts])
    first = Plant(model).start(np.array([start]))
    assert_alike(found, of_plant(model, first, np.array(volts)[:, None, None])[:, 0], 1e-8)
    assert 0.0 <= found[-1, 2] < 1e-5


def test_a_record_is_followed_from_the_command_line(model, exported, tmp_path):
    start, volts, readings = a_motion(model)
    made = runpy.run_path(str(exported / FILE))
    known = made["STATES"][: 2 + len(made["CIRCUITS"])]
    columns = list(dict.fromkeys(["time_s", *known, *made["COMMANDS"], *made["COLUMNS"]]))
    with (tmp_path / "record.csv").open("w", newline="") as file:
        out = csv.DictWriter(file, columns)
        out.writeheader()
        for k, (given, read) in enumerate(zip(volts[:, 0], readings[:, 0], strict=True)):
            row = {"time_s": k * model.sample_time_s} | (dict(zip(known, start[0], strict=False)) if k == 0 else {})
            row |= dict(zip(made["COMMANDS"], given, strict=True))
            row |= {name: "" if np.isnan(x) else x for name, x in zip(made["COLUMNS"], read, strict=True)}
            if k == 0:  # what is read is where the filter starts
                start[0, : len(known)] = [row[name] for name in known]
            out.writerow(row)
    header, *rows = csv.reader(io.StringIO(run_bare(exported, exported / FILE, tmp_path / "record.csv")))
    assert header[:3] == ["time_s", "distance_m", "distance_m_sd"]
    found = np.array(rows, dtype=float)[1:, 1:]
    wanted = of_femfit(model, "ukf", start, volts[:-1], readings[1:])[:, 0, :-1]
    assert_alike(np.concatenate([found[:, 0::2], found[:, 1::2]], axis=1), wanted)


REFUSED = {"": "it lacks time_s, voltage_V", "time_s,voltage_V\n0,1\n": "it lacks", "fast": "to float: 'fast'"}


@pytest.mark.parametrize(("text", "said"), [(None, "cannot be read: No such file"), *REFUSED.items()])
def test_a_record_that_cannot_be_followed_is_refused_in_a_line(levitation_model, tmp_path, text, said):
    export_estimator(levitation_model, tmp_path)
    columns = runpy.run_path(str(tmp_path / FILE))["COLUMNS"]
    record, header = tmp_path / "record.csv", ",".join(["time_s", "voltage_V", *columns])
    if text is not None:  # with the mark that Excel puts before UTF-8
        record.write_text(f"{header}\n{text},1,{',2.5' * len(columns)}\n" if text == "fast" else text, "utf-8-sig")
    command = [sys.executable, str(tmp_path / FILE), str(record)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)
    assert said in done.stderr
    assert text != "fast" or "line 2" in done.stderr


def test_a_filter_that_is_lost_begins_again_from_the_last_good_estimate_and_says_so(levitation_model, tmp_path):
    export_estimator(levitation_model, tmp_path)
    made = runpy.run_path(str(tmp_path / FILE))
    far = made["Filter"]("ukf")
    far.start([0.2, 0.0, 0.3])
    far.step([0.86], [2.9])
    assert far.status == 4
    broken = made["Filter"]("ekf")
    mean = list(broken.start([0.022, 0.0, 0.32]))
    assert broken.step([float("inf")], [2.9]) == mean
    assert broken.status == 2
    broken.step([0.86], [2.9])
    assert broken.status == 0  # it goes on
    broken.step([0.86], [float("nan")])
    assert broken.status == 8
    with pytest.raises(ValueError, match="'ukf' or 'ekf'"):
        made["Filter"]("kf")


@pytest.fixture
def earlier(levitation_model, tmp_path):
    """A directory with an export and a file of the user's."""
    export_estimator(levitation_model, tmp_path / "kept")
    (tmp_path / "kept" / "my_controller.py").write_text("mine")
    return tmp_path / "kept"


def test_exporting_again_replaces_what_femfit_wrote_and_nothing_else(levitation_model, earlier, tmp_path):
    export_estimator(replace(levitation_model, name="second"), earlier)
    assert (earlier / "my_controller.py").read_text() == "mine"
    assert '"second"' in (earlier / "model.json").read_text()
    assert {file.name for file in earlier.iterdir()} == FILES | {"my_controller.py"}
    (tmp_path / "README.md").write_text("mine")
    with pytest.raises(RunDirectoryError, match="other files"):
        export_estimator(levitation_model, tmp_path)
    assert {file.name for file in tmp_path.iterdir()} == {"kept", "README.md"}
    for name, file, left in ((NEW, "half.py", set()), ("femfit_runtime", "__init__.py", {"femfit_runtime"})):
        place = tmp_path / f"after {name}"  # an interrupted export, and one of earlier versions
        (place / name).mkdir(parents=True)
        (place / name / file).write_text("")
        export_estimator(levitation_model, place)
        assert {one.name for one in place.iterdir()} - left == FILES


def test_an_export_that_fails_leaves_nothing_and_keeps_an_earlier_one(levitation_model, earlier, monkeypatch):
    before = {file.name: file.read_bytes() for file in earlier.iterdir()}

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(estimator, "write_model", full)
    for place in (earlier, earlier.parent / "new"):
        with pytest.raises(OSError, match="No space") as caught:
            export_estimator(replace(levitation_model, name="second"), place)
        assert caught.value.filename == str(place)
    assert {file.name: file.read_bytes() for file in earlier.iterdir()} == before
    assert [file.name for file in earlier.parent.iterdir()] == ["kept"]


@pytest.mark.parametrize(("part", "absent"), [("circuits", ()), ("motion", None), ("sensor", None)])
def test_a_model_without_a_part_is_refused_before_anything_is_written(levitation_model, tmp_path, part, absent):
    with pytest.raises(MissingPartError, match=part.rstrip("s")):
        export_estimator(replace(levitation_model, **{part: absent}), tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_name_cannot_become_a_part_of_the_program(levitation_model, tmp_path):
    export_estimator(replace(levitation_model, name='x"""\nraise SystemExit("ran")\n"""\\u'), tmp_path / "odd")
    assert runpy.run_path(str(tmp_path / "odd" / FILE))["SENSORS"] == ["hall"]
    odd = replace(levitation_model, sensor=None, other_sensors=(replace(LASER, name='a"; b'),))
    with pytest.raises(UsageError, match="must begin with a letter"):
        export_estimator(odd, tmp_path / "refused")


@pytest.mark.parametrize("name", ["one circuit", "solenoid", "law", "eddies"])
def test_a_saturating_core_is_followed_by_splines_as_near_as_they_say(model_kind, name):
    model = usually(model_kind(name), "core_saturation", "coil_temperature")
    light, error = splined(model)
    assert light is not model
    assert 0.0 < error <= NEAR
    box, random = model.validity, np.random.default_rng(0)
    d = random.uniform(box.distance_min_m, box.distance_max_m, 500)
    i = random.uniform(*box.current_limits_A[0], 500)
    for quantity in ("force", "flux_linkage", *["hall"] * (model.sensor is not None)):
        wanted, found = (
            one.sensor.field.field(d, i[:, None]) if quantity == "hall" else getattr(one, quantity)(d, i)
            for one in (model, light)
        )  # fmt: skip
        # Between the points that were looked at
        assert np.abs(found - wanted).max() <= 1.5 * error * np.abs(wanted).max()
    assert (light.circuits, light.motion, light.effects) == (model.circuits, model.motion, model.effects)


def test_what_splines_do_not_lighten_stays_as_it_is(levitation_model, model_kind):
    unchanged = levitation_model, usually(levitation_model, "magnet_temperature"), model_kind("saturating")
    assert all(splined(model) == (model, 0.0) for model in unchanged)
