"""A return spring is named with its stiffness and preload, and only where there is one."""

from dataclasses import replace

import numpy as np
import pytest

import femfit as ff
from femfit.device.load import read_actuator
from femfit.device.mechanics import Mechanics, Spring
from femfit.effects.catalogue import effect_by_name
from femfit.effects.effect import AddedEffect
from femfit.field.sweep import run_sweep
from femfit.fit.build import fit_model
from femfit.identify.decision.diagnose import diagnose
from femfit.identify.readings.bench import bench_observations
from femfit.identify.signatures import why_untestable
from femfit.model.with_effects import nominal_of
from support.campaign import campaign
from support.reference import REFERENCE
from support.solenoids import solenoid
from support.switching import logged, switched

STRANGER = REFERENCE / "strangers" / "push.toml"
QUICK = {"bootstrap": 0}
SIZE = {"noise": {"force_N": 0.02}, "mount_m": 2e-6, "rho": 0.0, "distances": 9, "currents": 5}


@pytest.fixture(scope="module")
def bare():
    """A solenoid of 19 N at most whose drawing has no spring."""
    return replace(solenoid(), motion=Mechanics(0.025, 0.0))


def carrying(spring):
    """A load cell on the body, which reads the spring as well."""

    def change(readings, rows):
        push = spring.preload_N - spring.stiffness_N_per_m * (rows["distance_m"].to_numpy() - spring.distance_m)
        return {"force_N": readings["force_N"] - push}

    return change


def spring_of(model, named):
    """Intervals of stiffness in N/m and of the preload at the largest distance in N."""
    nominal = nominal_of(model)
    return (
        np.array(named.ci95["stiffness"]) * nominal.stiffness_N_per_m,
        np.array(named.ci95["preload"]) * nominal.force_N,
    )


def test_a_spring_that_the_drawing_lacks_is_named_with_its_numbers(bare):
    found = diagnose(bare, campaign(bare, 41, change=carrying(Spring(300.0, 0.5, 6e-3)), **SIZE), **QUICK)
    assert (found.verdict, [one.members for one in found.missing]) == ("named", [("spring",)])
    stiffness, preload = spring_of(bare, found.missing[0])
    assert stiffness[0] < 300.0 < stiffness[1] < 310.0
    assert preload[0] < 0.5 < preload[1] < 0.55
    assert found.lack_of_fit_after.p_value > 0.01


def test_a_constant_force_is_not_taken_for_a_spring(bare):
    offset = AddedEffect(effect_by_name("force_offset"), {"offset": 0.02})
    found = diagnose(bare, campaign(bare, 42, [offset], **SIZE), **QUICK)
    assert set(found.missing[0].members) == {"force_offset", "constant_force"}


def test_a_drawn_spring_in_the_force_readings_is_no_further_spring():
    spring = Spring(300.0, 0.5, 6e-3)
    drawn = replace(solenoid(), motion=Mechanics(0.025, 0.0, springs=(spring,)))
    table = campaign(drawn, 43, change=carrying(spring), **SIZE)
    found = diagnose(drawn, table, **QUICK)
    assert (found.verdict, found.missing[0].name) == ("named", "spring_in_force")
    assert found.missing[0].parameters["share"] == pytest.approx(1.0, abs=0.05)
    assert "drawn-spring" in {one.code for one in found.findings}
    assert "drawing has a spring" in why_untestable(effect_by_name("spring"), bench_observations(drawn, table))


@pytest.mark.long
@pytest.mark.skipif(not STRANGER.is_file(), reason="the newcomer's drawing is not there")
def test_the_newcomers_return_spring_is_found(tmp_path):
    """1 N at 8 mm and 0.5 N/mm on a saturating push solenoid; the sweep takes one to two minutes."""
    model = fit_model(run_sweep(read_actuator(STRANGER), tmp_path, workers=1)).model
    found = diagnose(model, STRANGER.parent / "spring.csv", **QUICK)
    assert (found.verdict, [one.members for one in found.missing]) == ("named", [("spring",)])
    stiffness, preload = spring_of(model, found.missing[0])
    assert stiffness[0] < 500.0 < stiffness[1] < 550.0
    assert preload[0] < 1.0 < preload[1] < 1.1
    assert found.lack_of_fit_before.p_value < 1e-6
    force = found.error_fall.channels[0]
    assert force.rms_after < 0.03 * force.rms_before


@pytest.mark.parametrize("hidden", [2300.0, pytest.param(2600.0, marks=pytest.mark.long)])
def test_a_stiffer_suspension_is_no_pair_of_stops_and_no_other_preload(hidden):
    """A body that swings on a suspension at rest in the middle of its travel, 15 % and 30 % stiffer than drawn."""
    drawn, true = (
        replace(solenoid(), motion=Mechanics(0.025, 0.0, springs=(Spring(k, 0.0, 3e-3),), viscous_N_s_per_m=0.5))
        for k in (2000.0, hidden)
    )
    swing = logged([switched([0.0], [0.4], 0.12, model=true, start_m=1.2e-3)], noise=(5e-4, 2e-6))
    found = diagnose(drawn, swing, **QUICK)
    assert (found.verdict, found.missing[0].name) == ("named", "spring_stiffness")
    assert found.missing[0].parameters["stiffness_error"] == pytest.approx(hidden / 2000.0 - 1.0, rel=0.05)
    both = ff.add_effects(drawn, swing, ["spring_stiffness", "spring_preload"], base="never")
    low, high = both.added[1].ci95["preload"]
    assert low < 0.0 < high


def test_an_effect_that_raises_the_error_on_runs_left_out_is_not_accepted_without_a_word():
    """Two swings with suspensions 40 % stiffer and 40 % softer: what one of them shows is wrong of the other."""
    drawn, stiff, soft = (
        replace(solenoid(), motion=Mechanics(0.025, 0.0, springs=(Spring(k, 0.0, 3e-3),), viscous_N_s_per_m=0.5))
        for k in (2000.0, 2800.0, 1200.0)
    )
    swings = [switched([0.0], [0.4], 0.06, model=true, start_m=1.2e-3) for true in (stiff, soft)]
    result = ff.add_effects(drawn, logged(swings, noise=(5e-4, 2e-6)), "spring_stiffness", base="never")
    assert max(result.left_out[one.channel] / one.rms_before for one in result.fall.channels) > 1.2
    assert "left out" in str(result).splitlines()[0]
