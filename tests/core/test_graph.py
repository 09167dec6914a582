"""What is derived from one expression: the same over arrays and at single points, through every kind of part."""

import math
import os
import threading
from concurrent.futures import ThreadPoolExecutor

import casadi as ca
import numpy as np
import pytest
from casadi import SX
from scipy.interpolate import BSpline

from femfit.core import graph
from femfit.core.graph import GraphFunction, building, of_variable, row_of, settled, slope
from femfit.model.bspline import CellTable, TensorSpline, cells_of
from femfit.targets.estimator import python_source

RANDOM = np.random.default_rng(12)
COUNTS = (1, 5, 16, 17, 1000, 2500)
DEGREE = 4


def spline_of(cells, seed=0):
    """Knots over (0, 1), coefficients, and scipy's spline of them."""
    knots = np.r_[[0.0] * DEGREE, np.linspace(0.0, 1.0, cells + 1), [1.0] * DEGREE]
    coefficients = np.random.default_rng(seed).normal(size=cells + DEGREE)
    return knots, coefficients, BSpline(knots, coefficients, DEGREE)


def value_of(knots, coefficients, at):
    return CellTable([cells_of(knots, DEGREE)], coefficients[:, None]).at(at)[0]


def made(expressions, size=1):
    """The function of expressions of a variable."""
    with building():
        x = SX.sym("x", size)
        return GraphFunction([x], ca.vertcat(*expressions(x)))


def alone(function, x):
    """Point by point, by the interpreter."""
    return np.array([function.at_a_point(column).full().ravel() for column in x.T]).T


def with_slope(expression):
    return lambda x: (value := expression(x), ca.gradient(value, x))


def off(found, wanted):
    """The largest difference, of each row by its size."""
    return np.abs((found - wanted) / np.abs(wanted).max(axis=1, keepdims=True)).max()


@pytest.mark.parametrize("cells", [1, 5, 40], ids=["one cell", "by comparisons", "by a look-up"])
@pytest.mark.parametrize("count", COUNTS)
def test_arrays_and_single_points_give_the_same_and_what_scipy_gives(cells, count):
    assert (cells > graph.FEW_CELLS) == (cells == 40)
    knots, coefficients, exact = spline_of(cells)
    function = made(with_slope(lambda x: value_of(knots, coefficients, x[0]) * ca.exp(x[1])), 2)
    at = RANDOM.uniform(0.0, 1.0, (2, count))
    at[0, 0] = knots[-1 - DEGREE]  # a knot, beyond which is no further cell
    found, spline, growth = function(at), exact(at[0]), np.exp(at[1])
    wanted = np.array([spline * growth, exact.derivative()(at[0]) * growth, spline * growth])
    assert off(found, wanted) < 1e-12
    assert off(alone(function, at[:, :40]), found[:, :40]) < 1e-14


def test_a_spline_is_continued_as_each_expression_asks():
    knots, coefficients = np.r_[[0.0] * 4, [1.0] * 4], RANDOM.normal(size=(4, 4))
    spline, another = (TensorSpline(knots, knots, 3, 3, coefficients) for _ in range(2))
    at = np.array([[0.5], [3.0]])
    made(lambda x: [spline.expression(x[0], x[1], 2)], 2)
    values = [made(lambda x, one=one: [one.expression(x[0], x[1], 1)], 2)(at) for one in (spline, another)]
    assert values[0] == values[1]


@pytest.mark.parametrize("count", [1, 3000])
def test_a_point_at_a_border_belongs_to_the_cell_above_and_one_that_is_no_number_gives_none(count):
    function = made(lambda x: [row_of(np.array([[1.0], [2.0], [3.0]]), [np.array([0.0, 1.0])], [x]) + 0.0 * x])
    other = made(lambda x: [x * row_of(np.array([[1.0], [2.0]]), [np.array([0.0])], [x])])
    at = np.array([[-5.0, -1e-9, 0.0, 0.5, 1.0, 7.0]])
    np.testing.assert_array_equal(function(np.tile(at, count)), np.tile([1, 1, 2, 2, 3, 3], count)[None])
    assert np.isnan(other(np.full((1, count), np.nan))).all()


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("cells", [4, 40])
def test_a_row_may_stand_where_another_row_says(cells, count):
    """s(t(x)) with its slope s' t', both of many cells and of few."""
    inner, outer = spline_of(cells, 1), spline_of(cells, 2)

    def within(y):
        return 0.5 + 0.2 * np.tanh(y)

    function = made(with_slope(lambda x: value_of(*outer[:2], within(value_of(*inner[:2], x)))))
    at = RANDOM.uniform(0.0, 1.0, (1, count))
    y = inner[2](at[0])
    rise = 0.2 * (1.0 - np.tanh(y) ** 2) * inner[2].derivative()(at[0])
    wanted = np.array([outer[2](within(y)), outer[2].derivative()(within(y)) * rise])
    np.testing.assert_allclose(function(at), wanted, rtol=0.0, atol=1e-11 * np.abs(wanted).max())


def test_a_slope_within_a_slope_derives_by_both_variables():
    """d/da of [d/dx of x^3 a^2 s(x)] at x = sin a, and a second one of it, through the row of s."""
    knots, coefficients, exact = spline_of(40)

    def inner(x, a):
        return x**3 * a**2 * value_of(knots, coefficients, x)

    def outer(a):
        return slope(lambda x: inner(x, a), np.sin(a))

    function = made(lambda a: [outer(a), slope(outer, a), slope(outer, a, 2)])
    at = RANDOM.uniform(0.1, 1.3, 200)
    s = [exact.derivative(k)(np.sin(at)) if k else exact(np.sin(at)) for k in range(4)]
    x, dx = np.sin(at), np.cos(at)
    g = 3.0 * x**2 * s[0] + x**3 * s[1]
    dg = 6.0 * x * s[0] + 6.0 * x**2 * s[1] + x**3 * s[2]
    ddg = 6.0 * s[0] + 18.0 * x * s[1] + 9.0 * x**2 * s[2] + x**3 * s[3]
    wanted = np.array(
        [at**2 * g, 2.0 * at * g + at**2 * dg * dx, 2.0 * g + 4.0 * at * dg * dx + at**2 * (ddg * dx**2 - dg * x)]
    )
    assert off(function(at[None]), wanted) < 1e-10
    assert off(alone(function, at[None, :20]), wanted[:, :20]) < 1e-10


@pytest.mark.parametrize("count", [1, 500])
def test_what_is_settled_is_constant_in_every_derivative_and_one_step_more_is_exact(count):
    """The cube root by Newton: the slope of the settled one is none, that of one step more is y / 3 x."""

    def nearer(y, x):
        return (2.0 * y + x / y**2) / 3.0

    def root(x):
        y = x
        for _ in range(12):
            y = nearer(y, x)
        return y

    def found(x):
        held = settled(root(x))
        better = nearer(held, x)
        inside = of_variable(lambda z: ca.gradient(nearer(settled(root(z)), z), z), 2.0 * x)
        return held, ca.gradient(held, x), better, ca.gradient(better, x), inside

    function = made(found)
    at = RANDOM.uniform(0.5, 3.0, (1, count))
    y, later = np.cbrt(at[0]), np.cbrt(2.0 * at[0])
    wanted = [y, 0.0 * y, y, y / (3.0 * at[0]), later / (6.0 * at[0])]
    np.testing.assert_allclose(function(at), wanted, rtol=1e-13)


def test_one_number_holds_for_all_points_and_blocks_take_their_own_and_overwrite_nothing():
    with building():
        x, p, q = SX.sym("x"), SX.sym("p", 2), SX.sym("q")
        function = GraphFunction([x, p, q], ca.vertcat(x * p[0] + p[1], q))
    for count in COUNTS:
        at, q = RANDOM.normal(size=(1, count)), RANDOM.normal(size=(1, count))
        first = function(at, np.array([2.0, 3.0]), q)
        np.testing.assert_allclose(function(at, np.array([[4.0], [3.0]]), q)[0], 4.0 * at[0] + 3.0, rtol=1e-14)
        np.testing.assert_allclose(first, [2.0 * at[0] + 3.0, q[0]], rtol=1e-14)


OPERATIONS = {name: (lambda x: x, getattr(math, name)) for name in ("erf", "acos", "asin", "atanh", "ceil")}
OPERATIONS |= {"acosh": (lambda x: 1.0 + x, lambda x: math.acosh(1.0 + x))}


@pytest.mark.parametrize("name", OPERATIONS)
def test_arrays_know_the_operations_that_an_export_writes(name):
    inner, wanted = OPERATIONS[name]
    function = made(lambda x: [ca.hypot(getattr(ca, name)(inner(x)), 2.0)])
    assert function(np.full((1, 1000), 0.3))[0, -1] == pytest.approx(math.hypot(wanted(0.3), 2.0), rel=1e-14)
    written = {name: getattr(math, name), "hypot": math.hypot}
    exec(python_source("f", function, ["x"]), written)  # noqa: S102  its own
    assert written["f"]([0.3])[0] == pytest.approx(math.hypot(wanted(0.3), 2.0), rel=1e-14)


def test_an_operation_that_arrays_do_not_know_is_named():
    with pytest.raises(NotImplementedError, match="instead received ERFINV"):
        made(lambda x: [ca.erfinv(x)])(np.full((1, 1000), 0.3))


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork")
def test_a_child_that_is_forked_while_another_thread_builds_has_numpys_own_functions():
    begun, done = threading.Event(), threading.Event()

    def builder():
        with building():
            begun.set()
            done.wait()

    thread = threading.Thread(target=builder)
    thread.start()
    begun.wait()
    if not (child := os.fork()):
        os._exit(ca.GlobalOptions.getNumpyMode() & 255)
    _, status = os.waitpid(child, 0)
    done.set()
    thread.join()
    assert os.waitstatus_to_exitcode(status) == 0


@pytest.mark.parametrize("cells", [5, 40])
def test_threads_do_not_disturb_each_other(cells):
    knots, coefficients, exact = spline_of(cells)
    function = made(lambda x: [value_of(knots, coefficients, x)])

    def furthest(seed):
        generator, worst = np.random.default_rng(seed), 0.0
        for _ in range(60):
            at = generator.uniform(0.0, 1.0, int(generator.choice([1, 3, 40, 200])))
            worst = max(worst, np.abs(function(at[None])[0] - exact(at)).max())
        return worst

    with ThreadPoolExecutor(4) as pool:
        assert max(pool.map(furthest, range(8))) < 1e-12
