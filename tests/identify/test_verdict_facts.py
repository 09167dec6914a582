"""Ties, certainty, dominant causes and units of a diagnosis; springs, cores and magnets that are named or not."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import femfit as ff
from femfit.audit.audit_model import audit_model
from femfit.core.errors import TableError
from femfit.device.electrics import Drive
from femfit.device.mechanics import Mechanics, Spring
from femfit.effects.catalogue import all_effects, effect_by_name
from femfit.effects.conditions import Conditions
from femfit.identify.bench import bench_observations, placed
from femfit.identify.decision.diagnose import said_of
from femfit.identify.plan import possible_experiments
from femfit.identify.signatures import why_untestable
from femfit.model.bspline import DistanceCoordinate
from femfit.model.carried import FieldTerm
from femfit.model.drawn_effect import DrawnEffect
from femfit.model.magnetics import CoenergySpline
from femfit.model.readings import predict_readings
from femfit.model.validity import ActuatorKind
from femfit.model.with_effects import nominal_of, with_effects
from femfit.tables.measurement import CHANNELS
from support.campaign import campaign, hidden, without
from support.closed_loop import recorded
from support.levitation import REFERENCE_DISTANCE, fitted_spline
from support.solenoids import solenoid


def force(distance):
    """Two disks of 10 mm that attract each other like charges on their faces, in N."""
    d = 1e3 * np.asarray(distance)
    return 400.0 * (1.0 / (d + 4.0) ** 2 - 1.4 / (d + 9.0) ** 2 + 0.5 / (d + 14.0) ** 2)


def magnet_pair(passed_m=0.0):
    """Their model, with the face moved into the fixed one by a length."""
    d = np.geomspace(0.2e-3, 20e-3, 24)
    rows = pd.DataFrame({"current_A": 0.0, "distance_m": d - passed_m, "force_N": force(d), "status": "ok"})
    kind = {"fixed_magnet": True, "moving_magnet": True, "fixed_iron": False, "moving_iron": False, "coil": False}
    entry = {"name": "pair", "mass_kg": 0.02, "gravity_m_s2": 0.0, "kind": kind | {"saturates": False}}
    return ff.fit_model(ff.SweepTable(rows, {"actuator": entry}), law="coenergy").model


def bench_csv(path, *, shift_m=0.0, passed_m=0.0):
    """Three runs over the distance, as somebody without a coil would write them."""
    run, d = np.repeat([1, 2, 3], 12), np.tile(np.linspace(0.5e-3, 18e-3, 12), 3)
    read = force(d + shift_m) + np.random.default_rng(5).normal(0.0, 2e-3, len(d))
    table = pd.DataFrame({"run": run, "distance_mm": 1e3 * (d - passed_m), "force_N": read})
    table.to_csv(path, index=False, float_format="%.5f")
    return path


SMALL = {"runs": 2, "distances": 8, "currents": 5, "rho": 0.0}
FORCE = {"noise": {"force_N": 4e-4}, "mount_m": 0.0, **SMALL}


def with_numbers(solenoid, **shares):
    """The solenoid with numbers of its drawing: what 1 mm of each, per place, has of a distance that is 1 mm longer."""

    def number(place, share):
        def change(d, i):
            return share(d) * 1e-3 * -0.5 * 5.0 * np.exp(-d / 0.01) * i**2

        spline = fitted_spline(change, np.linspace(0.0, 1.4, 8), 2)
        term = FieldTerm("change_mm", coenergy=CoenergySpline(DistanceCoordinate(REFERENCE_DISTANCE), spline))
        return DrawnEffect(f"fixed.regions.yoke.{place}", place, "mm", 5.0, 0.1, (term,))

    return replace(solenoid, drawn=tuple(number(place, share) for place, share in shares.items()))


def near(d):
    return 1.0 / (1.0 + np.exp((d - 0.022) / 0.004))


def found_shift(model):
    """What is found in readings of a stage that stands 0.3 mm off."""
    noise = {"force_N": 2e-4, "flux_linkage_Wb": 1e-5}
    table = campaign(model, 1, [hidden("distance_offset", offset_m=3e-4)], noise=noise, mount_m=2e-6, rho=0.0)
    return ff.diagnose(model, table)


@pytest.mark.parametrize("seed", [2, pytest.param(8, marks=pytest.mark.nightly)])
def test_of_equal_causes_the_one_with_fewer_parameters_stands_first_and_all_are_in_the_first_line(
    levitation_model, seed
):
    table = campaign(levitation_model, seed, [hidden("remanence", remanence_error=-0.04)], **FORCE)
    found = ff.diagnose(levitation_model, without(table, "coil_temperature_C", "magnet_temperature_C"))
    (named,) = found.missing
    assert named.name == named.tie[0] == "remanence"  # magnet_demagnetisation has two amplitudes
    assert "magnet_demagnetisation" in named.tie
    assert set(named.tie) <= set(named.members)
    assert len(named.tied_words) == len(named.tie) - 1
    # What stands in the first line is not said to be a further cause
    further = set(named.members) - set(named.tie)
    assert ("would give the same readings as well" in said_of(found, "certainty")) == bool(further)
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
    scale = hidden("distance_scale", scale_error=0.1)
    found = ff.diagnose(levitation_model, campaign(levitation_model, 1, [scale], **FORCE))
    (named,) = found.missing
    left = {one.name: one.error_left for one in found.ranking}
    assert left["magnet_demagnetisation"] > 3.0
    assert all(left[name] < 1.5 for name in named.tie)


FACE, CORNERS = "polygon_mm[3..4][1]", {"polygon_mm[3][1]": near, "polygon_mm[4][1]": lambda d: 1.0 - near(d)}


def test_a_face_that_moves_like_the_stage_leaves_nothing_certain(solenoid):
    found = found_shift(with_numbers(solenoid, **{FACE: np.ones_like}, **CORNERS))
    assert {"distance_offset", f"fixed.regions.yoke.{FACE}"} <= set(found.missing[0].members)
    assert not found.confident
    assert found.dimensions_suspected
    suspects = {one.name for one in found.ranking}
    assert {one for one in found.look_alikes if not one.startswith("a constant error of")} <= suspects


@pytest.mark.parametrize("corners", [{}, dict([next(iter(CORNERS.items()))]), CORNERS], ids=len)
def test_corners_of_other_shapes_do_not_take_certainty_away_and_whether_any_was_suspected_is_said(solenoid, corners):
    """Nor do two of them that no face moves together: each is a suspect by itself."""
    found = found_shift(with_numbers(solenoid, **corners))
    assert found.missing[0].tie == ("distance_offset",)
    assert found.confident
    assert found.dimensions_suspected is found.to_dict()["dimensions_suspected"] is bool(corners)


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


def test_a_spring_that_the_drawing_lacks_is_named_with_its_numbers(bare):
    found = ff.diagnose(bare, campaign(bare, 41, change=carrying(Spring(300.0, 0.5, 6e-3)), **SIZE))
    assert (found.verdict, [one.members for one in found.missing]) == ("named", [("spring",)])
    nominal, ci95 = nominal_of(bare), found.missing[0].ci95
    stiffness = np.array(ci95["stiffness"]) * nominal.stiffness_N_per_m
    preload = np.array(ci95["preload"]) * nominal.force_N  # at the largest distance
    assert stiffness[0] < 300.0 < stiffness[1] < 310.0
    assert preload[0] < 0.5 < preload[1] < 0.55
    assert found.lack_of_fit_after.p_value > 0.01


def test_a_drawn_spring_in_the_force_readings_is_no_further_spring():
    spring = Spring(300.0, 0.5, 6e-3)
    drawn = replace(solenoid(), motion=Mechanics(0.025, 0.0, springs=(spring,)))
    table = campaign(drawn, 43, change=carrying(spring), **SIZE)
    found = ff.diagnose(drawn, table)
    assert (found.verdict, found.missing[0].name) == ("named", "spring_in_force")
    assert found.missing[0].parameters["share"] == pytest.approx(1.0, abs=0.05)
    assert "drawn-spring" in {one.code for one in found.findings}
    with_it = with_effects(drawn, [hidden("spring_in_force", share=1.0)])
    for model, sound in ((with_it, table), (drawn, campaign(drawn, 43, **SIZE))):
        assert "drawn-spring" not in {one.code for one in ff.compare(model, sound).findings}


def test_a_stray_spring_beside_a_drawn_one_is_named_or_leaves_nothing_certain():
    """With the drawn one's free length it is a part of its force; with another one it is none."""
    drawn = replace(solenoid(), motion=Mechanics(0.025, 0.0, springs=(Spring(300.0, 0.0, 9e-3),)))
    for stray, name in ((Spring(60.0, 0.0, 9e-3), "spring_in_force"), (Spring(100.0, 0.8, 6e-3), "spring")):
        found = ff.diagnose(drawn, campaign(drawn, 43, change=carrying(stray), **SIZE))
        assert (found.verdict, [one.name for one in found.missing]) == ("named", [name])
        assert not found.confident or name == "spring"


@pytest.mark.nightly
def test_a_late_position_sensor_is_named_with_its_delay(model, loops):
    samples = loops[loops["run"] == 1.0]
    shifted = np.interp(samples["time_s"] - 2e-3, samples["time_s"], samples["distance_m"])
    found = ff.diagnose(model, recorded(samples.assign(distance_m=shifted)))
    assert (found.verdict, found.missing[0].name) == ("named", "position_delay")
    assert found.missing[0].parameters["delay_s"] == pytest.approx(2e-3, rel=0.1)


def test_a_flux_that_the_core_keeps_is_told_from_an_ammeters_zero_by_the_voltage():
    steel = replace(solenoid(), kind=ActuatorKind(False, False, True, True, True, False))
    table = campaign(
        steel, 44, [hidden("core_remanence", mmf=0.02)], **SIZE | {"noise": {"force_N": 0.02, "voltage_V": 0.02}}
    )
    found = ff.diagnose(steel, table)
    assert (found.verdict, [one.members for one in found.missing]) == ("named", [("core_remanence",)])
    bare = replace(steel, kind=replace(steel.kind, fixed_iron=False, moving_iron=False))
    assert "no iron" in why_untestable(effect_by_name("core_remanence"), bench_observations(bare, table))


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
    device = magnet_pair(passed_m)
    found = ff.diagnose(device, bench_csv(tmp_path / "shifted.csv", shift_m=0.1e-3, passed_m=passed_m))
    assert found.missing[0].name == "distance_offset"
    assert found.missing[0].parameters["offset_m"] == pytest.approx(0.1e-3, rel=0.2)
    assert ff.diagnose(device, bench_csv(tmp_path / "clean.csv", passed_m=passed_m)).verdict == "nothing_missing"


def test_only_effects_that_it_can_have_are_considered(pair, shifted_pair):
    observations = placed(pair, shifted_pair)
    reasons = {name: why_untestable(effect, observations) for name, effect in all_effects().items()}
    for why, names in (
        ("", {"remanence", "distance_offset", "force_gain", "magnet_temperature"}),
        ("no coil", {"turns", "resistance", "current_gain", "hysteresis", "driver_gain", "motional_emf"}),
        ("Hall element", {"hall_offset"}),
    ):
        assert all(why in reasons[name] if why else not reasons[name] for name in names), why


def test_a_circuit_asks_for_currents_and_is_asked_of_no_magnet_alone(pair, levitation_model, shifted_pair):
    with pytest.raises(TableError, match="current_A"):
        placed(levitation_model, shifted_pair)
    findings = audit_model(pair).findings
    assert "wrong" not in {one.severity for one in findings}
    assert "inductance" not in {one.code for one in findings}


def test_no_flux_linkage_is_suggested_where_there_is_no_winding(pair, tmp_path):
    little = bench_csv(tmp_path / "little.csv", shift_m=0.03e-3)  # more than mounts usually differ by
    assert len(ff.suggest(pair, little).explanations) > 1
    observations = placed(pair, little)
    at = Conditions(observations.nominal)
    read = predict_readings(pair, np.array([5e-3]), np.array([0.0]), at, channels=CHANNELS)
    measurements = possible_experiments(observations, tuple(read), list(all_effects().values()))
    assert any("once more, on a new mount" in one.text for one in measurements)
    assert not any("flux linkage" in one.text for one in measurements)


def test_a_body_that_is_let_go_shows_its_mass_over_its_force(pair, tmp_path):
    """Motion under the magnets' force and its weight, by another method, with a body that is 20 % heavier."""
    mass, step, falls = 1.2 * pair.motion.mass_kg, 1e-5, []
    for run, start in enumerate((15e-3, 12e-3, 9e-3), 1):
        d, v, places = start, 0.0, []
        while d > 1e-3:
            v += step * (pair.motion.gravity_m_s2 - float(force(d)) / mass)
            d += step * v
            places.append(d)
        falls.append(pd.DataFrame({"run": run, "time_s": step * np.arange(len(places)), "distance_m": places})[::10])
    rows = pd.concat(falls)
    rows["distance_m"] += np.random.default_rng(3).normal(0.0, 2e-6, len(rows))
    rows.to_csv(tmp_path / "falls.csv", index=False)
    found = ff.diagnose(pair, tmp_path / "falls.csv")
    assert {"mass_error", "remanence"} <= set(found.missing[0].members)  # a motion alone shows their ratio
