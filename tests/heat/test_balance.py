"""Steady state, runaway and time of one node, in closed form."""

import math

import numpy as np
import pytest

from femfit.core.numerics import COPPER_TEMPERATURE_COEFFICIENT as ALPHA
from femfit.heat.balance import Loads, largest_factor, settled, slowest_s, time_until
from femfit.heat.network import HeatNetwork

G, C = 0.1, 50.0


def one_node():
    return HeatNetwork(
        (),
        (None,),
        (),
        np.array([C]),
        np.array([1e-6]),
        np.zeros((1, 1)),
        np.array([G]),
        np.zeros((0, 2)),
        np.zeros((1, 2)),
    )


def watts(power, other=0.0):
    return Loads(np.array([power]), np.array([other]))


def test_one_node_settles_at_heat_over_conductance_less_the_slope_of_the_heat():
    (found,) = settled(one_node(), 20.0, watts(3.0, 0.5))
    assert found == pytest.approx(20.0 + 3.5 / (G - ALPHA * 3.0))


def test_one_node_runs_away_where_its_heat_grows_as_fast_as_it_flows_off():
    limit = G / ALPHA
    assert largest_factor(one_node(), watts(1.0)) == pytest.approx(limit)
    assert settled(one_node(), 20.0, watts(0.999 * limit)) is not None
    assert settled(one_node(), 20.0, watts(1.001 * limit)) is None
    assert largest_factor(one_node(), watts(0.0, 1.0)) == math.inf


def test_one_node_warms_up_along_an_exponential_that_its_own_heat_slows_down():
    loads, final = watts(3.0), 20.0 + 3.0 / (G - ALPHA * 3.0)
    reached = 20.0 + (1.0 - math.exp(-1.0)) * (final - 20.0)
    found = time_until(one_node(), 20.0, loads.at, lambda now: now[0] - reached)
    assert found == pytest.approx(C / (G - ALPHA * 3.0), rel=1e-5)
    assert slowest_s(one_node()) == pytest.approx(C / G)


def test_one_node_that_runs_away_passes_a_temperature_in_time():
    power = 2.0 * G / ALPHA
    rate = (ALPHA * power - G) / C
    exact = math.log1p(110.0 * rate * C / power) / rate  # T - 20 = P / (alpha P - G) (exp(rate t) - 1)
    assert time_until(one_node(), 20.0, watts(power).at, lambda now: now[0] - 130.0) == pytest.approx(exact, rel=1e-5)


def test_what_is_never_reached_takes_no_time_to_say_so():
    assert time_until(one_node(), 20.0, watts(1.0).at, lambda now: now[0] - 130.0) is None
    assert time_until(one_node(), 20.0, watts(1.0).at, lambda now: now[0] - 19.0) == 0.0
