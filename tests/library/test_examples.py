"""The example at every public name runs and prints what it shows."""

import doctest
import inspect
import os
import shutil

import pytest

import femfit
from femfit.field.sweep_task import solvers
from support.actuators import GEOMETRY, rig_at
from support.small_records import coil_record, loop_record

FLAGS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
NAMES = [name for name in femfit.__all__ if not name.startswith("_")]


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """A directory with the files that the examples read: drawing, sweep, model, bench table."""
    place = tmp_path_factory.mktemp("examples")
    text = rig_at("[0, 0.4, 0.8, 1.2, 1.4]", "[15, 16, 17.5, 19, 21, 23, 26, 30, 36, 45]")
    (place / "rig.toml").write_text(text)
    table = femfit.run_sweep(place / "rig.toml", place / "runs" / "rig", workers=1)
    femfit.write_model(femfit.fit_model(table).model, place / "model.json")
    shutil.copy(GEOMETRY.parent / "data" / "levitation_bench.csv", place / "bench.csv")
    forces = table.rows[["current_A", "force_N", "flux_linkage_Wb"]].assign(distance=1e3 * table.rows["distance_m"])
    forces.to_csv(place / "forces.csv", index=False)
    loop_record(place / "loop.csv", 2.0, 1.0)
    coil_record(place / "record.csv", 2.0)
    return place


@pytest.fixture(autouse=True)
def one_process(monkeypatch):
    """Sweeps are solved here: what an example prints does not depend on it, and a process takes 3 s to start."""
    monkeypatch.setattr("femfit.field.sweep.solvers", lambda _workers: solvers(1))


SLOW = ("CalibrationResult", "calibrate", "observe", "suggest", "write_report")
"""They take from five to twenty seconds each."""

TWICE = ("AddResult", "Comparison", "Diagnosis", "LoopSummary", "Observation")
"""What they show is made by a function whose own example is run."""


@pytest.mark.parametrize(
    "name", [pytest.param(one, marks=[pytest.mark.nightly] * (one in SLOW + TWICE)) for one in NAMES]
)
def test_the_example_of_a_public_name_runs(name, bench, monkeypatch):
    public = getattr(femfit, name)
    # Methods have examples of their own only where a reader needs one
    test = doctest.DocTestParser().get_doctest(
        inspect.getdoc(public) or "", {"ff": femfit}, f"femfit.{name}", inspect.getsourcefile(public), 0
    )
    assert test.examples, f"femfit.{name} has no example"
    monkeypatch.chdir(bench)
    monkeypatch.setenv("COLUMNS", "120")
    try:
        doctest.DebugRunner(optionflags=FLAGS, verbose=False).run(test)
    except doctest.DocTestFailure as failure:
        pytest.fail(f"{failure.example.source}expected\n{failure.example.want}got\n{failure.got}", pytrace=False)
    assert os.getcwd() == str(bench)  # noqa: PTH109
