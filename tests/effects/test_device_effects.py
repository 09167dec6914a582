"""Supply, core, fluid and position sensor against devices that are drawn with what the effect adds."""

from dataclasses import replace

import numpy as np
import pytest

from femfit.device.mechanics import Mechanics
from femfit.effects.catalogue import effect_by_name
from femfit.effects.conditions import Conditions
from femfit.effects.effect import AddedEffect
from femfit.effects.stages import true_setting
from femfit.model.dynamics import state_derivative
from femfit.model.readings import predict_readings
from femfit.model.with_effects import nominal_of, with_effects
from support.solenoids import solenoid

STATE = np.array([[1e-3, 0.3, 0.4], [3e-3, -0.8, 1.2]])


def added(name, **parameters):
    effect = effect_by_name(name)
    return AddedEffect(effect, effect.null() | parameters)


def test_a_source_with_an_inner_resistance_is_a_larger_winding_resistance():
    model = solenoid()
    sagging = with_effects(model, [added("supply_sag", inner_resistance=0.1)])
    larger = replace(model, circuits=(replace(model.circuit, resistance_ohm=22.0),))
    volts = np.array([6.0, 12.0])
    np.testing.assert_allclose(
        state_derivative(sagging, STATE, volts)[:, 2], state_derivative(larger, STATE, volts)[:, 2], rtol=1e-6
    )
    assert sagging.circuit.resistance_ohm == 20.0  # the winding's own, as a bench reads it


def test_a_fluid_brakes_with_the_square_of_the_velocity():
    model = replace(solenoid(), motion=Mechanics(0.025, 0.0))
    slowed = with_effects(model, [added("fluid_drag", drag_per_m=5.0)])
    change = (state_derivative(slowed, STATE, np.zeros(2)) - state_derivative(model, STATE, np.zeros(2)))[:, 1]
    np.testing.assert_allclose(change, [-5.0 * 0.3**2, 5.0 * 0.8**2], rtol=1e-3)  # of forces of some hundred m/s^2


def test_a_guide_that_side_pull_presses_on_brakes_with_the_square_of_the_current():
    model = replace(solenoid(), motion=Mechanics(0.025, 0.0))
    rough = with_effects(model, [added("side_pull_friction", share=0.1)])
    change = (state_derivative(rough, STATE, np.zeros(2)) - state_derivative(model, STATE, np.zeros(2)))[:, 1]
    nominal = rough.conditions.nominal
    size = 0.1 * nominal.force_N * (STATE[:, 2] / nominal.peak_current_A) ** 2 / 0.025
    np.testing.assert_allclose(change, [-size[0], size[1]], rtol=1e-3)  # of forces of some hundred m/s^2


def test_a_core_that_keeps_a_flux_reads_as_a_current_that_takes_no_voltage():
    model, d, i = solenoid(), np.array([1e-3, 3e-3]), np.array([0.0, 0.5])
    at = Conditions(nominal_of(model))
    kept = predict_readings(model, d, i, at, [added("core_remanence", mmf=0.05)])
    driven, plain = (predict_readings(model, d, current, at) for current in (i + 0.1, i))
    for channel in ("force_N", "flux_linkage_Wb"):
        np.testing.assert_allclose(kept[channel], driven[channel], rtol=1e-12)
    np.testing.assert_allclose(kept["voltage_V"], plain["voltage_V"], rtol=1e-12)
    assert kept["force_N"][0] > 0.0


def test_a_bent_position_sensor_is_right_at_both_ends_and_its_sizes_are_at_its_peaks():
    nominal = nominal_of(solenoid())
    u = np.linspace(0.0, 1.0, 1001)
    d = nominal.distance_min_m + u * nominal.travel_m
    for name, peaks in (("bow", [0.5]), ("bend", [0.5 - np.sqrt(1.0 / 12.0), 0.5 + np.sqrt(1.0 / 12.0)])):
        true, _ = true_setting([added("position_nonlinearity", **{name: 0.02})], d, 0.0 * d, Conditions(nominal))
        error = (true - d) / nominal.travel_m
        assert error[[0, -1]] == pytest.approx([0.0, 0.0], abs=1e-12)
        assert np.abs(error).max() == pytest.approx(0.02, rel=1e-5)
        assert np.abs(np.interp(peaks, u, error)) == pytest.approx(0.02, rel=1e-5)
