"""The virtual bench of ``femfit trial``: hidden errors, meters, sizes, and what is judged right."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from femfit.core.constants import MU_0
from femfit.device.load import read_actuator
from femfit.device.parts import LinearMaterial, Region
from femfit.model.json_file import write_model
from femfit.tables.measurement_file import read_bench_table
from femfit.tables.sweep_table import read_sweep_table
from femfit.trial import hidden
from femfit.trial.counts import Share, counts, trial_lines
from femfit.trial.field_table import Fields, FieldTable, solve_drawings
from femfit.trial.hidden import HIDDEN_ERRORS, Conditions, Device, possible_errors, true_readings
from femfit.trial.run import diagnose_campaigns, judge, make_campaigns
from femfit.trial.virtual_bench import Meter, make_campaign, measured
from support.actuators import assembly, rectangle

N = 5
D = np.array([0.0163, 0.0221, 0.0307, 0.0412, 0.0441])


@pytest.fixture(scope="module")
def device():
    """A magnet m^2 / d^4 before a coil, as tables in closed form: F = m^2 A + m t i B + t^2 i^2 C, and so on."""
    actuator = read_actuator(Path(__file__).parents[2] / "geometry" / "emaws-rig.toml")
    x = np.cos(np.pi * (np.arange(16) + 0.5) / 16)[::-1]
    low, high = 0.8 * actuator.sweep.distances_m[0], 1.06 * actuator.sweep.distances_m[-1]
    d = np.exp(0.5 * (np.log(low) + np.log(high)) + 0.5 * (np.log(high) - np.log(low)) * x)
    inverse = np.linalg.inv(np.polynomial.chebyshev.chebvander(x, 15))

    def table(magnet=1.0, turns=1.0, linear_part=1.0):
        decay, zero = np.exp(-d / 0.0166), np.zeros(16)
        force = [magnet**2 * 4.19e-9 / d**4, magnet * turns * 0.2925 * decay, zero + turns**2 * 6e-3 * decay]
        flux = [magnet * turns * 0.2925 * 0.0166 * decay, turns**2 * linear_part * (0.0162 + 2e-4 * decay), zero]
        hall = [magnet * 8.6e-8 / (d + 0.0015) ** 3, zero + 0.005 * turns, zero]
        return FieldTable((low, high), 1.47, np.array([inverse @ np.array(one).T for one in (force, flux, hall)]), True)

    forms = {"saturating": table(linear_part=0.9)}
    for sign, factor in (("-", 0.9), ("+", 1.1)):
        forms |= {f"remanence{sign}": table(magnet=factor), f"turns{sign}": table(turns=factor)}
    return Device(actuator, table(), forms)


def conditions(current=1.0, coil_C=20.0, magnet_C=20.0):
    flat = np.ones(N)
    return Conditions(D, current * flat, 10.0 * np.arange(N), coil_C * flat, magnet_C * flat)


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
    campaign = make_campaign(device, (name,), 3.0, np.random.default_rng(7))
    assert max(campaign.over_noise[name].values()) == pytest.approx(3.0, rel=1e-2)
    assert abs(campaign.hidden[name]) <= HIDDEN_ERRORS[name].limit(device)
    pd.testing.assert_frame_equal(campaign.rows, make_campaign(device, (name,), 3.0, np.random.default_rng(7)).rows)


def test_no_errors_lead_out_of_the_solved_range(device):
    # Beyond its nodes the polynomial of a saturating actuator says nothing.
    for sign in (-1.0, 1.0):
        at = Conditions(*(np.array([x]) for x in (0.0, max(device.actuator.sweep.currents_A), 0.0, 20.0, 20.0)))
        for name in ("current_offset", "current_gain"):
            at = HIDDEN_ERRORS[name].setting(device, sign * HIDDEN_ERRORS[name].limit(device), at)
        assert abs(at.current[0]) <= device.drawn.current
        near, far = (np.array([device.actuator.sweep.distances_m[k]]) for k in (0, -1))
        for distance in (near, far):
            moved = replace(at, distance=distance)
            for name in ("distance_scale", "distance_offset"):
                moved = HIDDEN_ERRORS[name].setting(device, sign * HIDDEN_ERRORS[name].limit(device), moved)
            assert device.drawn.distances[0] <= moved.distance[0] <= device.drawn.distances[1]


def test_a_campaign_on_the_model_itself_lacks_nothing(device, levitation_model, tmp_path):
    write_model(levitation_model, tmp_path / "model.json")

    class Itself:
        distances, current = (0.015, 0.045), 1.47

        def at(self, d, i):
            magnetics = levitation_model.magnetics
            hall = (levitation_model.sensor.voltage(d, i) - 2.5) / 50.0
            return Fields(magnetics.state(d, i).force, magnetics.flux_linkage(d, i), hall)

    coil = replace(device.actuator.coil, resistance_ohm=levitation_model.circuit.resistance_ohm)
    own = Device(replace(device.actuator, coils=(coil,)), Itself(), {})
    campaign = make_campaign(own, (), 0.0, np.random.default_rng(2))
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


def test_intervals_are_the_exact_ones():
    # Clopper and Pearson: no hit in n leaves 1 - 0.025^(1/n)
    assert Share(0, 100).ci95 == pytest.approx((0.0, 1.0 - 0.025 ** (1.0 / 100.0)))
    assert Share(100, 100).ci95[1] == 1.0
    assert Share(5, 50).ci95 == pytest.approx((0.0333, 0.2181), abs=1e-4)  # as printed in tables


def test_a_saturating_part_keeps_its_drawn_permeability_in_small_fields(device):
    drawn = next(part.material for part in device.actuator.fixed if part.material.relative_permeability > 10.0)
    curve = hidden._saturating(drawn)
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
