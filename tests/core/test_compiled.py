"""Machine code of a function: the interpreter's results to the bit, and the interpreter wherever there is none."""

import shutil
import time
from concurrent.futures import ThreadPoolExecutor

import casadi as ca
import numpy as np
import pytest
from casadi import SX

from femfit.core import compiled, graph
from femfit.core.compiled import Compilation
from femfit.core.graph import GraphFunction, building, row_of

needs_compiler = pytest.mark.skipif(
    not any(map(shutil.which, ("cc", "gcc", "clang"))), reason="no C compiler on this machine"
)

TABLE = np.random.default_rng(3).normal(size=(40, 2))


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """An empty cache, and functions that are compiled soon."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(graph, "OFTEN", 20)
    monkeypatch.setattr(graph, "ASKED", 1)
    return tmp_path / "femfit"


def of_everything():
    """Elementary functions, choices and the row of a table by a look-up."""
    with building():
        x = SX.sym("x", 3)
        row = row_of(TABLE, [np.linspace(-2.0, 2.0, 39)], [x[0]])
        parts = [ca.exp(x[0]) * ca.tanh(x[1]), ca.if_else(x[2] < 0.0, -1.0, x[1] ** 2), ca.log1p(x[1] ** 2)]
        return GraphFunction([x], ca.vertcat(*parts, ca.dot(row, x[:2]) + x[0] * x[1] + x[2]))


def a_simple_function():
    x = SX.sym("x")
    return ca.Function("f", [x], [2.0 * x])


def settled(compilation):
    """Its result, waited for."""
    until = time.monotonic() + 60.0
    while (result := compilation.result()) is None and time.monotonic() < until:
        time.sleep(0.01)
    return result


@needs_compiler
def test_compiled_and_interpreted_results_are_equal_to_the_bit(cache):
    function, points = of_everything(), np.random.default_rng(4).normal(size=(300, 3))
    interpreted = [function.at_a_point(x).full().ravel() for x in points]
    until = time.monotonic() + 60.0
    while not list(cache.glob("*.so")) and time.monotonic() < until:
        function.point(points[0])
        time.sleep(0.002)
    called = [function.point(x) for x in points]
    assert function.point._function is not function.at_a_point
    np.testing.assert_array_equal(called, interpreted)
    assert [path.suffix for path in cache.iterdir()] == [".so"]  # neither source nor log stays


@needs_compiler
def test_threads_and_later_runs_share_what_was_compiled(cache):
    with ThreadPoolExecutor(4) as pool:
        results = list(pool.map(settled, [Compilation(a_simple_function()) for _ in range(4)]))
    assert all(result(3.0) == 6.0 for result in results)
    (kept,) = cache.iterdir()
    written = kept.stat().st_ino
    assert Compilation(a_simple_function()).result()(4.0) == 8.0  # at once
    assert kept.stat().st_ino == written


def test_without_a_compiler_the_interpreter_goes_on(cache, monkeypatch):
    monkeypatch.setenv("FEMFIT_COMPILER", "")
    function = a_simple_function()
    assert Compilation(function).result() is function
    assert not cache.exists()


@pytest.mark.parametrize("trouble", ["compiler fails", "no folder", "not a library"])
def test_trouble_is_said_once_and_the_interpreter_goes_on(cache, monkeypatch, trouble):
    if trouble == "no folder":
        cache.touch()  # a file in its place
    monkeypatch.setenv("FEMFIT_COMPILER", "false" if trouble == "compiler fails" else "true")
    function = a_simple_function()
    compilation = Compilation(function)
    if trouble == "not a library":
        cache.mkdir()
        compilation._target.write_text("nothing")
    with pytest.warns(RuntimeWarning, match="stays interpreted"):
        assert settled(compilation) is function


@needs_compiler
def test_the_cache_keeps_what_was_used_last(cache, monkeypatch):
    monkeypatch.setattr(compiled, "KEPT", 2)
    x = SX.sym("x")
    for factor in (1.0, 2.0, 3.0):
        assert settled(Compilation(ca.Function("f", [x], [factor * x])))(2.0) == 2.0 * factor
    assert len(list(cache.iterdir())) == 2
