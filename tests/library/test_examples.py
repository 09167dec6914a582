"""The example at every public name runs and prints what it shows."""

import doctest
import inspect
import os
import shutil

import pytest

import femfit
from support.actuators import GEOMETRY

FLAGS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
NAMES = [name for name in femfit.__all__ if not name.startswith("_")]
POINTS = {
    "current_A = {": "current_A = [0, 0.4, 0.8, 1.2, 1.4]",
    "distance_mm = {": "distance_mm = [15, 16, 17.5, 19, 21, 23, 26, 30, 36, 45]",
}


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """A directory with the files that the examples read: drawing, sweep, model, bench table."""
    place = tmp_path_factory.mktemp("examples")
    lines = (GEOMETRY / "emaws-rig.toml").read_text().splitlines()
    small = [next((new for start, new in POINTS.items() if line.startswith(start)), line) for line in lines]
    (place / "rig.toml").write_text("\n".join(small))
    table = femfit.run_sweep(place / "rig.toml", place / "runs" / "rig", workers=1)
    femfit.write_model(femfit.fit_model(table).model, place / "model.json")
    shutil.copy(GEOMETRY.parent / "data" / "levitation_bench.csv", place / "bench.csv")
    table.rows[["distance_m", "current_A", "force_N", "flux_linkage_Wb"]].to_csv(place / "forces.csv", index=False)
    return place


@pytest.mark.parametrize("name", NAMES)
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
