"""The virtual bench of ``femfit trial``: hidden errors, meters, sizes, and what is judged right."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from femfit.core.constants import MU_0
from femfit.device.parts import LinearMaterial, NonlinearMaterial, Region
from femfit.model.json_file import write_model
from femfit.tables.measurement_file import read_bench_table
from femfit.tables.sweep_table import read_sweep_table
from femfit.trial.campaigns import make_campaigns
from femfit.trial.counts import Share, counts, trial_lines
from femfit.trial.device import Conditions, Device
from femfit.trial.device import true_readings as read
from femfit.trial.drawing_variants import saturable_core
from femfit.trial.field_table import Fields, solve_drawings
from femfit.trial.hidden import HIDDEN_ERRORS, possible_errors
from femfit.trial.judge import judge
from femfit.trial.run import diagnose_campaigns
from femfit.trial.virtual_bench import Meter, make_campaign, measured
from support.actuators import assembly, rectangle
from support.closed_form_device import D, N, closed_form_device, conditions


@pytest.fixture(scope="module")
def device():
    return closed_form_device()


def true_readings(device, at, sizes):
    return read(device, at, sizes, HIDDEN_ERRORS)


def changed(device, name, size, **given):
    at = conditions(**given)
    with_it, without = true_readings(device, at, {name: size}), true_readings(device, at, {})
    return {channel: with_it[channel] - without[channel] for channel in without}


def test_a_weaker_magnet_attracts_the_core_less_by_twice_as_much(device):
    passive = device.drawn.at(D, np.zeros(N)).force
    np.testing.assert_allclose(changed(device, "remanence", -0.01, current=0.0)["force_N"] / passive, 0.99**2 - 1.0)


def test_two_percent_more_turns_are_two_percent_more_current_and_as_much_more_flux(device):
    more = true_readings(device, conditions(), {"turns": 0.02})
    drawn = true_readings(device, conditions(1.02), {})
    np.testing.assert_allclose(more["force_N"], drawn["force_N"], rtol=1e-9)
    np.testing.assert_allclose(more["flux_linkage_Wb"], 1.02 * drawn["flux_linkage_Wb"], rtol=1e-9)
    np.testing.assert_allclose(more["voltage_V"], drawn["voltage_V"], rtol=1e-9)


def test_a_wrong_zero_of_the_stage_moves_the_body(device):
    moved = true_readings(device, replace(conditions(), distance=D + 1e-4), {})
    for name, values in true_readings(device, conditions(), {"distance_offset": 1e-4}).items():
        np.testing.assert_allclose(values, moved[name])


def test_a_warm_winding_drops_more_voltage_and_a_warm_magnet_pulls_less(device):
    rise = changed(device, "coil_temperature", 1.0, coil_C=50.0)["voltage_V"]
    np.testing.assert_allclose(rise, device.actuator.coil.resistance_ohm * 30.0 * 3.93e-3)
    force = changed(device, "magnet_temperature", 1.0, current=0.0, magnet_C=50.0)["force_N"]
    share = force / device.drawn.at(D, np.zeros(N)).force
    assert np.all((share > -0.08) & (share < -0.06))  # 30 K of NdFeB: 3.6 % of the remanence, twice of the force


def test_no_error_of_no_size_changes_anything(device):
    for name in HIDDEN_ERRORS:
        for values in changed(device, name, 0.0, coil_C=40.0, magnet_C=35.0).values():
            assert np.abs(values).max() < 1e-12, name


def test_a_device_is_given_only_errors_that_it_can_have(device):
    bare = replace(device.actuator, fixed=(), sensors=())
    assert set(possible_errors(device.actuator)) == set(HIDDEN_ERRORS)
    assert set(HIDDEN_ERRORS) - set(possible_errors(bare)) == {"core_saturation", "hall_offset"}


def test_a_meter_scatters_and_correlates_as_it_says():
    meter, n = Meter(sigma=2e-3, rho=0.5, full_scale=1.0), 20000
    noise = measured(np.zeros(n), meter, np.zeros(n, dtype=int), np.random.default_rng(1))
    assert noise.std() == pytest.approx(2e-3, rel=0.05)  # 20,000 readings worth 12,000: 0.6 % standard error, steps 1 %
    assert np.corrcoef(noise[1:], noise[:-1])[0, 1] == pytest.approx(0.5, abs=0.03)
    np.testing.assert_allclose(noise / meter.step, np.round(noise / meter.step), atol=1e-9)


@pytest.mark.parametrize("name", HIDDEN_ERRORS)
def test_each_error_has_the_size_that_was_asked_for(device, name):
    campaign = make_campaign(device, {name: HIDDEN_ERRORS[name]}, 3.0, np.random.default_rng(7))
    assert max(campaign.over_noise[name].values()) == pytest.approx(3.0, rel=1e-2)
    assert abs(campaign.hidden[name]) <= HIDDEN_ERRORS[name].limit(device)
    pd.testing.assert_frame_equal(
        campaign.rows, make_campaign(device, {name: HIDDEN_ERRORS[name]}, 3.0, np.random.default_rng(7)).rows
    )


def test_no_errors_lead_out_of_the_solved_range(device):
    # Beyond its nodes the polynomial of a saturating actuator says nothing.
    for sign in (-1.0, 1.0):
        largest = max(device.actuator.sweep.currents_A)
        at = Conditions(*(np.array([x]) for x in (0.0, largest, 0.0, 20.0, 20.0, 0, 0.0)))
        for name in ("current_offset", "current_gain"):
            at = HIDDEN_ERRORS[name].setting(device, sign * HIDDEN_ERRORS[name].limit(device), at)
        assert abs(at.current[0]) <= 1.05 * largest
        near, far = (np.array([device.actuator.sweep.distances_m[k]]) for k in (0, -1))
        for distance in (near, far):
            moved = replace(at, distance=distance)
            for name in ("distance_scale", "distance_offset"):
                moved = HIDDEN_ERRORS[name].setting(device, sign * HIDDEN_ERRORS[name].limit(device), moved)
            assert device.drawn.distances[0] <= moved.distance[0] <= device.drawn.distances[1]


def test_a_campaign_on_the_model_itself_lacks_nothing(device, levitation_model, tmp_path):
    write_model(levitation_model, tmp_path / "model.json")

    class Itself:
        distances, currents = (0.015, 0.045), ()

        def at(self, d, i):
            magnetics = levitation_model.magnetics
            hall = (levitation_model.sensor.voltage(d, i) - 2.5) / 50.0
            return Fields(magnetics.state(d, i).force, magnetics.flux_linkage(d, i), hall)

    coil = replace(device.actuator.coil, resistance_ohm=levitation_model.circuit.resistance_ohm)
    own = Device(replace(device.actuator, coils=(coil,)), Itself(), {})
    campaign = make_campaign(own, {}, 0.0, np.random.default_rng(2))
    place = tmp_path / "campaigns" / "0001"
    place.mkdir(parents=True)
    campaign.rows.to_csv(place / "data.csv", index=False)
    (place / "hidden.json").write_text(json.dumps({"level": 0.0, "hidden": {}, "over_noise": {}}))
    (outcome,) = diagnose_campaigns(tmp_path, [1], workers=1)
    assert outcome.verdict == "nothing_missing"
    assert len(read_bench_table(place / "data.csv").rows) == len(campaign.rows)


def test_twenty_campaigns_hold_their_shares_and_go_round_the_errors(device, tmp_path):
    numbers = make_campaigns(device, tmp_path, 20, 1)
    keys = [json.loads((tmp_path / "campaigns" / f"{n:04d}" / "hidden.json").read_text()) for n in numbers]
    assert [sum(len(key["hidden"]) == count for key in keys) for count in (0, 1, 2)] == [6, 9, 5]
    assert len({name for key in keys for name in key["hidden"]}) == len(HIDDEN_ERRORS)


def said(*classes, channel="hall_V", confident=False):
    missing = [{"name": members[0], "class": list(members)} for members in classes]
    verdict = "named" if classes else "unexplained"
    return {"verdict": verdict, "missing": missing, "where": {"channel": channel}, "confident": confident}


KEY = {"level": 1.0, "hidden": {"hall_offset": 0.1}, "over_noise": {"hall_offset": {"hall_V": 1.0, "force_N": 0.0}}}


def test_the_truth_counts_wherever_it_stands_in_a_class():
    found = judge(1, KEY, said(("external_field", "hall_offset"), ("force_gain",)))
    assert (found.found, found.named_first, found.spurious) == ((True,), False, 1)
    assert found.right_channel
    assert not judge(1, KEY, said(channel="force_N")).right_channel


def test_what_was_called_certain_and_wrong_is_counted():
    wrong = said(("force_gain",), confident=True)
    lines = {(one.group, one.outcome): one.share for one in counts([judge(1, KEY, wrong, wrong)])}
    assert lines["One error hidden", "a wrong name was called certain"] == Share(1, 1)
    assert lines[
        "The same campaigns again, the cause taken out of the catalogue", "a wrong name was called certain"
    ] == Share(1, 1)
    assert any("hall_offset" in line and "0/1" in line for line in trial_lines([judge(1, KEY, wrong)]))


def told(*classes, certain=False, ranking=(), when=None):
    missing = [{"name": members[0], "class": list(members), "when": when} for members in classes]
    names = [{"name": name} for name in ranking]
    return said(confident=certain) | {"missing": missing, "ranking": names, "verdict": "named"}


def test_a_number_of_the_drawing_is_right_by_any_of_its_key_paths():
    name = "drawing:core.z_mm[1] (final)"
    key = KEY | {"hidden": {name: 0.1}, "right": {name: ["core.z_mm[1]", "coil.z_mm[0]"]}, "group": {name: "drawing"}}
    numbers = ("coil.z_mm[0]", "core.z_mm[0]")
    assert judge(1, key, told(numbers, ranking=numbers)).found == (True,)
    assert judge(1, key, told(("core.z_mm[0]",), ranking=numbers)).found == (False,)
    curve = key | {"right": {name: ["materials.steel.B_T"]}}
    assert judge(1, curve, told(("materials.steel.H_A_per_m",))).found == (True,)
    # A diagnosis whose suspects are not the drawing's numbers cannot be right: the cause is unseen
    without = judge(1, key, told(("remanence",), ranking=("remanence", "turns"), certain=True))
    assert (without.unknown, without.certain_and_wrong) == ((True,), True)
    lines = {(one.group, one.outcome): one.share for one in counts([without])}
    assert lines["A cause that the diagnosis has no name for, of 1 sigma", "a wrong name was called certain"] == Share(
        1, 1
    )


@pytest.mark.parametrize(
    ("when", "right"),
    [(None, None), ({"first_run": 4}, True), ({"first_run": 5}, False), ({"first_run": 3, "last_run": 4}, False)],
)
def test_the_runs_in_which_an_error_acts_are_right_within_one(when, right):
    key = KEY | {"when": {"hall_offset": [3, 6]}, "runs": 6}
    assert judge(1, key, told(("hall_offset",), when=when)).right_runs is right


def test_what_readings_cannot_show_is_counted_apart():
    key = KEY | {"shown": {"hall_offset": 12.0}}
    found = judge(1, key, told(("hall_offset",)))
    assert found.could_be_shown == (False,)
    assert {one.group for one in counts([found])} == {
        "One error hidden that the readings can hardly show",
        "All campaigns",
    }


def test_any_certain_name_of_a_clean_campaign_is_wrong():
    clean = KEY | {"level": 0.0, "hidden": {}, "over_noise": {}}
    assert judge(1, clean, told(("force_gain",), certain=True)).certain_and_wrong


def test_a_file_that_the_diagnosis_refuses_is_an_outcome(device, levitation_model, tmp_path):
    write_model(levitation_model, tmp_path / "model.json")
    place = tmp_path / "campaigns" / "0001"
    place.mkdir(parents=True)
    (place / "data.csv").write_text("current_A,distance_m,colour\n1.0,0.02,3\n")
    (place / "hidden.json").write_text(json.dumps({"level": 0.0, "hidden": {}, "over_noise": {}}))
    (outcome,) = diagnose_campaigns(tmp_path, [1], workers=1)
    assert (outcome.verdict, outcome.classes) == ("refused", ())
    lines = {(one.group, one.outcome): one.share for one in counts([outcome])}
    assert lines["Nothing hidden", "no verdict was given"] == Share(1, 1)


def test_intervals_are_the_exact_ones():
    # Clopper and Pearson: no hit in n leaves 1 - 0.025^(1/n)
    assert Share(0, 100).ci95 == pytest.approx((0.0, 1.0 - 0.025 ** (1.0 / 100.0)))
    assert Share(100, 100).ci95[1] == 1.0
    assert Share(5, 50).ci95 == pytest.approx((0.0333, 0.2181), abs=1e-4)  # as printed in tables


def test_a_saturating_part_keeps_its_drawn_permeability_in_small_fields(device):
    drawn = next(part.material for part in device.actuator.fixed if part.material.relative_permeability > 10.0)
    saturable = saturable_core(device.actuator, 0.45, 1.0)
    curve = next(part.material for part in saturable.fixed if isinstance(part.material, NonlinearMaterial))
    assert curve.relative_permeability == pytest.approx(drawn.relative_permeability, rel=0.03)
    slope = (curve.flux_density_T[-1] - curve.flux_density_T[-2]) / (curve.field_A_per_m[-1] - curve.field_A_per_m[-2])
    assert slope < 2.0 * MU_0 * drawn.relative_permeability / 100.0


def test_a_table_is_the_sweep_of_its_drawing_at_the_nodes_and_is_linear_in_the_current(monkeypatch, tmp_path):
    monkeypatch.setattr("femfit.trial.field_table.LINEAR_DISTANCES", 3)
    disc = [Region("disc", rectangle(0.0, 0.01, 0.0, 0.005), LinearMaterial("magnet", 1.05, -1.2))]
    drawing = assembly(moving=disc, distances=(0.01, 0.03), coil=rectangle(0.008, 0.012, -0.01, -0.002), turns=100)
    tables = solve_drawings({"drawn": drawing}, tmp_path, workers=1)
    rows = read_sweep_table(tmp_path).rows
    assert len(rows) == 9
    at = tables["drawn"].at(rows["distance_m"].to_numpy(), rows["current_A"].to_numpy())
    np.testing.assert_allclose(at.force, rows["force_N"], rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(at.flux_linkage, rows["flux_linkage_Wb"], rtol=1e-9)
