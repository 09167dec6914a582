"""Diodes and current amplifiers within a step: who ends its current, and who is at its limit."""

import copy
from dataclasses import replace
from itertools import product

import casadi as ca
import numpy as np
import pytest
from casadi import SX

from femfit.device.electrics import Drive
from femfit.model.equations import Driver, driver_voltages
from femfit.simulation.observers import DirectObserver
from femfit.simulation.plant import Plant
from support.halves import cut_in_two


def every_case(gain, wanted, low, high):
    """The voltages within limits of which each ends its current, or is at the limit that is too near."""
    for places in product((-1, 0, 1), repeat=len(wanted)):
        volts = np.select([np.equal(places, -1), np.equal(places, 1)], [low, high])
        free = np.equal(places, 0)
        if not np.isfinite(volts).all():
            continue
        if free.any():
            volts[free] = np.linalg.solve(gain[np.ix_(free, free)], (wanted - gain @ (~free * volts))[free])
        lacking = wanted - gain @ volts
        within = (volts >= low - 1e-12) & (volts <= high + 1e-12)
        if (within & (free | (lacking * places >= -1e-12))).all():
            return volts
    raise AssertionError


@pytest.mark.parametrize("count", [1, 2, 3])
def test_coupled_drivers_end_their_currents_or_are_at_the_limit_in_the_way(count):
    random = np.random.default_rng(4)
    for trial in range(60):
        signs = np.diag(random.choice([-1.0, 1.0], count))
        gain = signs @ (0.3 + 0.7 * np.eye(count)) @ signs
        gain = np.linalg.inv(gain) if trial % 2 else gain
        wanted, low, high = random.normal(size=count), -random.uniform(0.1, 1.0, count), random.uniform(0.1, 1.0, count)
        high = np.full(count, np.inf) if trial % 4 > 1 else high  # diodes
        drivers = [Driver(k, SX(wanted[k]), (low[k].item(), high[k].item())) for k in range(count)]
        found = ca.evalf(driver_voltages(drivers, SX.zeros(count), SX(ca.DM(gain))))
        np.testing.assert_allclose(found.full()[:, 0], every_case(gain, wanted, low, high), atol=1e-10)


def test_a_winding_that_another_drives_backwards_is_open_whatever_little_feeds_it(levitation_model):
    """A diode carries no current backwards: at a command of nought and at a nanovolt alike."""
    halves = cut_in_two(levitation_model)
    one_sided = tuple(replace(one, drive=Drive(diode_V=0.7), voltage_min_V=0.0) for one in halves.circuits)
    start = np.array([[0.024, 0.0, 0.0, 0.0]] * 2)
    found = Plant(replace(halves, circuits=one_sided)).step(start, np.array([[1.2, 0.0], [1.2, 1e-9]]))
    np.testing.assert_allclose(found[1], found[0], atol=1e-9)
    np.testing.assert_allclose(found[:, 3], 0.0, atol=1e-15)
    alone = replace(halves, circuits=(one_sided[0], replace(one_sided[1], resistance_ohm=1e9)))
    np.testing.assert_allclose(found[0, 2], Plant(alone).step(start, np.array([[1.2, 0.0]] * 2))[0, 2], rtol=1e-4)


def test_a_plant_is_kept_and_sent_after_use_and_has_any_number_of_runs(levitation_model):
    plant, state = Plant(levitation_model), np.array([[0.022, 0.0, 0.4]])
    moved = plant.step(state, np.array([1.0]))
    np.testing.assert_array_equal(copy.deepcopy(plant).step(state, np.array([1.0])), moved)
    assert plant.step(state[:0], np.zeros(0)).shape == (0, 3)
    many = plant.step(np.tile(state, (3, 1)), np.array([[1.0]]))
    np.testing.assert_array_equal(many, np.tile(moved, (3, 1)))


def test_a_reading_that_is_far_off_leaves_the_direct_measurement_s_currents_possible(levitation_model):
    model = levitation_model
    observer, box = DirectObserver(model, "hall"), model.validity
    mean = np.zeros((2, model.order))
    mean[:, 0], mean[:, 1] = box.distance_min_m, [-1.0, 1.0] * np.full(2, 0.03 / model.sample_time_s)
    mean[:, 2:] = 0.5
    found = observer.step(observer.start(mean), np.full((2, len(model.circuits)), 1.0), np.full((2, 1), 2.0)).mean
    assert (np.abs(found[:, 2:] - 0.5) < 0.2).all()
