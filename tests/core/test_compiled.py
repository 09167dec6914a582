"""Machine code of a function: the interpreter's results to the bit, and the interpreter wherever there is none."""

from concurrent.futures import ThreadPoolExecutor
from unittest import mock

import casadi as ca
import numpy as np
import pytest
from casadi import SX

from femfit.core import compiled
from femfit.core.compiled import Compilation
from femfit.core.graph import GraphFunction, building, row_of
from support.compiling import needs_compiler, waited_for

TABLE = np.random.default_rng(3).normal(size=(40, 2))


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """An empty cache, and functions that are compiled soon."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.delenv("FEMFIT_COMPILER", raising=False)
    monkeypatch.setattr(compiled, "OFTEN", 100)
    return tmp_path / "femfit"


def of_everything():
    """Elementary functions, choices and the row of a table by a look-up."""
    with building():
        x, u = SX.sym("x", 3), SX.sym("u", 2)
        row = row_of(TABLE, [np.linspace(-2.0, 2.0, 39)], [x[0]])
        smooth = [ca.exp(x[0]) * ca.tanh(x[1]), ca.log1p(x[1] ** 2), ca.expm1(x[2]), ca.fabs(x[1]) ** 1.7, x[2] ** 3]
        others = [ca.if_else(x[2] < 0.0, -1.0, x[1] ** 2), ca.atan2(x[0], x[1]), ca.fmin(ca.sin(x[0]), ca.cosh(x[1]))]
        return GraphFunction([x, u, SX(0, 1)], ca.vertcat(*smooth, *others, ca.dot(row, x[:2]) + u[0] * x[1] + u[1]))


def compilation_of(factor=2.0):
    x = SX.sym("x")
    return Compilation(lambda: ca.Function("f", [x], [factor * x]))


def value(library, x):
    return library([np.array([[x]])], 1)[0, 0]


@needs_compiler
def test_arrays_points_and_compiled_code_are_equal_to_the_bit(cache):
    function, rng = of_everything(), np.random.default_rng(4)
    x, inputs = rng.normal(size=(3, 700)), [np.array([0.3, -2.0]), np.zeros(0)]
    in_numpy = function(x, *inputs)
    points = np.array([function.at_a_point(column, *inputs).full().ravel() for column in x.T]).T
    np.testing.assert_array_equal(in_numpy, points)
    library = waited_for(function._compilation)
    np.testing.assert_array_equal(library([x, *(y[:, None] for y in inputs)], 700), points)
    np.testing.assert_array_equal(function(x[:, ::2], *inputs), points[:, ::2])
    np.testing.assert_array_equal(function(np.asfortranarray(x), np.outer(inputs[0], np.ones(700)), inputs[1]), points)
    np.testing.assert_array_equal(function.point(x[:, 5], *inputs), points[:, 5])
    assert function.point._library is library
    assert function(x[:, :0], *inputs).shape == (9, 0)
    assert [path.suffix for path in cache.iterdir()] == [".so"]  # neither source nor log stays


@needs_compiler
def test_threads_and_later_runs_share_what_was_compiled(cache):
    with ThreadPoolExecutor(4) as pool:
        libraries = list(pool.map(waited_for, [compilation_of() for _ in range(4)]))
    assert all(value(library, 3.0) == 6.0 for library in libraries)
    (kept,) = cache.iterdir()
    written = kept.stat().st_ino
    assert value(waited_for(compilation_of()), 4.0) == 8.0
    assert kept.stat().st_ino == written


@needs_compiler
def test_one_compiler_works_at_a_time_and_none_on_what_takes_minutes(cache, monkeypatch):
    first, second = (compilation_of(factor) for factor in (3.0, 4.0))
    assert first.after(100) is second.after(100) is None
    assert second._work is None
    assert value(waited_for(second), 2.0) == 8.0
    assert value(waited_for(first), 2.0) == 6.0
    monkeypatch.setattr(compiled, "LARGEST", 100)
    monkeypatch.setenv("FEMFIT_COMPILER", "false")
    assert waited_for(compilation_of(5.0)) is None


def test_without_a_compiler_nothing_is_compiled(cache, monkeypatch):
    monkeypatch.setenv("FEMFIT_COMPILER", "")
    assert waited_for(compilation_of()) is None
    assert not cache.exists()


@pytest.mark.parametrize("trouble", ["compiler fails", "no folder", "no library"])
def test_trouble_is_said_once_and_goes_without(cache, monkeypatch, trouble):
    monkeypatch.setenv("FEMFIT_COMPILER", "false" if trouble == "compiler fails" else "true")
    compilation = compilation_of()
    if trouble == "no folder":
        cache.touch()  # a file in its place
    with pytest.warns(RuntimeWarning, match="is not compiled") as said:
        assert waited_for(compilation) is None
    assert len(said) == 1


@needs_compiler
def test_the_cache_keeps_what_was_used_last(cache, monkeypatch):
    monkeypatch.setattr(compiled, "KEPT", 2)
    for factor in (1.0, 2.0, 3.0):
        assert value(waited_for(compilation_of(factor)), 2.0) == 2.0 * factor
    assert len(list(cache.iterdir())) == 2


def test_inputs_of_wrong_shapes_are_refused_whatever_works_the_function_out():
    function, two = of_everything(), np.array([0.3, -2.0])
    for x, u in (((1, 50), two), ((4, 50), two), (2, two), ((3, 50), np.zeros((2, 20)))):
        with pytest.raises(ValueError, match="as many rows"):
            function(np.zeros(x), u, np.zeros(0))


@needs_compiler
def test_a_cache_that_cannot_be_tidied_is_used(cache, monkeypatch):
    monkeypatch.setattr("os.utime", mock.Mock(side_effect=PermissionError))
    assert value(waited_for(compilation_of(9.0)), 2.0) == 18.0


@needs_compiler
def test_a_compiler_that_is_not_found_is_said_once_and_one_that_is_found_afterwards_works(cache, monkeypatch):
    monkeypatch.setenv("FEMFIT_COMPILER", "no-such-compiler -m64")
    compilation = compilation_of()
    with pytest.raises(RuntimeWarning, match="no-such-compiler -m64 is not found"):  # a warning is an error here
        compilation.after(10**9)
    assert compilation.after(10**9) is None
    monkeypatch.delenv("FEMFIT_COMPILER")
    assert value(waited_for(compilation_of(8.0)), 2.0) == 16.0
