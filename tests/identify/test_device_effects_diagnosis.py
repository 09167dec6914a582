"""What position sensor, supply and core do is found in records and bench tables, where the device can have it."""

from dataclasses import replace

import numpy as np
import pytest

from femfit.device.electrics import Drive
from femfit.effects.catalogue import effect_by_name
from femfit.effects.effect import AddedEffect
from femfit.identify.decision.diagnose import diagnose
from femfit.identify.readings.bench import bench_observations, placed
from femfit.identify.signatures import why_untestable
from femfit.model.dynamics import runge_kutta_step
from femfit.model.validity import ActuatorKind
from femfit.model.with_effects import with_effects
from support.campaign import campaign
from support.closed_loop import closed_loop, recorded
from support.replays import STEP_S, damped, series
from support.solenoids import solenoid

QUICK = {"bootstrap": 0}


@pytest.fixture(scope="module")
def model(levitation_model):
    return replace(levitation_model, sample_time_s=1e-3)


@pytest.fixture(scope="module")
def samples(model):
    return closed_loop(model, seconds=2.5, seed=3)


def test_a_late_position_sensor_is_named_with_its_delay(model, samples):
    late = samples.copy()
    shifted = np.interp(samples["time_s"] - 2e-3, samples["time_s"], samples["distance_m"])
    found = diagnose(model, recorded(late.assign(distance_m=shifted)), **QUICK)
    assert (found.verdict, found.missing[0].name) == ("named", "position_delay")
    assert found.missing[0].parameters["delay_s"] == pytest.approx(2e-3, rel=0.1)


def test_a_supply_that_sags_is_one_class_with_a_larger_resistance(model):
    effect = effect_by_name("supply_sag")
    record = recorded(closed_loop(model, [AddedEffect(effect, {"inner_resistance": 0.05})], seconds=2.0, seed=3))
    found = diagnose(model, record, **QUICK)
    assert {"supply_sag", "resistance"} <= set(found.missing[0].members)


def test_a_flux_that_the_core_keeps_is_told_from_an_ammeters_zero_by_the_voltage():
    steel = replace(solenoid(), kind=ActuatorKind(False, False, True, True, True, False))
    effect = AddedEffect(effect_by_name("core_remanence"), {"mmf": 0.02})
    size = {"mount_m": 2e-6, "rho": 0.0, "distances": 7, "currents": 6}
    noise = {"force_N": 0.02, "voltage_V": 0.02}
    found = diagnose(steel, campaign(steel, 44, [effect], noise=noise, **size), **QUICK)
    assert (found.verdict, [one.members for one in found.missing]) == ("named", [("core_remanence",)])
    bare = replace(steel, kind=replace(steel.kind, fixed_iron=False, moving_iron=False))
    assert "no iron" in why_untestable(effect.effect, bench_observations(bare, campaign(bare, 44, noise=noise, **size)))


def test_a_current_amplifier_has_no_voltage_that_it_could_miss(model, samples):
    amplifier = replace(model, circuits=(replace(model.circuit, drive=Drive("current")),))
    record = recorded(samples)
    for name in ("driver_gain", "driver_dead_zone", "supply_sag"):
        effect = effect_by_name(name)
        assert why_untestable(effect, placed(model, record)) == ""
        assert "current amplifier" in why_untestable(effect, placed(amplifier, record))


def test_friction_that_grows_with_the_current_squared_is_told_from_dry_friction():
    model, generator, k = damped(), np.random.default_rng(4), np.arange(4000)
    sticky = with_effects(model, [AddedEffect(effect_by_name("side_pull_friction"), {"share": 0.05})])
    volts = 14.0 + 10.0 * np.sign(np.sin(k / 150.0)) * (1.0 + 0.5 * np.sin(k / 900.0))
    state, truth = np.array([[3.5e-3, 0.0, 0.2]]), np.empty((len(k), 3))
    for row in k:
        truth[row] = state[0]
        state = runge_kutta_step(sticky, state, volts[row : row + 1], STEP_S, 4)
    noise = generator.standard_normal((2, len(k)))
    record = series(volts, truth[:, 2] + 2e-3 * noise[0], truth[:, 0] + 5e-6 * noise[1])
    rows = record.rows.assign(coil_temperature_C=np.nan, magnet_temperature_C=np.nan)
    found = diagnose(model, replace(record, rows=rows), **QUICK)
    assert [one.members for one in found.missing] == [("side_pull_friction",)]
    assert found.missing[0].parameters["share"] == pytest.approx(0.05, rel=0.1)
