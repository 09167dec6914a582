"""Effects fitted to campaigns and records whose truth is known: sizes, the error and the filter on runs left out."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import femfit as ff
from femfit.core.errors import TableError, UsageError
from femfit.effects.catalogue import effect_by_name
from femfit.effects.conditions import Conditions
from femfit.effects.stages import changed_coenergy
from femfit.identify.add_effects import add_effects
from femfit.identify.bench import bench_observations, placed
from femfit.identify.decision.diagnose import diagnose
from femfit.identify.left_out import _unidentified, filter_fall, less_likely, unread_changes
from femfit.identify.noise.components import estimate_noise
from femfit.identify.noise.whitening import Whitening
from femfit.identify.refit import refit, starting_point
from femfit.model.readings import predict_readings
from femfit.model.with_effects import coenergy_of, nominal_of, with_effects
from femfit.report.motion_figures import write_before_after
from support.campaign import LARGE, NOISE, campaign, hidden, without
from support.closed_loop import closed_loop, recorded
from support.coenergies import partials
from support.solenoids import solenoid
from support.switching import logged, switched

SATURATION = hidden("core_saturation", mmf_loss_3=0.02)
HALL = hidden("hall_offset", offset_V=0.02)
OF_POT = {"force_N": 0.1, "flux_linkage_Wb": 5e-5, "voltage_V": 5e-3}


@pytest.fixture(scope="module")
def both(levitation_model):
    """Saturation and a Hall offset, added in this order to four runs that show both."""
    table = campaign(levitation_model, 41, [SATURATION, HALL], runs=4)
    return table, add_effects(levitation_model, table, ["core_saturation", "hall_offset"])


def test_the_error_falls_to_the_noise_floor_on_runs_left_out(both):
    _, result = both
    for channel, sigma in NOISE.items():
        # 560 readings a channel with correlation 0.3 know their rms to 4 %, the floor to as much
        assert result.floor[channel] == pytest.approx(sigma, rel=0.12)
    # A re-mount of 20 um, which no model can know, is in the error of a run left out
    for channel in ("hall_V", "voltage_V"):
        assert result.left_out[channel] == pytest.approx(NOISE[channel], rel=0.15)
    fall = {one.channel: one for one in result.fall.channels}
    assert fall["hall_V"].before_over_noise > 3.0
    assert fall["hall_V"].after_over_noise < 1.15
    assert result.lack_of_fit_before.p_value < 1e-6
    assert result.lack_of_fit_after.p_value > 0.01


def test_intervals_and_sizes_in_a_channel_hold_the_truth(both, levitation_model):
    _, result = both
    offset = next(added for added in result.added if added.effect is HALL.effect)
    low, high = offset.ci95["offset_V"]
    # Three times the half width: 99.99997 %
    assert abs(offset.parameters["offset_V"] - 0.02) < 1.5 * (high - low)
    assert high - low < 0.005
    size = next(s for s in result.sizes if (s.effect, s.channel) == ("core_saturation", "flux_linkage_Wb"))
    at = Conditions(nominal_of(levitation_model))
    here = np.array([size.distance_m]), np.array([size.current_A])
    truth = predict_readings(levitation_model, *here, at, [SATURATION])["flux_linkage_Wb"]
    truth -= predict_readings(levitation_model, *here, at)["flux_linkage_Wb"]
    low, high = size.ci95
    assert abs(size.change - truth[0]) < 1.5 * (high - low)
    assert size.change < 0.0
    assert high < 0.0


def test_adding_an_effect_again_refits_it(both, levitation_model):
    table, first = both
    wrong = with_effects(levitation_model, [SATURATION, hidden("hall_offset", offset_V=-0.05)])
    again = add_effects(wrong, table, ["hall_offset"])
    assert [added.effect.name for added in again.model.effects] == ["core_saturation", "hall_offset"]
    assert again.added[1].parameters["offset_V"] == pytest.approx(first.added[1].parameters["offset_V"], rel=0.01)
    (fall,) = [one for one in again.fall.channels if one.channel == "hall_V"]
    assert fall.rms_before > 5.0 * fall.rms_after


def test_an_effect_of_the_model_that_the_data_cannot_show_stays_as_it_is(levitation_model):
    table = campaign(levitation_model, 42, [HALL, SATURATION], runs=3)
    table = without(table, "hall_V", "force_N", "voltage_V")
    result = add_effects(with_effects(levitation_model, [HALL]), table, ["core_saturation"])
    assert result.kept == ("hall_offset",)
    assert {a.effect.name: dict(a.parameters) for a in result.model.effects}["hall_offset"] == {"offset_V": 0.02}


def test_the_base_amplitudes_scale_the_sources_of_a_linear_field(levitation_model):
    """Magnet and current both s times as strong: fields times s, forces and energies times s squared."""
    s, d, i = 1.02, np.array([0.017, 0.03, 0.04]), np.array([0.1, 0.7, 1.3])
    base = coenergy_of(levitation_model)
    at = Conditions(nominal_of(levitation_model))
    strong = changed_coenergy(base, [hidden("remanence", remanence_error=s - 1.0)], at)
    more = changed_coenergy(base, [hidden("turns", turns_error=s - 1.0)], at)
    for order, power in {(1, 0, 0): 2, (0, 1, 0): 1, (0, 0, 1): 1}.items():
        (found,), (plain,) = partials(strong, d, s * i, (order,)), partials(base, d, i, (order,))
        np.testing.assert_allclose(found, s**power * plain, rtol=1e-12)
    for order, power in {(1, 0, 0): 0, (0, 2, 0): 2}.items():
        (found,), (turned,) = partials(more, d, i, (order,)), partials(base, d, s * i, (order,))
        np.testing.assert_allclose(found, s**power * turned, rtol=1e-12)


def test_the_model_runs_at_the_recorded_temperatures_unless_told_otherwise(both, levitation_model):
    table, result = both
    assert result.model.coil_temperature_C == pytest.approx(table.rows["coil_temperature_C"].mean(), abs=0.1)
    warm = add_effects(levitation_model, table, ["hall_offset"], coil_temperature_C=60.0)
    assert warm.model.coil_temperature_C == 60.0


def test_what_cannot_be_fitted_is_refused_with_the_remedy(levitation_model):
    table = campaign(levitation_model, 47)
    no_hall = replace(table, given=tuple(name for name in table.given if name != "hall_V"))
    with pytest.raises(TableError, match="hall_V"):
        add_effects(levitation_model, no_hall, ["hall_offset"])
    with pytest.raises(UsageError, match="gremlins"):
        add_effects(levitation_model, table, ["gremlins"])
    once = table.rows[(table.rows["branch"] > 0) & (table.rows["run"] == 1)].reset_index(drop=True)
    scattered = once.iloc[:: len(once) // 12].reset_index(drop=True)  # no neighbours on a line to guess the noise from
    with pytest.raises(TableError, match="twice"):
        add_effects(levitation_model, replace(table, rows=scattered), ["hall_offset"])


def test_a_constant_that_nothing_depends_on_is_not_suspicious(strong_pot):
    table = campaign(strong_pot, 45, [hidden("core_saturation", mmf_loss_6=0.1)], noise=OF_POT, runs=4)
    result = add_effects(strong_pot, table, ["core_saturation"])
    assert not [sentence for sentence in result.suspicious if "magnet_share" in sentence]


def test_an_amplitude_that_the_data_do_not_identify_is_left_out_with_its_constant(levitation_model):
    observations = bench_observations(levitation_model, warming(levitation_model, 47, 25.0, 1e-9))
    whitening = Whitening(observations, estimate_noise(observations))
    fit = refit(whitening, starting_point(whitening, [effect_by_name("coil_temperature")]))
    (added,) = fit.effects
    wide = replace(added, ci95=dict(added.ci95) | {"warming_K": (-300.0, 200.0)})
    (held,) = _unidentified(observations, replace(fit, effects=(wide,)))
    assert held == {"warming_K": 0.0}
    (again,) = refit(whitening, [replace(fit.restart[0], held=held)]).effects
    assert again.parameters["warmer_K"] == pytest.approx(25.0, abs=0.5)
    assert (again.parameters["warming_K"], again.parameters["warming_time"]) == (0.0, 100.0)


def warming(levitation_model, seed, final_K, time, runs=3):
    """A campaign whose coil warms without a thermometer; ``time`` is counted in readings."""

    def change(readings, rows):
        hot = final_K * -np.expm1(-(1.0 + rows["order"].to_numpy()) / time)
        return readings | {"voltage_V": (1.0 + 3.93e-3 * hot) * readings["voltage_V"]}

    return without(campaign(levitation_model, seed, change=change, runs=runs, **LARGE), "coil_temperature_C")


def running_resistance(model):
    """Resistance of the winding as plant and filters have it, over that of the model without effects."""
    at = replace(Conditions(nominal_of(model)), running=True)
    one = np.ones(1)
    for added in model.effects:
        if added.effect.circuit is not None:
            return float(added.effect.circuit(one, 0.0 * one, one, at, added.parameters)[0][0])
    return 1.0


@pytest.mark.nightly
def test_the_diagnosis_or_a_file_can_be_given(levitation_model, tmp_path):
    table = campaign(levitation_model, 51, [HALL], distances=6, currents=5)
    table.rows.to_csv(tmp_path / "bench.csv", index=False)
    found = diagnose(levitation_model, tmp_path / "bench.csv")
    result = add_effects(levitation_model, str(tmp_path / "bench.csv"), found)
    assert [one.effect.name for one in result.added] == [one.name for one in found.missing]
    clean = diagnose(levitation_model, campaign(levitation_model, 52, distances=6, currents=5))
    with pytest.raises(TableError, match="no effect"):
        add_effects(levitation_model, table, clean)


@pytest.mark.parametrize(
    ("final_K", "time", "shown", "settled"),
    [(100.0, 1700.0, 100.0 * -np.expm1(-139.0 / 1700.0), False), (25.0, 30.0, 25.0, True)],
)
def test_a_warming_is_written_to_its_end_or_as_far_as_it_was_seen(levitation_model, final_K, time, shown, settled):
    """A twelfth of a time constant of a warming by 100 K: the readings show 8 K, and no end."""
    result = add_effects(levitation_model, warming(levitation_model, 49, final_K, time), ["coil_temperature"])
    assert ("not-settled" not in {one.code for one in result.findings}) is settled
    assert running_resistance(result.model) == pytest.approx(1.0 + 3.93e-3 * shown, abs=0.01)
    (fall,) = [one for one in result.fall.channels if one.channel == "voltage_V"]
    assert fall.after_over_noise < 2.0  # a warming that only begins is nearly a straight line


@pytest.mark.parametrize("offset_V", [0.0, 0.8], ids=["absent", "implausible"])
def test_an_effect_that_is_absent_or_too_large_is_called_suspicious(levitation_model, offset_V):
    table = campaign(levitation_model, 45, [hidden("hall_offset", offset_V=offset_V)])
    result = add_effects(levitation_model, table, ["hall_offset"])
    low, high = result.added[0].ci95["offset_V"]
    assert (low < 0.0 < high) is (offset_V == 0.0)
    assert any("hall_offset" in sentence for sentence in result.suspicious)


SENSORS = {"distance_m": 3e-5, "current_A": 4e-3}


@pytest.mark.nightly
def test_an_effect_that_is_there_makes_the_filter_on_a_run_left_out_what_it_claims(model):
    loop = closed_loop(model, [hidden("coil_temperature", warmer_K=20.0)], runs=2, seconds=2.0, seed=4)
    record = recorded(loop, runs=(1, 2), **SENSORS)
    result = ff.add_effects(model, record, "coil_temperature")
    seen = result.filter
    assert seen.better
    assert result.accepted
    assert seen.mean_square[0] > 10.0
    assert seen.mean_square[1] == pytest.approx(1.0, abs=0.05)
    assert seen.unread["distance_m"].after < 0.3 * seen.unread["distance_m"].before
    assert seen.samples == 3000  # of 4,000: what a long record costs is bounded, and said
    # A mean square that moves away from one is not called better
    likely = replace(seen, gain=1.0, gain_error=0.01, less_likely=False, unread={})
    for squares, better in (((1.0, 0.958), False), ((0.958, 1.0), True), ((1.3, 0.9), True), ((0.9, 1.3), False)):
        assert replace(likely, mean_square=squares).better is better, squares


@pytest.mark.nightly
def test_an_effect_with_which_the_filter_is_lost_is_not_accepted(model, clean_record):
    """As an asymptote that the runs did not show: the winding 100 K warmer than it is."""
    record = replace(clean_record, rows=clean_record.rows[clean_record.rows["time_s"] < 0.5].reset_index(drop=True))
    wrong = {k: (hidden("coil_temperature", warmer_K=100.0),) for k in (0, 1)}
    seen = filter_fall(model, model, (), record, placed(model, record), wrong)
    assert seen.runs == 2
    assert not seen.accepted
    assert seen.gain < 0.0


def test_the_picture_before_and_after_is_of_filters_that_do_not_read_the_distance(tmp_path):
    device = solenoid()
    warm = replace(device, circuits=(replace(device.circuit, resistance_ohm=1.12 * device.circuit.resistance_ohm),))
    record = logged([switched([0.0, 0.01], [6.0, 9.0], 0.08, model=warm)])
    write_before_after((device, warm), record, tmp_path / "replay.png")
    assert (tmp_path / "replay.png").stat().st_size > 10_000
    silent = replace(record, given=tuple(name for name in record.given if name != "distance_m"))
    with pytest.raises(TableError, match="distance"):
        write_before_after((device, warm), silent, tmp_path / "replay.png")


def test_filters_that_are_both_off_by_as_much_as_the_travel_decide_nothing():
    """A plate that was lost both times, 4.5 mm and 4.9 mm away in a travel of 8 mm."""

    def estimated(error_m):
        return SimpleNamespace(broke_down=False, unread={"distance_m": error_m * np.tile([1.0, -1.0], 200)})

    assert unread_changes([(estimated(np.nan), estimated(np.nan))], 2.3e-3) == {}  # both are blind to it
    unknowing = 8e-3 / np.sqrt(12.0)
    assert unread_changes([(estimated(4.5e-3), estimated(4.9e-3))], unknowing) == {}
    assert unread_changes([(estimated(0.1e-3), estimated(4.9e-3))], unknowing)["distance_m"].worse
    assert not unread_changes([(estimated(4.5e-3), estimated(0.1e-3))], unknowing)["distance_m"].worse


@pytest.mark.parametrize(
    ("blocks", "worse"),
    [
        ([0.06] * 20, False),
        ([-0.06] * 20, True),
        ([0.06] * 19 + [-50.0], False),  # lost for a moment in one of twenty blocks
        ([-0.06, 0.05] * 10, False),  # as often as not
        ([-0.06] * 19 + [50.0], False),
    ],
)
def test_innovations_that_are_less_likely_in_most_blocks_and_in_the_mean_count_against_an_effect(blocks, worse):
    assert less_likely(np.repeat(blocks, 100)) is worse
