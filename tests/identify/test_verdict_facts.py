"""Ties, certainty, dominant causes and units of a diagnosis; springs, cores and magnets that are named or not."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

import femfit as ff
from femfit.audit.audit_model import audit_model
from femfit.core.errors import MissingPartError, TableError
from femfit.device.electrics import Drive
from femfit.device.load import read_actuator
from femfit.device.mechanics import Mechanics, Spring
from femfit.effects.catalogue import all_effects, effect_by_name
from femfit.effects.conditions import Conditions
from femfit.field.sweep import run_sweep
from femfit.fit.build import fit_model
from femfit.identify.add_result import EffectSize
from femfit.identify.bench import bench_observations, placed
from femfit.identify.decision.diagnose import diagnose
from femfit.identify.plan import possible_experiments
from femfit.identify.signatures import why_untestable
from femfit.identify.suggest import suggest
from femfit.model.carried import FieldTerm
from femfit.model.coordinate import DistanceCoordinate
from femfit.model.drawn_effect import DrawnEffect
from femfit.model.magnetics import CoenergySpline
from femfit.model.readings import predict_readings
from femfit.model.validity import ActuatorKind
from femfit.model.with_effects import nominal_of, with_effects
from femfit.tables.measurement import CHANNELS
from support.campaign import campaign, hidden, ripple, without
from support.closed_loop import recorded
from support.magnet_pair import bench_csv, force, magnet_pair
from support.reference import REFERENCE
from support.replays import STEP_S, damped, series
from support.solenoids import solenoid
from support.splines import REFERENCE_DISTANCE, fitted_spline
from support.steps import runge_kutta_step
from support.switching import logged, switched

COORDINATE = DistanceCoordinate(REFERENCE_DISTANCE)
CURRENTS = np.linspace(0.0, 1.4, 8)
SMALL = {"runs": 2, "distances": 8, "currents": 5, "rho": 0.0}
FORCE = {"force_N": 4e-4}


def with_numbers(solenoid, **shares):
    """The solenoid with numbers of its drawing: what 1 mm of each, per place, has of a distance that is 1 mm longer."""

    def number(place, share):
        def change(d, i):
            return share(d) * 1e-3 * -0.5 * 5.0 * np.exp(-d / 0.01) * i**2

        term = FieldTerm("change_mm", coenergy=CoenergySpline(COORDINATE, fitted_spline(change, CURRENTS, 2)))
        return DrawnEffect(f"fixed.regions.yoke.{place}", place, "mm", 5.0, 0.1, (term,))

    return replace(solenoid, drawn=tuple(number(place, share) for place, share in shares.items()))


def near(d):
    return 1.0 / (1.0 + np.exp((d - 0.022) / 0.004))


def far(d):
    return 1.0 - near(d)


def shifted(model):
    """Readings of a stage that stands 0.3 mm off."""
    noise = {"force_N": 2e-4, "flux_linkage_Wb": 1e-5}
    return campaign(model, 1, [hidden("distance_offset", offset_m=3e-4)], noise=noise, mount_m=2e-6, rho=0.0)


@pytest.fixture(scope="module")
def found_shift(solenoid):
    return ff.diagnose(solenoid, shifted(solenoid))


@pytest.mark.parametrize("seed", [2, pytest.param(8, marks=pytest.mark.nightly)])
def test_of_equal_causes_the_one_with_fewer_parameters_stands_first_and_all_are_in_the_first_line(
    levitation_model, seed
):
    weak = hidden("remanence", remanence_error=-0.04)
    table = without(
        campaign(levitation_model, seed, [weak], noise=FORCE, mount_m=0.0, **SMALL),
        "coil_temperature_C",
        "magnet_temperature_C",
    )
    found = ff.diagnose(levitation_model, table)
    (named,) = found.missing
    assert named.name == named.tie[0] == "remanence"  # magnet_demagnetisation has two amplitudes
    assert "magnet_demagnetisation" in named.tie
    assert set(named.tie) <= set(named.members)
    assert len(named.tied_words) == len(named.tie) - 1
    assert json.loads(json.dumps(found.to_dict()))["missing"][0]["tie"] == list(named.tie)


def test_a_size_that_is_unusual_ties_with_none_that_is_usual(solenoid):
    """A force sensor that reads 13 % too much is unusual; 6 % more turns or current, the same forces, are not."""
    gain = [hidden("force_gain", gain_error=0.13)]
    table = campaign(solenoid, 1, gain, noise={"force_N": 1e-3}, mount_m=2e-6, **SMALL)
    (named,) = ff.diagnose(solenoid, table).missing
    assert named.plausible
    assert set(named.tie) == {"current_gain", "turns"}
    assert "force_gain" in named.members


def test_what_mounts_are_granted_makes_no_cause_of_one_that_leaves_the_readings_unexplained(levitation_model):
    """30 um from run to run are assumed: what these would make up for is no reason to name a usual size first."""
    table = campaign(
        levitation_model, 1, [hidden("distance_scale", scale_error=0.1)], noise=FORCE, mount_m=0.0, **SMALL
    )
    found = ff.diagnose(levitation_model, table)
    (named,) = found.missing
    left = {one.name: one.error_left for one in found.ranking}
    assert left["magnet_demagnetisation"] > 3.0
    assert all(left[name] < 1.5 for name in named.tie)


def whole(d):
    return np.ones_like(d)


FACE, CORNERS = "polygon_mm[3..4][1]", {"polygon_mm[3][1]": near, "polygon_mm[4][1]": far}


def test_a_face_that_moves_like_the_stage_leaves_nothing_certain(solenoid):
    model = with_numbers(solenoid, **{FACE: whole}, **CORNERS)
    found = ff.diagnose(model, shifted(model))
    assert {"distance_offset", f"fixed.regions.yoke.{FACE}"} <= set(found.missing[0].members)
    assert not found.confident
    assert found.dimensions_suspected
    suspects = {one.name for one in found.ranking}
    assert {one for one in found.look_alikes if not one.startswith("a constant error of")} <= suspects


@pytest.mark.parametrize("corners", [dict([next(iter(CORNERS.items()))]), CORNERS])
def test_corners_of_other_shapes_do_not_take_certainty_away(solenoid, corners):
    """Nor do two of them that no face moves together: each is a suspect by itself."""
    model = with_numbers(solenoid, **corners)
    found = ff.diagnose(model, shifted(model))
    assert found.confident
    assert found.dimensions_suspected


def test_what_is_certain_among_the_catalogue_says_that_no_dimension_was_suspected(found_shift):
    found = found_shift
    assert found.missing[0].tie == ("distance_offset",)
    assert found.confident
    assert not found.dimensions_suspected
    assert not found.to_dict()["dimensions_suspected"]


def test_a_cause_of_nearly_all_of_an_unexplained_misfit_is_named_with_its_size_and_part(levitation_model):
    table = campaign(
        levitation_model, 5, [hidden("resistance", resistance_error=5.0)], change=ripple("force_N", 4e-3), **SMALL
    )
    found = ff.diagnose(levitation_model, table)
    assert (found.verdict, found.missing) == ("unexplained", ())
    fact = found.to_dict()["dominant"]
    assert (fact["name"], fact["tie"]) == ("resistance", ["resistance"])
    low, high = fact["ci95"]["resistance_error"]
    assert low < 5.0 < high
    assert 0.99 < fact["explained_share"] < 1.0


def test_a_record_without_a_fluxmeter_is_not_said_to_hide_the_drift_of_one(model, loops):
    found = ff.diagnose(model, recorded(loops[loops["time_s"] < 1.0]))
    notes = {one.name: one.note for one in found.ranking}
    assert notes["flux_integrator_drift"] == "these data lack flux_linkage_Wb"
    assert notes["force_gain"] == "these data lack force_N"


def test_what_a_direct_reading_may_separate_is_not_called_inseparable(solenoid):
    gain = [hidden("force_gain", gain_error=0.05)]
    size = {"runs": 3, "distances": 8, "currents": 4}
    table = campaign(solenoid, 1, gain, noise={"force_N": 3e-2}, mount_m=5e-6, **size)
    found = ff.diagnose(solenoid, table)
    advice = ff.suggest(solenoid, table, found)
    pair = ("force_gain", "lateral_misalignment")
    assert pair in [one[:2] for one in advice.perhaps]
    assert pair not in advice.never
    weight = effect_by_name("force_gain").check
    assert weight in [one[2] for one in advice.perhaps]
    assert advice.to_dict()["perhaps"][0][3] > 1.6


INTERVAL = re.compile(r"(-?[\d.]+) (\S+) [^()]*\(95 %: (-?[\d.]+) to (-?[\d.]+) (\S+)\)")


def test_every_printed_interval_contains_its_printed_value(found_shift):
    """0.302 mm between 0.301 and 0.303 mm is no 0.30 mm."""
    sizes = [EffectSize("gain", "voltage_V", 0.1345, (0.133, 0.136), 0.1, 0.02, 1.0)]
    lines = [line for text in (found_shift, *sizes) for line in str(text).splitlines() if "(95 %:" in line]
    assert len(lines) == 2
    for line in lines:
        value, unit, low, high, of_interval = INTERVAL.search(line).groups()
        assert unit == of_interval
        assert float(low) <= float(value) <= float(high)


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
    found = diagnose(bare, campaign(bare, 41, change=carrying(Spring(300.0, 0.5, 6e-3)), **SIZE))
    assert (found.verdict, [one.members for one in found.missing]) == ("named", [("spring",)])
    stiffness, preload = spring_of(bare, found.missing[0])
    assert stiffness[0] < 300.0 < stiffness[1] < 310.0
    assert preload[0] < 0.5 < preload[1] < 0.55
    assert found.lack_of_fit_after.p_value > 0.01


def test_a_drawn_spring_in_the_force_readings_is_no_further_spring():
    spring = Spring(300.0, 0.5, 6e-3)
    drawn = replace(solenoid(), motion=Mechanics(0.025, 0.0, springs=(spring,)))
    table = campaign(drawn, 43, change=carrying(spring), **SIZE)
    found = diagnose(drawn, table)
    assert (found.verdict, found.missing[0].name) == ("named", "spring_in_force")
    assert found.missing[0].parameters["share"] == pytest.approx(1.0, abs=0.05)
    assert "drawn-spring" in {one.code for one in found.findings}
    assert "drawing has a spring" in why_untestable(effect_by_name("spring"), bench_observations(drawn, table))


def suspended(stiffness):
    """A body that swings on a suspension at rest in the middle of its travel."""
    spring = Spring(stiffness, 0.0, 3e-3)
    return replace(solenoid(), motion=Mechanics(0.025, 0.0, springs=(spring,), viscous_N_s_per_m=0.5))


@pytest.mark.nightly
@pytest.mark.parametrize("hidden", [2300.0, 2600.0])
def test_a_stiffer_suspension_is_no_pair_of_stops_and_no_other_preload(hidden):
    """15 % and 30 % stiffer than drawn."""
    drawn, true = suspended(2000.0), suspended(hidden)
    swing = logged([switched([0.0], [0.4], 0.12, model=true, start_m=1.2e-3)], noise=(5e-4, 2e-6))
    found = diagnose(drawn, swing)
    assert (found.verdict, found.missing[0].name) == ("named", "spring_stiffness")
    assert found.missing[0].parameters["stiffness_error"] == pytest.approx(hidden / 2000.0 - 1.0, rel=0.05)
    both = ff.add_effects(drawn, swing, ["spring_stiffness", "spring_preload"])
    low, high = both.added[1].ci95["preload"]
    assert low < 0.0 < high


@pytest.mark.nightly
def test_an_effect_that_raises_the_error_on_runs_left_out_is_not_accepted_without_a_word():
    """Two swings with suspensions 40 % stiffer and 40 % softer: what one of them shows is wrong of the other."""
    drawn, stiff, soft = (suspended(k) for k in (2000.0, 2800.0, 1200.0))
    swings = [switched([0.0], [0.4], 0.06, model=true, start_m=1.2e-3) for true in (stiff, soft)]
    result = ff.add_effects(drawn, logged(swings, noise=(5e-4, 2e-6)), "spring_stiffness")
    assert max(result.left_out[one.channel] / one.rms_before for one in result.fall.channels) > 1.2


def test_a_late_position_sensor_is_named_with_its_delay(model, loops):
    samples = loops[loops["run"] == 1.0]
    shifted = np.interp(samples["time_s"] - 2e-3, samples["time_s"], samples["distance_m"])
    found = diagnose(model, recorded(samples.assign(distance_m=shifted)))
    assert (found.verdict, found.missing[0].name) == ("named", "position_delay")
    assert found.missing[0].parameters["delay_s"] == pytest.approx(2e-3, rel=0.1)


def test_a_flux_that_the_core_keeps_is_told_from_an_ammeters_zero_by_the_voltage():
    steel = replace(solenoid(), kind=ActuatorKind(False, False, True, True, True, False))
    effect = hidden("core_remanence", mmf=0.02)
    size = {"mount_m": 2e-6, "rho": 0.0, "distances": 7, "currents": 6}
    noise = {"force_N": 0.02, "voltage_V": 0.02}
    found = diagnose(steel, campaign(steel, 44, [effect], noise=noise, **size))
    assert (found.verdict, [one.members for one in found.missing]) == ("named", [("core_remanence",)])
    bare = replace(steel, kind=replace(steel.kind, fixed_iron=False, moving_iron=False))
    assert "no iron" in why_untestable(effect.effect, bench_observations(bare, campaign(bare, 44, noise=noise, **size)))


def test_a_current_amplifier_has_no_voltage_that_it_could_miss(model, clean_record):
    amplifier = replace(model, circuits=(replace(model.circuit, drive=Drive("current")),))
    for name in ("driver_gain", "driver_dead_zone", "supply_sag"):
        effect = effect_by_name(name)
        assert why_untestable(effect, placed(model, clean_record)) == ""
        assert "current amplifier" in why_untestable(effect, placed(amplifier, clean_record))


@pytest.fixture(scope="module")
def pair():
    return magnet_pair()


@pytest.fixture(scope="module")
def shifted_pair(tmp_path_factory):
    return bench_csv(tmp_path_factory.mktemp("bench") / "shifted.csv", shift_m=0.1e-3)


@pytest.mark.parametrize("passed_m", [0.0, 6e-3], ids=["before the face", "beyond it"])
def test_a_gap_that_is_larger_is_named_though_a_table_has_no_currents(tmp_path, passed_m):
    device = magnet_pair(passed_m) if passed_m else magnet_pair()
    more = {"passed_m": passed_m} if passed_m else {}
    found = diagnose(device, bench_csv(tmp_path / "shifted.csv", shift_m=0.1e-3, **more))
    assert found.missing[0].name == "distance_offset"
    assert found.missing[0].parameters["offset_m"] == pytest.approx(0.1e-3, rel=0.2)
    assert diagnose(device, bench_csv(tmp_path / "clean.csv", **more)).verdict == "nothing_missing"


def test_only_effects_that_it_can_have_are_considered(pair, shifted_pair):
    observations = placed(pair, shifted_pair)
    reasons = {name: why_untestable(effect, observations) for name, effect in all_effects().items()}
    considered = {name for name, why in reasons.items() if not why}
    assert {"remanence", "distance_offset", "force_gain", "magnet_temperature"} <= considered
    without_coil = {name for name, why in reasons.items() if "no coil" in why}
    assert {"turns", "resistance", "current_gain", "hysteresis", "driver_gain", "motional_emf"} <= without_coil
    assert "Hall element" in reasons["hall_offset"]


def test_a_circuit_asks_for_currents_and_is_asked_of_no_magnet_alone(pair, levitation_model, shifted_pair):
    with pytest.raises(TableError, match="current_A"):
        placed(levitation_model, shifted_pair)
    with pytest.raises(MissingPartError, match="coil"):
        pair.require_circuit()
    findings = audit_model(pair).findings
    assert not [one for one in findings if one.severity == "wrong"]
    assert "inductance" not in {one.code for one in findings}


@pytest.mark.nightly
def test_a_mass_that_is_much_larger_is_not_lost_where_something_else_stays(model, loops):
    """The search takes up what is likely, and 62 % more mass is not."""
    samples = loops[loops["run"] == 1.0]
    wave = np.sin(2.0 * np.pi * samples["distance_m"] / 2e-3)
    samples = samples.assign(voltage_V=samples["voltage_V"] * (1.0 + 0.01 * wave))
    light = replace(model, motion=Mechanics(model.motion.mass_kg / 1.62))
    found = ff.diagnose(light, recorded(samples))
    assert found.verdict == "unexplained"
    assert found.dominant.tie == ("mass_error",)
    assert found.dominant.parameters["mass_error"] == pytest.approx(0.62, abs=0.01)
    assert found.dominant.explained_share > 0.9


STRANGER = REFERENCE / "strangers" / "push.toml"


@pytest.mark.nightly
@pytest.mark.skipif(not STRANGER.is_file(), reason="the newcomer's drawing is not there")
def test_the_newcomers_return_spring_is_found(tmp_path):
    """1 N at 8 mm and 0.5 N/mm on a saturating push solenoid; the sweep takes one to two minutes."""
    model = fit_model(run_sweep(read_actuator(STRANGER), tmp_path, workers=1)).model
    found = diagnose(model, STRANGER.parent / "spring.csv")
    assert (found.verdict, [one.members for one in found.missing]) == ("named", [("spring",)])
    stiffness, preload = spring_of(model, found.missing[0])
    assert stiffness[0] < 500.0 < stiffness[1] < 550.0
    assert preload[0] < 1.0 < preload[1] < 1.1
    assert found.lack_of_fit_before.p_value < 1e-6
    force = found.error_fall.channels[0]
    assert force.rms_after < 0.03 * force.rms_before


@pytest.mark.nightly
def test_friction_that_grows_with_the_current_squared_is_told_from_dry_friction():
    model, generator, k = damped(), np.random.default_rng(4), np.arange(4000)
    sticky = with_effects(model, [hidden("side_pull_friction", share=0.05)])
    volts = 14.0 + 10.0 * np.sign(np.sin(k / 150.0)) * (1.0 + 0.5 * np.sin(k / 900.0))
    state, truth = np.array([[3.5e-3, 0.0, 0.2]]), np.empty((len(k), 3))
    for row in k:
        truth[row] = state[0]
        state = runge_kutta_step(sticky, state, volts[row : row + 1], STEP_S, 4)
    noise = generator.standard_normal((2, len(k)))
    record = series(volts, truth[:, 2] + 2e-3 * noise[0], truth[:, 0] + 5e-6 * noise[1])
    rows = record.rows.assign(coil_temperature_C=np.nan, magnet_temperature_C=np.nan)
    found = diagnose(model, replace(record, rows=rows))
    assert [one.members for one in found.missing] == [("side_pull_friction",)]
    assert found.missing[0].parameters["share"] == pytest.approx(0.05, rel=0.1)


def test_no_flux_linkage_is_suggested_where_there_is_no_winding(pair, tmp_path):
    little = bench_csv(tmp_path / "little.csv", shift_m=0.02e-3)
    assert len(suggest(pair, little).explanations) > 1
    observations = placed(pair, little)
    read = predict_readings(
        pair, np.array([5e-3]), np.array([0.0]), Conditions(observations.nominal), channels=CHANNELS
    )
    measurements = possible_experiments(observations, tuple(read), list(all_effects().values()))
    assert any("once more, on a new mount" in one.text for one in measurements)
    assert not any("flux linkage" in one.text for one in measurements)


def test_a_body_that_is_let_go_shows_its_mass_over_its_force(pair, tmp_path):
    """Motion under the magnets' force and its weight, by another method, with a body that is 20 % heavier."""
    mass, step, lines = 1.2 * pair.motion.mass_kg, 1e-5, ["run,time_s,distance_m"]
    noise = np.random.default_rng(3)
    for run, start in enumerate((15e-3, 12e-3, 9e-3), 1):
        d, v, k = start, 0.0, 0
        while d > 1e-3:
            v += step * (pair.motion.gravity_m_s2 - float(force(d)) / mass)
            d += step * v
            if k % 10 == 0:
                lines.append(f"{run},{k * step:.6f},{d + noise.normal(0.0, 2e-6):.9f}")
            k += 1
    path = tmp_path / "falls.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    found = diagnose(pair, path)
    assert {"mass_error", "remanence"} <= set(found.missing[0].members)  # a motion alone shows their ratio
