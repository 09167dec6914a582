"""Effects against devices that are drawn with what the effect adds, and against what an engineer would work out."""

from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np
import pytest
from scipy import optimize

from femfit.device.mechanics import ForceTable, Mechanics, Spring
from femfit.effects.conditions import Conditions
from femfit.effects.stages import true_setting
from femfit.model.readings import predict_readings
from femfit.model.with_effects import nominal_of, with_effects
from support.added_effects import added, under_effects
from support.model_kinds import rates
from support.parts import with_circuit, with_motion
from support.solenoids import solenoid

STATE = np.array([[1e-3, 0.3, 0.4], [3e-3, -0.8, 1.2]])
RIG_STATE = np.array([[0.02, 0.1, 0.3], [0.024, -0.2, 0.5]])
VOLTS = np.array([[6.0], [12.0]])
D, CURRENT = np.array([0.5e-3, 2e-3, 5.5e-3]), np.array([0.2, 1.0, 1.7])
DRAWN = Spring(200.0, 0.1, 4e-3)


def with_springs(*springs):
    return with_motion(solenoid(), springs=springs)


def missing_spring(model):
    nominal = nominal_of(model)
    push = DRAWN.preload_N - DRAWN.stiffness_N_per_m * (nominal.distance_max_m - DRAWN.distance_m)
    stiffness = DRAWN.stiffness_N_per_m / nominal.stiffness_N_per_m
    return added("spring", stiffness=stiffness, preload=float(push) / nominal.force_N)


def more_preload(model):
    return added("spring_preload", preload=0.05 / nominal_of(model).force_N)


AS_DRAWN = {  # springs, effect, device that is drawn with it
    "supply_sag": ((DRAWN,), added("supply_sag", inner_resistance=0.1), partial(with_circuit, resistance_ohm=22.0)),
    "spring": ((), missing_spring, partial(with_motion, springs=(DRAWN,))),
    "spring_stiffness": (  # of the same free length, 4.5 mm
        (DRAWN,), added("spring_stiffness", stiffness_error=0.2),
        partial(with_motion, springs=(Spring(240.0, 0.0, 4.5e-3),)),
    ),
    "spring_preload": ((DRAWN,), more_preload, partial(with_motion, springs=(Spring(200.0, 0.15, 4e-3),))),
    "mass_error": ((DRAWN,), added("mass_error", mass_error=0.1), partial(with_motion, mass_kg=0.0275)),
    "viscous_friction": (
        (DRAWN,), added("viscous_friction", damping_per_s=5.0), partial(with_motion, viscous_N_s_per_m=0.125),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", AS_DRAWN)
def test_a_model_under_an_effect_moves_as_the_device_that_is_drawn_with_it(name):
    springs, effect, device = AS_DRAWN[name]
    model = with_springs(*springs)
    changed = with_effects(model, [effect(model) if callable(effect) else effect])
    states = np.stack([D[:2], STATE[:, 1], CURRENT[:2]], axis=-1)
    # The co-energy under effects is a table of fourth order in the distance
    np.testing.assert_allclose(rates(changed, states, VOLTS), rates(device(model), states, VOLTS), rtol=1e-5)
    assert changed.circuit.resistance_ohm == 20.0  # the winding's own, as a bench reads it


@pytest.mark.parametrize(
    ("effect", "volts"),
    [
        (added("driver_gain", gain_error=-0.1), 1.35),
        (added("driver_dead_zone", dead_zone=0.1), 1.2),
        (added("driver_dead_zone", drop=0.1), 1.2),
    ],
)
def test_a_driver_that_is_off_applies_another_voltage(effect, volts, levitation_model):
    changed = rates(with_effects(levitation_model, [effect]), RIG_STATE, np.full((2, 1), 1.5))
    plain = rates(levitation_model, RIG_STATE, np.full((2, 1), volts))
    np.testing.assert_allclose(changed[:, 2], plain[:, 2], rtol=1e-6)


def test_without_a_motional_voltage_the_current_rises_as_at_rest(levitation_model):
    resting = RIG_STATE * [1.0, 0.0, 1.0]
    without = rates(under_effects(levitation_model, ("motional_emf", {"share": -1.0})), RIG_STATE, VOLTS / 4.0)
    np.testing.assert_allclose(without[:, 2], rates(levitation_model, resting, VOLTS / 4.0)[:, 2], rtol=1e-6)


NOMINAL = nominal_of(solenoid())


@pytest.mark.parametrize(
    ("name", "parameters", "brake"),
    [
        ("fluid_drag", {"drag_per_m": 5.0}, 5.0 * STATE[:, 1] ** 2),
        ("side_pull_friction", {"share": 0.1}, 4.0 * NOMINAL.force_N * (STATE[:, 2] / NOMINAL.peak_current_A) ** 2),
        ("coulomb_friction", {"level": 0.2}, 0.2 * 9.80665),  # of the weight on Earth, though the body lies
    ],
)
def test_friction_acts_against_the_velocity(name, parameters, brake):
    model = solenoid(Mechanics(0.025, 0.0))
    rough = under_effects(model, (name, parameters))
    change = (rates(rough, STATE, np.zeros((2, 1))) - rates(model, STATE, np.zeros((2, 1))))[:, 1]
    np.testing.assert_allclose(change, -np.sign(STATE[:, 1]) * brake, rtol=1e-3)  # of forces of some hundred m/s^2


def test_a_temperature_changes_winding_and_magnet_whether_recorded_or_not(levitation_model):
    warm = under_effects(levitation_model, ("coil_temperature", {"warmer_K": 10.0, "warming_K": 15.0}))
    assert warm.circuit.resistance_ohm == pytest.approx(2.69 * (1.0 + 0.00393 * 25.0))
    recorded = replace(levitation_model, coil_temperature_C=45.0)
    warm = under_effects(recorded, ("coil_temperature", {"coefficient_per_K": 0.004}))
    assert warm.circuit.resistance_ohm == pytest.approx(2.69 * 1.1)
    weak = under_effects(levitation_model, ("magnet_temperature", {"warmer_K": 20.0}))
    force = levitation_model.force(0.02, 0.0)
    assert weak.force(0.02, 0.0) == pytest.approx((1.0 - 0.022) ** 2 * force, rel=1e-9)


def test_a_core_that_keeps_a_flux_reads_as_a_current_that_takes_no_voltage():
    model, d, i = solenoid(), np.array([1e-3, 3e-3]), np.array([0.0, 0.5])
    at = Conditions(nominal_of(model))
    remanent = predict_readings(model, d, i, at, [added("core_remanence", mmf=0.05)])
    driven, plain = (predict_readings(model, d, current, at) for current in (i + 0.1, i))
    for channel in ("force_N", "flux_linkage_Wb"):
        np.testing.assert_allclose(remanent[channel], driven[channel], rtol=1e-12)
    np.testing.assert_allclose(remanent["voltage_V"], plain["voltage_V"], rtol=1e-12)
    assert remanent["force_N"][0] > 0.0


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


def change_of_force(model, effect):
    at = Conditions(nominal_of(model))
    changed, plain = (predict_readings(model, D, CURRENT, at, effects)["force_N"] for effects in ([effect], []))
    return changed - plain


@pytest.mark.parametrize(
    "springs",
    [(DRAWN,), (DRAWN, Spring(300.0, -0.5, 2e-3)), (DRAWN, ForceTable((0.2e-3, 3e-3, 7e-3), (3.0, 1.0, -0.5)))],
)
def test_what_a_force_sensor_reads_of_springs(springs):
    """A missing spring, drawn ones that are stiffer at their free lengths, and those that hang on the sensor."""
    pushed = 0.1 - 200.0 * (D - 4e-3)
    bare, drawn = with_springs(), with_springs(*springs)
    np.testing.assert_allclose(change_of_force(bare, missing_spring(bare)), -pushed, rtol=1e-12)
    push = drawn.motion.push_of_springs(D)
    stiffer = change_of_force(drawn, added("spring_stiffness", stiffness_error=0.3))
    assert len(springs) > 1 or np.allclose(push, pushed)
    np.testing.assert_allclose(stiffer, -0.3 * push, rtol=1e-12, atol=1e-13)
    hanging = change_of_force(drawn, added("spring_in_force", share=1.0))
    np.testing.assert_allclose(hanging, -push, rtol=1e-12, atol=1e-13)


def test_the_plant_is_stopped_where_the_effect_says():
    model = solenoid()
    changed = under_effects(model, ("stop_position", {"near": 0.02}))
    shift = 0.02 * (model.validity.distance_max_m - model.validity.distance_min_m)
    assert changed.motion.near_stop.distance_m == pytest.approx(model.motion.near_stop.distance_m + shift)
    assert changed.motion.far_stop == model.motion.far_stop


def test_a_saturating_core_lies_in_series_with_the_inductance_at_every_distance():
    """At the flux that i - g'(flux) drives through the unsaturated device, force and flux are that device's."""
    base = solenoid()
    nominal, loss = nominal_of(base), 0.3
    saturated = with_effects(base, [added("core_saturation", mmf_loss_6=loss)]).magnetics

    def left(i, d):
        def missed(x):
            flux = base.magnetics.flux_linkage(d, np.array([x])).item() / nominal.flux_linkage_Wb
            return x + nominal.peak_current_A * loss * flux**5 - i

        return optimize.brentq(missed, 0.0, i, xtol=1e-14)

    for d, i in product(D[:, None], (0.5, 1.0, 1.7)):
        x, at = np.array([left(i, d)]), np.array([i])
        assert saturated.force(d, at) == pytest.approx(base.magnetics.force(d, x), rel=1e-7)
        assert saturated.flux_linkage(d, at) == pytest.approx(base.magnetics.flux_linkage(d, x), rel=1e-7)
    assert left(1.7, D[:1]) < 0.97 * 1.7
