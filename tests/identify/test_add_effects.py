"""Effects fitted to campaigns whose truth is known: their size, the error on runs left out, the base beside them."""

from dataclasses import replace

import numpy as np
import pytest

from femfit.core.errors import ModelFileError, TableError
from femfit.effects.catalogue import effect_by_name
from femfit.effects.conditions import Conditions
from femfit.effects.effect import AddedEffect
from femfit.effects.stages import changed_coenergy
from femfit.identify.noise.components import estimate_noise
from femfit.identify.noise.whitening import Whitening, chains_of
from femfit.identify.readings.observations import bench_observations
from femfit.identify.refit import add_effects as add
from femfit.identify.refit.add_effects import AddOptions, add_effects
from femfit.identify.refit.add_start import starting_point, without_untold
from femfit.identify.refit.add_text import add_lines
from femfit.identify.refit.refit import refit
from femfit.model.actuator_model import ValidityBox
from femfit.model.from_json import model_from_dict
from femfit.model.magnetics import Coefficient, LawMagnetics
from femfit.model.readings import predict_readings
from femfit.model.to_json import model_to_dict
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
        assert result.unseen_after[channel] == pytest.approx(sigma, rel=0.12)
        assert result.floor[channel] == pytest.approx(sigma, rel=0.12)
    assert result.unseen_ratio < 1.1
    assert result.unseen_before["hall_V"] > 3.0 * NOISE["hall_V"]
    assert result.gate_before.p_value < 1e-6
    assert result.gate_after.p_value > 0.01


def test_each_step_of_the_waterfall_lowers_the_channel_that_its_effect_changes(both):
    _, result = both
    names, steps = [step.text for step in result.steps], [step.unseen for step in result.steps]
    assert names == ["model", "core_saturation", "hall_offset"]
    assert steps[1]["flux_linkage_Wb"] < 0.5 * steps[0]["flux_linkage_Wb"]
    assert steps[2]["hall_V"] < 0.5 * steps[1]["hall_V"]
    assert steps[2] == result.unseen_after


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
    assert again.unseen_before["hall_V"] > 5.0 * again.unseen_after["hall_V"]


def test_an_effect_of_the_model_that_the_data_cannot_show_stays_as_it_is(levitation_model):
    table = campaign(levitation_model, 42, [HALL, SATURATION], runs=3)
    given = tuple(name for name in table.given if name not in CHANNELS or name == "flux_linkage_Wb")
    table = replace(table, rows=table.rows.assign(hall_V=np.nan, force_N=np.nan, voltage_V=np.nan), given=given)
    result = add_effects(with_effects(levitation_model, [HALL]), table, ["core_saturation"])
    assert result.kept == ("hall_offset",)
    assert {a.effect.name: dict(a.parameters) for a in result.model.effects}["hall_offset"] == {"offset_V": 0.02}
    assert any("hall_offset" in line for line in add_lines(result))


def test_a_magnet_two_per_cent_too_strong_is_the_bases_and_does_not_bend_the_effect(levitation_model):
    table = campaign(levitation_model, 43, [STRONG_MAGNET, HALL], runs=4)
    free = add_effects(levitation_model, table, ["hall_offset"])
    forbidden = add_effects(levitation_model, table, ["hall_offset"], AddOptions(base="never"))
    strength = next(added for added in free.base if added.effect is STRONG_MAGNET.effect)
    assert strength.parameters["remanence_error"] == pytest.approx(0.02, rel=0.15)
    assert abs(free.added[0].parameters["offset_V"] - 0.02) < 0.2 * abs(
        forbidden.added[0].parameters["offset_V"] - 0.02
    )
    assert free.unseen_ratio < 1.1 < forbidden.unseen_ratio
    assert forbidden.base == ()
    assert "base" in [step.text for step in free.steps]


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
    warm = add_effects(levitation_model, table, ["hall_offset"], AddOptions(coil_temperature_C=60.0))
    assert warm.model.coil_temperature_C == 60.0


def test_an_effect_that_is_not_there_is_called_suspicious(levitation_model):
    result = add_effects(levitation_model, campaign(levitation_model, 45), ["hall_offset"])
    low, high = result.added[0].ci95["offset_V"]
    assert low < 0.0 < high
    assert any("may be absent" in sentence for sentence in result.suspicious)


def test_an_implausible_size_is_called_suspicious(levitation_model):
    huge = effect("hall_offset", offset_V=0.8)
    result = add_effects(levitation_model, campaign(levitation_model, 46, [huge]), ["hall_offset"])
    assert any("hall_offset: offset_V" in sentence and "unusual" in sentence for sentence in result.suspicious)


def test_what_cannot_be_fitted_is_refused_with_the_remedy(levitation_model):
    table = campaign(levitation_model, 47)
    no_hall = replace(table, given=tuple(name for name in table.given if name != "hall_V"))
    with pytest.raises(TableError, match=r"hall_offset cannot be fitted.*lack hall_V"):
        add_effects(levitation_model, no_hall, ["hall_offset"])
    with pytest.raises(ModelFileError, match="must be one of"):
        add_effects(levitation_model, table, ["gremlins"])
    once = table.rows[(table.rows["branch"] > 0) & (table.rows["run"] == 1)].reset_index(drop=True)
    with pytest.raises(TableError, match="Measure some settings twice"):
        add_effects(levitation_model, replace(table, rows=once), ["hall_offset"])


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
    result = add_effects(steel_model, table, ["force_gain"], AddOptions(base="always"))
    assert {added.effect.name for added in result.base} == {"turns", "resistance"}
    assert "with force_gain" in "\n".join(add_lines(result))


def test_a_constant_that_nothing_depends_on_is_not_suspicious(steel_model):
    saturation = effect("core_saturation", mmf_loss_6=0.1)
    noise = {"force_N": 0.1, "flux_linkage_Wb": 5e-5, "voltage_V": 5e-3}
    table = campaign(steel_model, 45, [saturation], noise=noise, runs=4)
    result = add_effects(steel_model, table, ["core_saturation"], AddOptions(base="never"))
    assert not [sentence for sentence in result.suspicious if "magnet_share" in sentence]


def test_the_text_says_how_much_warmer_the_new_model_runs(levitation_model):
    def hot(readings, rows):
        return readings | {"voltage_V": (1.0 + 25 * 3.93e-3) * readings["voltage_V"]}

    table = campaign(levitation_model, 46, change=hot, runs=3)
    given = tuple(name for name in table.given if name != "coil_temperature_C")
    unread = replace(table, rows=table.rows.assign(coil_temperature_C=np.nan), given=given)
    result = add_effects(levitation_model, unread, ["coil_temperature"], AddOptions(base="never"))
    assert not result.suspicious
    assert any("with the coil at 20 C and the 25" in line for line in add_lines(result))


def test_an_amplitude_that_the_data_do_not_tell_is_left_out_with_its_constant(levitation_model):
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
    ((start, amplitude),) = without_untold(replace(fit, effects=(wide,)))
    assert [p.name for p in start.amplitudes] == ["warmer_K"]
    (again,) = refit(observations, whitening, [(start, amplitude)]).effects
    assert again.parameters["warmer_K"] == pytest.approx(25.0, abs=0.5)
    assert (again.parameters["warming_K"], again.parameters["warming_time"]) == (0.0, 100.0)


@pytest.mark.parametrize(("hall", "used"), [(1.0, True), (1.2, False)])
def test_the_base_is_not_used_where_a_channel_would_be_worse(monkeypatch, levitation_model, hall, used):
    table = campaign(levitation_model, 48, [STRONG_MAGNET, HALL], runs=3)
    fitted = add._fitted

    def worse(campaign_, start, prior=False):
        found = fitted(campaign_, start, prior)
        rms = dict(found.error.rms)
        rms["hall_V"] = (hall if prior else 1.0) * 3e-3
        return replace(found, error=replace(found.error, rms=rms))

    monkeypatch.setattr(add, "_fitted", worse)
    assert bool(add.add_effects(levitation_model, table, ["hall_offset"]).base) is used
