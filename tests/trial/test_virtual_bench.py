"""The virtual bench of ``femfit trial``: hidden errors, meters and sizes."""

import json
from dataclasses import replace

import numpy as np
import pytest

from femfit.core.errors import DomainError
from femfit.core.numerics import MU_0
from femfit.device.parts import LinearMaterial, NonlinearMaterial, Region
from femfit.tables.sweep_table import read_sweep_table
from femfit.trial.campaigns import make_campaigns
from femfit.trial.field_table import FieldTable, solve_drawings
from femfit.trial.field_table import true_readings as read
from femfit.trial.hidden import HIDDEN_ERRORS, possible_errors, saturable_core
from femfit.trial.virtual_bench import Meter, expected_fall, make_campaign, measured
from support.actuators import assembly, rectangle
from support.closed_form_device import D, N, closed_form_device, conditions


@pytest.fixture(scope="module")
def device():
    return closed_form_device()


def true_readings(device, settings, **sizes):
    return read(device, settings, sizes, HIDDEN_ERRORS)


def changed(device, name, size, **given):
    settings = conditions(**given)
    with_it, without = true_readings(device, settings, **{name: size}), true_readings(device, settings)
    return {channel: with_it[channel] - without[channel] for channel in without}


def test_a_weaker_magnet_attracts_the_core_less_by_twice_as_much(device):
    passive = device.drawn.at(D, np.zeros(N))[0]
    np.testing.assert_allclose(changed(device, "remanence", -0.01, current=0.0)["force_N"] / passive, 0.99**2 - 1.0)


def test_two_percent_more_turns_are_two_percent_more_current_and_as_much_more_flux(device):
    more, drawn = true_readings(device, conditions(), turns=0.02), true_readings(device, conditions(1.02))
    np.testing.assert_allclose(more["force_N"], drawn["force_N"], rtol=1e-9)
    np.testing.assert_allclose(more["flux_linkage_Wb"], 1.02 * drawn["flux_linkage_Wb"], rtol=1e-9)
    np.testing.assert_allclose(more["voltage_V"], drawn["voltage_V"], rtol=1e-9)


def test_a_wrong_zero_of_the_stage_moves_the_body(device):
    moved = true_readings(device, replace(conditions(), distance=D + 1e-4))
    for name, values in true_readings(device, conditions(), distance_offset=1e-4).items():
        np.testing.assert_allclose(values, moved[name])


def test_a_warm_winding_drops_more_voltage_and_a_warm_magnet_pulls_less(device):
    rise = changed(device, "coil_temperature", 1.0, coil_C=50.0)["voltage_V"]
    np.testing.assert_allclose(rise, device.actuator.coil.resistance_ohm * 30.0 * 3.93e-3)
    force = changed(device, "magnet_temperature", 1.0, current=0.0, magnet_C=50.0)["force_N"]
    share = force / device.drawn.at(D, np.zeros(N))[0]
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


def test_twenty_campaigns_hold_their_shares_and_go_round_the_errors(device, tmp_path):
    numbers, places = make_campaigns(device, tmp_path, 20, 1), tmp_path / "campaigns"
    keys = [json.loads((places / f"{n:04d}" / "hidden.json").read_text()) for n in numbers]
    assert [sum(len(key["hidden"]) == count for key in keys) for count in (0, 1, 2)] == [6, 9, 5]
    assert len({name for key in keys for name in key["hidden"]}) == len(HIDDEN_ERRORS)
    before = (places / "0002" / "data.csv").read_bytes()
    make_campaigns(device, tmp_path, 2, 1)
    assert (places / "0002" / "data.csv").read_bytes() == before


def test_a_saturating_part_keeps_its_drawn_permeability_in_small_fields(device):
    drawn = next(part.material for part in device.actuator.fixed if part.material.relative_permeability > 10.0)
    saturable = saturable_core(device.actuator, 0.45)
    curve = next(part.material for part in saturable.fixed if isinstance(part.material, NonlinearMaterial))
    assert curve.relative_permeability == pytest.approx(drawn.relative_permeability, rel=0.03)
    slope = (curve.flux_density_T[-1] - curve.flux_density_T[-2]) / (curve.field_A_per_m[-1] - curve.field_A_per_m[-2])
    assert slope < 2.0 * MU_0 * drawn.relative_permeability / 100.0


def test_a_table_is_the_sweep_of_its_drawing_where_it_is_solved(monkeypatch, tmp_path):
    """Linear iron at three currents; steel that saturates at those of the bench, beyond which it is refused."""
    for name, few in (("LINEAR_DISTANCES", 3), ("SATURATING_DISTANCES", 2), ("CURRENTS", 2)):
        monkeypatch.setattr(f"femfit.trial.field_table.{name}", few)
    h = np.array([0.0, 100.0, 400.0, 2000.0, 1e5])
    steel = NonlinearMaterial("steel", tuple((4e-7 * np.pi * h + 1.6 * np.tanh(h / 300.0)).tolist()), tuple(h.tolist()))
    magnet = LinearMaterial("magnet", 1.05, -1.2)
    for material, distances, turns in ((magnet, (0.01, 0.03), 100), (steel, (0.004, 0.01), 2000)):
        disc = [Region("disc", rectangle(0.0, 0.01, 0.0, 0.005), material)]
        coil = rectangle(0.008, 0.012, -0.01, -0.002)
        drawing = assembly(moving=disc, distances=distances, coil=coil, turns=turns)
        table = solve_drawings({"drawn": drawing}, tmp_path / material.name, workers=1)["drawn"]
        rows = read_sweep_table(tmp_path / material.name).rows
        d, i = rows["distance_m"].to_numpy(), rows["current_A"].to_numpy()
        force, flux, _ = table.at(d, i)
        np.testing.assert_allclose(force, rows["force_N"], rtol=1e-6, atol=1e-9)
        np.testing.assert_allclose(flux, rows["flux_linkage_Wb"], rtol=1e-9, atol=1e-12)
        assert len(rows) == (9 if material is magnet else 8)
    assert table.currents == pytest.approx((-0.05, 0.0, 1.0, 1.05))
    with pytest.raises(DomainError, match=r"-0.05 to 1.05 A"):
        table.at(d[:1], np.array([1.1]))


def test_a_table_through_zero_is_a_polynomial_in_the_distance():
    x = np.cos(np.pi * (np.arange(6) + 0.5) / 6)[::-1]
    d = -6e-3 + 4e-3 * x
    inverse = np.linalg.inv(np.polynomial.chebyshev.chebvander(x, 5))
    values = np.array([np.transpose([1e9 * d**3 + d * i for i in (-1.0, 0.0, 1.0)])] * 3)
    table = FieldTable((-10e-3, -2e-3), (-1.0, 0.0, 1.0), inverse @ values)
    settings = np.array([-9e-3, -3.3e-3])
    np.testing.assert_allclose(
        table.at(settings, np.array([2.0, -1.0]))[0], 1e9 * settings**3 + settings * [2.0, -1.0], rtol=1e-9
    )


def test_the_fall_is_that_of_the_whole_covariance():
    rng, n = np.random.default_rng(4), 12
    run, mount_m = np.repeat([0, 1], n // 2), 2e-5
    meters = {"force_N": Meter(0.02, 0.4, 1.0), "hall_V": Meter(0.01, 0.0, 5.0)}
    change, slope = ({name: rng.standard_normal(n) * scale for name in meters} for scale in (0.03, 800.0))
    read = {name: rng.random(n) > 0.2 for name in meters}
    blocks = [
        meter.sigma**2 * meter.rho ** np.abs(np.subtract.outer(np.arange(n), np.arange(n))) * (run[:, None] == run)
        + meter.step**2 / 12.0 * np.eye(n)
        for meter in meters.values()
    ]
    covariance = np.block([[blocks[0], np.zeros((n, n))], [np.zeros((n, n)), blocks[1]]])
    stacked, present, delta = (np.concatenate([by[name] for name in meters]) for by in (slope, read, change))
    both, delta = np.tile(run, 2), delta[present]
    covariance += mount_m**2 * np.outer(stacked, stacked) * (both[:, None] == both)
    expected = delta @ np.linalg.solve(covariance[np.ix_(present, present)], delta)
    assert expected_fall(change, slope, read, meters, run, mount_m) == pytest.approx(expected)
