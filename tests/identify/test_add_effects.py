"""Effects fitted to campaigns whose truth is known: their size, the error on runs left out, the base beside them."""

from dataclasses import replace

import numpy as np
import pytest

from femfit.core.errors import TableError, UsageError
from femfit.effects.catalogue import effect_by_name
from femfit.effects.conditions import Conditions
from femfit.effects.effect import AddedEffect
from femfit.effects.stages import changed_coenergy
from femfit.identify.decision.diagnose import diagnose
from femfit.identify.noise.components import estimate_noise
from femfit.identify.noise.whitening import Whitening, chains_of
from femfit.identify.readings.bench import bench_observations
from femfit.identify.refit import add_effects as add
from femfit.identify.refit import checked_refit as checked
from femfit.identify.refit.add_effects import add_effects
from femfit.identify.refit.add_result import EffectSize
from femfit.identify.refit.refit import refit, starting_point
from femfit.model.json_file import model_from_dict, model_to_dict
from femfit.model.magnetics import Coefficient, LawMagnetics
from femfit.model.readings import predict_readings
from femfit.model.validity import ValidityBox
from femfit.model.with_effects import base_coenergy, nominal_of, with_effects
from femfit.tables.measurement import CHANNELS
from support.campaign import NOISE, campaign


def effect(name, **values):
    found = effect_by_name(name)
    return AddedEffect(found, found.null() | values)


SATURATION = effect("core_saturation", mmf_loss_3=0.02)
HALL = effect("hall_offset", offset_V=0.02)
STRONG_MAGNET = effect("remanence", remanence_error=0.02)


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


def test_each_step_of_the_waterfall_lowers_the_channel_that_its_effect_changes(both):
    _, result = both
    names, steps = [step.text for step in result.steps], [step.rms for step in result.steps]
    assert names == ["model", "core_saturation", "hall_offset"]
    assert steps[1]["flux_linkage_Wb"] < 0.5 * steps[0]["flux_linkage_Wb"]
    assert steps[2]["hall_V"] < 0.5 * steps[1]["hall_V"]
    assert steps[0] == {one.channel: one.rms_before for one in result.fall.channels}
    assert steps[2] == {one.channel: one.rms_after for one in result.fall.channels}


def test_the_intervals_hold_the_truth(both):
    _, result = both
    offset = next(added for added in result.added if added.effect is HALL.effect)
    low, high = offset.ci95["offset_V"]
    # Three times the half width: 99.99997 %
    assert abs(offset.parameters["offset_V"] - 0.02) < 1.5 * (high - low)
    assert high - low < 0.005


def test_the_size_in_a_channel_is_what_the_effect_changes_there(both, levitation_model):
    _, result = both
    size = next(s for s in result.sizes if (s.effect, s.channel) == ("core_saturation", "flux_linkage_Wb"))
    at = Conditions(nominal_of(levitation_model))
    here = np.array([size.distance_m]), np.array([size.current_A])
    truth = predict_readings(levitation_model, *here, at, [SATURATION])["flux_linkage_Wb"]
    truth -= predict_readings(levitation_model, *here, at)["flux_linkage_Wb"]
    low, high = size.ci95
    assert abs(size.change - truth[0]) < 1.5 * (high - low)
    assert size.change < 0.0
    assert high < 0.0


def test_the_new_model_survives_its_file_and_predicts_what_was_measured(both, levitation_model):
    table, result = both
    model = model_from_dict(model_to_dict(result.model))
    assert [added.effect.name for added in model.effects] == ["core_saturation", "hall_offset"]
    rows = table.rows
    at = Conditions(nominal_of(model))
    read = predict_readings(model, rows["distance_m"].to_numpy(), rows["current_A"].to_numpy(), at)
    rms = {name: np.sqrt(np.mean((rows[name] - read[name]) ** 2)) for name in ("flux_linkage_Wb", "voltage_V")}
    assert rms["flux_linkage_Wb"] == pytest.approx(NOISE["flux_linkage_Wb"], rel=0.12)


def test_adding_an_effect_again_refits_it(both, levitation_model):
    table, first = both
    wrong = with_effects(levitation_model, [SATURATION, effect("hall_offset", offset_V=-0.05)])
    again = add_effects(wrong, table, ["hall_offset"])
    assert [added.effect.name for added in again.model.effects] == ["core_saturation", "hall_offset"]
    assert again.added[1].parameters["offset_V"] == pytest.approx(first.added[1].parameters["offset_V"], rel=0.01)
    (fall,) = [one for one in again.fall.channels if one.channel == "hall_V"]
    assert fall.rms_before > 5.0 * fall.rms_after


def test_an_effect_of_the_model_that_the_data_cannot_show_stays_as_it_is(levitation_model):
    table = campaign(levitation_model, 42, [HALL, SATURATION], runs=3)
    given = tuple(name for name in table.given if name not in CHANNELS or name == "flux_linkage_Wb")
    table = replace(table, rows=table.rows.assign(hall_V=np.nan, force_N=np.nan, voltage_V=np.nan), given=given)
    result = add_effects(with_effects(levitation_model, [HALL]), table, ["core_saturation"])
    assert result.kept == ("hall_offset",)
    assert {a.effect.name: dict(a.parameters) for a in result.model.effects}["hall_offset"] == {"offset_V": 0.02}
    assert "hall_offset" in str(result)


def test_a_magnet_two_per_cent_too_strong_is_the_bases_and_does_not_bend_the_effect(levitation_model):
    table = campaign(levitation_model, 43, [STRONG_MAGNET, HALL], runs=4)
    free = add_effects(levitation_model, table, ["hall_offset"])
    forbidden = add_effects(levitation_model, table, ["hall_offset"], base="never")
    strength = next(added for added in free.base if added.effect is STRONG_MAGNET.effect)
    assert strength.parameters["remanence_error"] == pytest.approx(0.02, rel=0.15)
    assert abs(free.added[0].parameters["offset_V"] - 0.02) < 0.2 * abs(
        forbidden.added[0].parameters["offset_V"] - 0.02
    )
    after = {one.channel: one.after_over_noise for one in free.fall.channels}
    assert after["hall_V"] < 1.15
    assert forbidden.base == ()
    assert free.steps[-1].text == "tolerances"


def test_the_base_is_left_alone_where_it_does_not_help(both):
    _, result = both
    assert result.base == ()


def test_the_base_amplitudes_scale_the_sources_of_a_linear_field(levitation_model):
    """Magnet and current both s times as strong: fields times s, forces and energies times s squared."""
    s, d, i = 1.02, np.array([0.017, 0.03, 0.04]), np.array([0.1, 0.7, 1.3])
    base = base_coenergy(levitation_model)
    at = Conditions(nominal_of(levitation_model))
    strong = changed_coenergy(base, [effect("remanence", remanence_error=s - 1.0)], at)(d, s * i, 1, 2)
    plain, turned = base(d, i, 1, 2), base(d, s * i, 1, 2)
    for order, power in {(1, 0, 0): 2, (0, 1, 0): 1, (0, 0, 1): 1}.items():
        np.testing.assert_allclose(strong.derivative(*order), s**power * plain.derivative(*order), rtol=1e-12)
    more = changed_coenergy(base, [effect("turns", turns_error=s - 1.0)], at)(d, i, 1, 2)
    for order, power in {(1, 0): 0, (0, 2): 2}.items():
        np.testing.assert_allclose(more.derivative(*order), s**power * turned.derivative(*order), rtol=1e-12)


def test_the_model_runs_at_the_recorded_temperatures_unless_told_otherwise(both, levitation_model):
    table, result = both
    assert result.model.coil_temperature_C == pytest.approx(table.rows["coil_temperature_C"].mean(), abs=0.1)
    warm = add_effects(levitation_model, table, ["hall_offset"], coil_temperature_C=60.0)
    assert warm.model.coil_temperature_C == 60.0


def test_an_effect_that_is_not_there_is_called_suspicious(levitation_model):
    result = add_effects(levitation_model, campaign(levitation_model, 45), ["hall_offset"])
    low, high = result.added[0].ci95["offset_V"]
    assert low < 0.0 < high
    assert any("may be absent" in sentence for sentence in result.suspicious)


def test_an_implausible_size_is_called_suspicious(levitation_model):
    huge = effect("hall_offset", offset_V=0.8)
    result = add_effects(levitation_model, campaign(levitation_model, 46, [huge]), ["hall_offset"])
    assert any("hall_offset" in sentence and "unusual" in sentence for sentence in result.suspicious)


def test_what_cannot_be_fitted_is_refused_with_the_remedy(levitation_model):
    table = campaign(levitation_model, 47)
    no_hall = replace(table, given=tuple(name for name in table.given if name != "hall_V"))
    with pytest.raises(TableError, match=r"hall_offset cannot be fitted.*lack hall_V"):
        add_effects(levitation_model, no_hall, ["hall_offset"])
    with pytest.raises(UsageError, match="must be one of"):
        add_effects(levitation_model, table, ["gremlins"])
    once = table.rows[(table.rows["branch"] > 0) & (table.rows["run"] == 1)].reset_index(drop=True)
    scattered = once.iloc[:: len(once) // 12].reset_index(drop=True)  # no neighbours on a line to guess the noise from
    with pytest.raises(TableError, match="Measure some settings twice"):
        add_effects(levitation_model, replace(table, rows=scattered), ["hall_offset"])


@pytest.fixture(scope="module")
def steel_model(levitation_model):
    """A pot and a plate without a magnet: F = 20 uN m^2/A^2 (i/d)^2 between 0.6 and 6 mm."""
    pot = LawMagnetics("F1e", (Coefficient("d^-2", 2, 2e-5, "N m^2 / A^2"),), {}, 0.03)
    box = ValidityBox(0.6e-3, 6e-3, 0.0, 2.0)
    return replace(levitation_model, magnetics=pot, validity=box, sensor=None)


def test_a_model_without_a_magnet_is_not_offered_a_stronger_one(steel_model):
    gain = effect("force_gain", gain_error=0.05)
    noise = {"force_N": 0.1, "flux_linkage_Wb": 5e-5, "voltage_V": 5e-3}
    table = campaign(steel_model, 44, [gain], noise=noise, runs=4)
    result = add_effects(steel_model, table, ["force_gain"], base="always")
    assert {added.effect.name for added in result.base} == {"turns", "resistance"}
    assert [step.text for step in result.steps] == ["model", "force_gain", "tolerances"]


def test_a_constant_that_nothing_depends_on_is_not_suspicious(steel_model):
    saturation = effect("core_saturation", mmf_loss_6=0.1)
    noise = {"force_N": 0.1, "flux_linkage_Wb": 5e-5, "voltage_V": 5e-3}
    table = campaign(steel_model, 45, [saturation], noise=noise, runs=4)
    result = add_effects(steel_model, table, ["core_saturation"], base="never")
    assert not [sentence for sentence in result.suspicious if "magnet_share" in sentence]


def test_the_text_says_how_much_warmer_the_new_model_runs(levitation_model):
    def hot(readings, rows):
        return readings | {"voltage_V": (1.0 + 25 * 3.93e-3) * readings["voltage_V"]}

    table = campaign(levitation_model, 46, change=hot, runs=3)
    given = tuple(name for name in table.given if name != "coil_temperature_C")
    unread = replace(table, rows=table.rows.assign(coil_temperature_C=np.nan), given=given)
    result = add_effects(levitation_model, unread, ["coil_temperature"], base="never")
    assert not result.suspicious
    assert "25" in next(line for line in str(result).split("\n") if line.startswith("Plant and filters"))


def test_an_amplitude_that_the_data_do_not_identify_is_left_out_with_its_constant(levitation_model):
    def hot(readings, rows):
        return readings | {"voltage_V": (1.0 + 25 * 3.93e-3) * readings["voltage_V"]}

    table = campaign(levitation_model, 47, change=hot, runs=3)
    given = tuple(name for name in table.given if name != "coil_temperature_C")
    unread = replace(table, rows=table.rows.assign(coil_temperature_C=np.nan), given=given)
    observations = bench_observations(levitation_model, unread)
    whitening = Whitening(observations, estimate_noise(observations), chains_of(observations))
    fit = refit(observations, whitening, starting_point(observations, whitening, [effect_by_name("coil_temperature")]))
    (added,) = fit.effects
    wide = replace(added, ci95=dict(added.ci95) | {"warming_K": (-300.0, 200.0)})
    (start,) = checked._identified(replace(fit, effects=(wide,)))
    assert [p.name for p in start.columns.amplitudes] == ["warmer_K"]
    (again,) = refit(observations, whitening, [start]).effects
    assert again.parameters["warmer_K"] == pytest.approx(25.0, abs=0.5)
    assert (again.parameters["warming_K"], again.parameters["warming_time"]) == (0.0, 100.0)


@pytest.mark.parametrize(("hall", "used"), [(1.0, True), (1.2, False)])
def test_the_base_is_not_used_where_a_channel_would_be_worse(monkeypatch, levitation_model, hall, used):
    table = campaign(levitation_model, 48, [STRONG_MAGNET, HALL], runs=3)
    fitted = checked.checked_refit

    def worse(whitening, start, prior_sd=None):
        found = fitted(whitening, start, prior_sd)
        rms = dict(found.error.rms_beside_random)
        rms["hall_V"] = (hall if prior_sd else 1.0) * 3e-3
        return replace(found, error=replace(found.error, rms_beside_random=rms))

    for module in (add, checked):
        monkeypatch.setattr(module, "checked_refit", worse)
    assert bool(add.add_effects(levitation_model, table, ["hall_offset"]).base) is used


def warming(levitation_model, seed, final_K, time, runs=3):
    """A campaign whose coil warms without a thermometer; ``time`` is counted in readings."""

    def change(readings, rows):
        hot = final_K * -np.expm1(-rows["order"].to_numpy() / time)
        return readings | {"voltage_V": (1.0 + 3.93e-3 * hot) * readings["voltage_V"]}

    table = campaign(levitation_model, seed, change=change, runs=runs)
    given = tuple(name for name in table.given if name != "coil_temperature_C")
    return replace(table, rows=table.rows.assign(coil_temperature_C=np.nan), given=given)


def running_resistance(model):
    """Resistance of the winding as plant and filters have it, over that of the model without effects."""
    at = replace(Conditions(nominal_of(model)), running=True)
    one = np.ones(1)
    for added in model.effects:
        if added.effect.circuit is not None:
            return float(added.effect.circuit(one, 0.0 * one, one, at, added.parameters)[0][0])
    return 1.0


def test_a_warming_whose_end_was_not_seen_is_written_as_far_as_it_was(levitation_model):
    """A twelfth of a time constant of a warming by 100 K: the readings show 8 K, and no end."""
    table = warming(levitation_model, 49, 100.0, 1700.0)
    result = add_effects(levitation_model, table, ["coil_temperature"], base="never")
    shown = 1.0 + 3.93e-3 * 100.0 * -np.expm1(-139.0 / 1700.0)
    assert "not-settled" in {one.code for one in result.findings}
    assert running_resistance(result.model) == pytest.approx(shown, abs=0.01)
    (fall,) = [one for one in result.fall.channels if one.channel == "voltage_V"]
    assert fall.after_over_noise < 2.0  # a warming that only begins is nearly a straight line


def test_a_warming_whose_end_was_seen_is_written_to_its_end(levitation_model):
    result = add_effects(
        levitation_model, warming(levitation_model, 49, 25.0, 30.0), ["coil_temperature"], base="never"
    )
    assert "not-settled" not in {one.code for one in result.findings}
    assert running_resistance(result.model) == pytest.approx(1.0 + 3.93e-3 * 25.0, abs=0.005)


def test_a_tolerance_that_changes_no_reading_is_dropped_and_said(levitation_model):
    """The file has a column of flux linkage, but no reading of it: the magnet's strength changes no voltage."""
    table = warming(levitation_model, 50, 25.0, 30.0)
    table = replace(table, rows=table.rows.assign(force_N=np.nan, flux_linkage_Wb=np.nan, hall_V=np.nan))
    result = add_effects(levitation_model, table, ["coil_temperature"])
    assert "tolerance-dropped" in {one.code for one in result.findings}
    assert running_resistance(result.model) == pytest.approx(1.0 + 3.93e-3 * 25.0, abs=0.01)


def test_the_diagnosis_or_a_file_can_be_given(levitation_model, tmp_path):
    table = campaign(levitation_model, 51, [HALL], distances=6, currents=5)
    table.rows.to_csv(tmp_path / "bench.csv", index=False)
    found = diagnose(levitation_model, tmp_path / "bench.csv", bootstrap=0)
    result = add_effects(levitation_model, str(tmp_path / "bench.csv"), found)
    assert [one.effect.name for one in result.added] == [one.name for one in found.missing]
    clean = diagnose(levitation_model, campaign(levitation_model, 52, distances=6, currents=5), bootstrap=0)
    with pytest.raises(TableError, match="names no effect"):
        add_effects(levitation_model, table, clean)


def test_a_tolerance_that_explains_more_than_the_effect_is_given_the_credit(levitation_model):
    """A winding with 3 % fewer turns must not be booked as a wrong ammeter because the turns were fitted beside it."""
    turns = AddedEffect(effect_by_name("turns"), {"turns_error": -0.03})
    table = campaign(levitation_model, 44, [turns], noise={"force_N": 4e-4, "flux_linkage_Wb": 2e-6})
    result = add_effects(levitation_model, table, "current_gain")
    assert "turns" in result.better_alone
    assert "turns" in str(result).split("\n")[0]
    assert not add_effects(levitation_model, table, "turns").better_alone


@pytest.mark.parametrize(("share", "said"), [(0.62, "62 % of its largest"), (-6.2, "6.2 times its largest")])
def test_a_change_beyond_the_largest_is_a_factor(share, said):
    assert said in str(EffectSize("spring", "force_N", share, (share, share), share, 1e-3, 0.5))
