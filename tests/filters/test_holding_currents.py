"""Currents of several circuits that hold a body, against scipy's least heat of their deviations from a bias."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize

from femfit.core.errors import DomainError
from femfit.estimate.holding import bias_currents, holding_currents
from femfit.fit.build import fit_model
from femfit.simulation.allocation import current_ranges, currents_for_force
from support.bearing import table_of


@pytest.fixture(scope="module")
def bearing():
    return fit_model(table_of()).model


def least_heat(model, distance, force, bias, limits):
    """By sequential quadratic programming from nine starts; None where none of them ends with the force."""

    def missing(currents):
        return float(model.magnetics.force(np.array(distance), currents)) - force

    def heat(currents):
        return model.resistances_ohm @ (currents - bias) ** 2

    starts = np.stack(np.meshgrid(*np.linspace(*limits.T, 3).T), axis=-1).reshape(-1, 2)
    constraint = {"type": "eq", "fun": missing}
    ends = [minimize(heat, one, bounds=limits, constraints=[constraint], options={"ftol": 1e-12}).x for one in starts]
    ends = [one for one in ends if abs(missing(one)) < 1e-6 * abs(force)]
    return min(ends, key=heat) if ends else None


@pytest.mark.parametrize(
    ("distance", "mass", "bias", "highest"),
    [
        (0.7e-3, 2.7, (1.0, 1.0), 2.0),
        (0.7e-3, 2.7, (1.0, 1.0), 1.42),  # the upper circuit comes to its limit
        (0.5e-3, 2.7, (0.0, 0.0), 2.0),
        (0.5e-3, 2.7, (1.0, 1.0), 2.0),  # only far from the bias, against the magnet's field
        (0.3e-3, 0.5, (0.0, 0.0), 2.0),  # the force is bent so much that whole steps go to and fro
        (0.3e-3, 2.7, (1.0, 1.0), 2.0),  # none
    ],
)
def test_the_currents_that_hold_heat_least(bearing, distance, mass, bias, highest):
    box = replace(bearing.validity, further_A=((-2.0, highest),))
    model = replace(bearing, validity=box, motion=replace(bearing.motion, mass_kg=mass))
    expected = least_heat(model, distance, -9.81 * mass, np.array(bias), box.current_limits_A)
    if expected is None:
        with pytest.raises(DomainError, match="must be held"):
            holding_currents(model, distance, np.array(bias))
        return
    found = holding_currents(model, distance, np.array(bias))
    # Heat is flat about its minimum: scipy ends within the root of its tolerance
    np.testing.assert_allclose(found, expected, atol=1e-3)
    assert model.magnetics.force(np.array(distance), found) == pytest.approx(-9.81 * mass, rel=1e-8)


def test_the_currents_of_a_loop_heat_least_and_keep_the_drivers_limits(bearing):
    """At several distances at once; the diode's circuit gives no negative current."""
    limits = current_ranges(bearing)
    bias = np.clip(bias_currents(bearing, 0.5e-3), *limits.T)
    distance, force = np.array([0.4e-3, 0.6e-3, 0.6e-3, 0.7e-3]), np.array([30.0, 3.0, -3.0, -20.0])
    found = currents_for_force(bearing, distance, force)
    for one, d, f in zip(found, distance, force, strict=True):
        expected = least_heat(bearing, d, f, bias, limits)
        assert expected is not None
        np.testing.assert_allclose(one, expected, atol=1e-3)
