"""The exported C follows a record as femfit's own filter does, keeps no NaN, and compiles without a warning."""

import runpy
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import femfit as ff
from femfit.core.errors import UsageError
from femfit.estimate.kalman_filter import kalman_filter
from femfit.targets import c_code
from femfit.targets.c_code import export_c
from femfit.targets.estimator import FILE, export_estimator, words_of
from femfit.targets.splined import splined
from femfit.targets.targets import export
from support.added_effects import usually
from support.readings import LASER

COMPILER = shutil.which("cc")

pytestmark = pytest.mark.skipif(COMPILER is None, reason="no C compiler: cc was not found")

STRICT = "-O1 -Wconversion -Wdouble-promotion -pedantic -Werror"

RECOVERING = """
#include "femfit_model.h"
#include <math.h>
#include <stdio.h>

int main(void)
{
    static femfit_filter filter;
    const femfit_real first[] = { FIRST }, volts[] = { 1 };
    femfit_real reading[] = { READING };
    int k, status[8];
    femfit_init(&filter, first);
    status[0] = femfit_step(&filter, volts, reading, 1u);
    status[1] = femfit_step(&filter, volts, reading, 0u);
    reading[0] = (femfit_real)NAN;
    status[2] = femfit_step(&filter, volts, reading, 1u);
    filter.factor[0] = filter.covariance[0] = (femfit_real)NAN;
    status[3] = femfit_step(&filter, volts, reading, 1u);
    reading[0] = READING;
    status[4] = femfit_step(&filter, volts, reading, 1u);
    filter.mean[0] = 1;
    status[5] = femfit_step(&filter, volts, reading, 0u);
    filter.mean[2] = filter.inside[2] = (femfit_real)NAN; /* where it begins again breaks down as well */
    femfit_step(&filter, volts, reading, 1u);
    femfit_step(&filter, volts, reading, 1u);
    status[6] = femfit_step(&filter, volts, reading, 1u);
    filter.mean[3] = (femfit_real)1e6; /* V of the Hall element's offset */
    status[7] = femfit_step(&filter, volts, reading, 0u);
    for (k = 0; k < 8; k++)
        printf("%d ", status[k]);
    for (k = 0; k < FEMFIT_STATES; k++)
        printf("%d ", isfinite(filter.mean[k]) && isfinite(filter.covariance[k * FEMFIT_STATES + k]));
    return 0;
}
"""


def compiled(directory):
    """The program of an export."""
    make = ["make", "-s", f"CFLAGS={STRICT}", f"CC={COMPILER}"]
    assert not subprocess.run(make, check=True, cwd=directory, capture_output=True, text=True).stderr
    return directory / "replay"


def record_of(path, filter_, first, samples):
    """A written record with missing readings, and what femfit's filter makes of it: means beside deviations."""
    process, generator = filter_.process, np.random.default_rng(0)
    words = words_of(process.model, process)
    columns = [*words["commands"], *words["reading_columns"]]
    given = [k for k, name in enumerate(words["states"][: len(first)]) if name not in columns]
    state, rows, estimates = filter_.start(first), [], []
    still = np.array([process.measure(output.name, state.mean)[0] for output in process.outputs])
    noise = np.array([output.variance**0.5 for output in process.outputs])
    for k in range(samples):
        before, volts = (0.5 + 0.4 * np.sin(0.1 * j) for j in (k - 1, k))
        readings = still + noise * generator.standard_normal(len(noise))
        if k == 0:
            readings[np.array(words["reading_columns"]) == words["states"][0]] = first[0]
        readings[0] = np.nan if k % 7 == 3 else readings[0]
        state = filter_.step(state, before, readings) if k else state
        known = [first[j] if k == 0 else np.nan for j in given]
        rows.append([k * process.model.sample_time_s, volts, *readings, *known])
        estimates.append(np.stack([state.mean[0], np.sqrt(np.diag(state.covariance[0]))], axis=1).ravel())
    assert state.outcome[0] in (0, 4)  # readings that no body makes leave their band
    names = ["time_s", *columns, *(words["states"][j] for j in given)]
    lines = [",".join("" if np.isnan(x) else f"{x:.17g}" for x in row) for row in rows]
    path.write_text("\n".join([",".join(names), *lines]) + "\n")
    return np.array(estimates)


def replayed(program, record):
    done = subprocess.run([program, record], capture_output=True, text=True, check=True)
    return np.loadtxt(done.stdout.splitlines()[1:], delimiter=",", ndmin=2)[:, 1:]


def late(model):
    """With a laser whose readings are 2.5 samples late."""
    return replace(model, other_sensors=(replace(LASER, delay_s=2.5 * model.sample_time_s),))


@pytest.mark.parametrize("kind", ["ekf", "ukf"])
def test_a_record_is_followed_as_by_femfit(levitation_model, tmp_path, kind):
    model, sensors = late(levitation_model), ("hall", LASER.name)
    export_c(model, tmp_path / "c", sensors, kind)
    record, program = tmp_path / "record.csv", compiled(tmp_path / "c")
    wanted = record_of(record, kalman_filter(model, kind, sensors=sensors), [0.022, 0.0, 0.4], 400)
    np.testing.assert_allclose(replayed(program, record), wanted, rtol=1e-11, atol=1e-13)
    export_estimator(model, tmp_path / "python", sensors)
    ended = pd.read_csv(record)
    ended.loc[ended["hall_V"].isna(), "hall_V"] = [0.0, 5.0, 1e12] * 19  # a reading there tells nothing
    ended.to_csv(record, index=False)
    np.testing.assert_allclose(replayed(program, record), wanted, rtol=1e-11, atol=1e-13)
    followed = runpy.run_path(str(tmp_path / "python" / FILE))["follow"](record, kind)
    np.testing.assert_allclose(np.array(list(followed))[:, 1:], wanted, rtol=1e-9, atol=1e-11)


@pytest.mark.parametrize("kind", ["ekf", "ukf"])
def test_single_precision_keeps_covariances_of_nearly_equal_states(levitation_model, tmp_path, monkeypatch, kind):
    model = late(levitation_model)
    for floor, lost, largest in ((c_code.FLOOR["float"], 0, 1e-7), (0.0, len(c_code.STARTS), 0.01)):
        monkeypatch.setitem(c_code.FLOOR, "float", floor)
        done = export(model, tmp_path / "c", to="c", filter=kind, real="float", sensors=(LASER.name,))
        assert done.single_precision_lost == lost
        assert done.single_precision_m < largest
    assert "loses its covariance from 3 of 3 starts" in str(done)


def test_single_precision_is_as_near_as_the_export_says(levitation_model, tmp_path):
    done = export(levitation_model, tmp_path / "c", to="c", filter="ekf", real="float")
    assert 0.0 < done.single_precision_m < 1e-6
    assert "Single precision is off by" in str(done)
    wanted = record_of(tmp_path / "record.csv", kalman_filter(levitation_model, "ekf"), [0.022, 0.0, 0.4], 300)
    found = replayed(compiled(tmp_path / "c"), tmp_path / "record.csv")
    assert np.abs(found[:, 0] - wanted[:, 0]).max() < 10.0 * done.single_precision_m
    assert "double" not in (tmp_path / "c/femfit_arithmetic.c").read_text()


@pytest.mark.parametrize("kind", ["ekf", "ukf"])
def test_a_filter_that_breaks_down_says_so_and_goes_on(levitation_model, tmp_path, kind):
    export_c(levitation_model, tmp_path, None, kind)
    reading = float(kalman_filter(levitation_model).process.measure("hall", np.array([[0.022, 0.0, 0.4, 0.0]]))[0])
    (tmp_path / "replay.c").write_text(RECOVERING.replace("FIRST", "0.022, 0, 0.4").replace("READING", f"{reading!r}"))
    done = subprocess.run([compiled(tmp_path)], capture_output=True, text=True, check=True)
    status = list(map(int, done.stdout.split()))
    lost, broken, left, missing = 1, 2, 4, 8
    assert status[3] & (lost | broken)
    assert status[5] & left
    assert status[:3] + status[4:5] + status[6:8] == [0, missing, missing, 0, 0, left | missing]
    assert all(status[8:])


def test_an_unknown_target_filter_or_precision_is_refused(tmp_path):
    asked = {"filter": ("kf", "ukf or ekf"), "real": ("half", "double or float"), "to": ("fmu", "estimator .*; c ")}
    for what, (value, allowed) in asked.items():
        with pytest.raises(UsageError, match=f"must be one of: {allowed}.*instead received '{value}'"):
            export("model.json", tmp_path / "c", **({"to": "c"} | {what: value}))


def test_names_with_signs_are_names_in_c_and_those_that_are_alike_are_refused(levitation_model, tmp_path):
    laser = replace(LASER, name="laser-1")
    export_c(replace(levitation_model, other_sensors=(laser,)), tmp_path / "c", ("laser-1",))
    compiled(tmp_path / "c")
    alike = replace(levitation_model, other_sensors=(laser, replace(LASER, name="Laser_1")))
    with pytest.raises(UsageError, match="more than case and signs"):
        export_c(alike, tmp_path / "alike", ("laser-1", "Laser_1"))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time_s,voltage_V\n0,1\n", "must have the column hall_V"),
        ("{header}\r0,1,2\r0.001,1,2\r", "rows below its names"),
        ("{header}\n" + "0," * 70_000 + "\n", "less than 65536 characters"),
    ],
)
def test_a_record_without_a_column_or_that_is_not_read_to_its_end_is_refused(levitation_model, tmp_path, text, message):
    ff.export(levitation_model, tmp_path / "c", to="c", filter="ekf")
    program, record = compiled(tmp_path / "c"), tmp_path / "record.csv"
    record.write_text(text.format(header="time_s,voltage_V,hall_V"), newline="")
    ended = subprocess.run([program, record], capture_output=True, text=True, check=False)
    assert ended.returncode == 2
    assert message in ended.stderr


def test_the_difference_that_is_printed_contains_that_of_the_splines(levitation_model, tmp_path):
    paths, difference = export_c(usually(levitation_model, "core_saturation"), tmp_path, None, "ukf", "float")
    assert 2e-7 < difference.difference_m < 3e-6  # single precision alone is off by 3e-8 m
    _, error = splined(usually(levitation_model, "core_saturation"))
    text = next(path for path in paths if path.name == "README.md").read_text()
    assert f"within {error:.1g} of the largest" in " ".join(text.split())
