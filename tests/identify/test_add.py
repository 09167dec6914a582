"""Effects fitted to campaigns and records whose truth is known: sizes, the error and the filter on runs left out."""

from dataclasses import replace

import numpy as np
import pytest

import femfit as ff
from femfit.core.errors import TableError, UsageError
from femfit.effects.catalogue import effect_by_name
from femfit.effects.conditions import Conditions
from femfit.effects.effect import EffectPoint
from femfit.identify.add_effects import _unidentified
from femfit.identify.bench import bench_observations
from femfit.identify.noise.components import estimate_noise
from femfit.identify.noise.whitening import Whitening
from femfit.identify.refit import refit, starting_point
from femfit.model.with_effects import nominal_of, with_effects
from femfit.report.motion_figures import write_before_after
from support.campaign import LARGE, NOISE, OF_POT, campaign, hidden, rising, without
from support.closed_loop import closed_loop, recorded
from support.solenoids import solenoid
from support.switching import logged, switched

SATURATION = hidden("core_saturation", mmf_loss_3=0.02)
HALL = hidden("hall_offset", offset_V=0.02)


@pytest.fixture(scope="module")
def both(levitation_model):
    """Saturation and a Hall offset, added in this order to four runs that show both."""
    table = campaign(levitation_model, 41, [SATURATION, HALL], runs=4)
    return table, ff.add_effects(levitation_model, table, ["core_saturation", "hall_offset"])


def test_the_error_falls_to_the_noise_floor_on_runs_left_out_and_intervals_hold_the_truth(both):
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
    offset = next(added for added in result.added if added.effect is HALL.effect)
    low, high = offset.ci95["offset_V"]
    # Three times the half width: 99.99997 %
    assert abs(offset.parameters["offset_V"] - 0.02) < 1.5 * (high - low)
    assert high - low < 0.005


def test_adding_an_effect_again_refits_it(both, levitation_model):
    table, first = both
    wrong = with_effects(levitation_model, [SATURATION, hidden("hall_offset", offset_V=-0.05)])
    again = ff.add_effects(wrong, table, ["hall_offset"])
    assert [added.effect.name for added in again.model.effects] == ["core_saturation", "hall_offset"]
    assert again.added[1].parameters["offset_V"] == pytest.approx(first.added[1].parameters["offset_V"], rel=0.01)
    (fall,) = [one for one in again.fall.channels if one.channel == "hall_V"]
    assert fall.rms_before > 5.0 * fall.rms_after


def test_an_effect_of_the_model_that_the_data_cannot_show_stays_as_it_is(levitation_model):
    table = without(campaign(levitation_model, 42, [HALL, SATURATION]), "hall_V", "force_N", "voltage_V")
    result = ff.add_effects(with_effects(levitation_model, [HALL]), table, ["core_saturation"])
    assert result.kept == ("hall_offset",)
    assert {a.effect.name: dict(a.parameters) for a in result.model.effects}["hall_offset"] == {"offset_V": 0.02}


def test_the_model_runs_at_the_recorded_temperatures_unless_told_otherwise(both, levitation_model):
    table, result = both
    assert result.model.coil_temperature_C == pytest.approx(table.rows["coil_temperature_C"].mean(), abs=0.1)
    warm = ff.add_effects(levitation_model, table, ["hall_offset"], coil_temperature_C=60.0)
    assert warm.model.coil_temperature_C == 60.0


def test_what_cannot_be_fitted_is_refused_with_the_remedy(levitation_model):
    table = campaign(levitation_model, 47)
    once = replace(table, rows=table.rows[table.rows["run"] == 1])
    for data, effect, error, words in (
        (without(table, "hall_V"), "hall_offset", TableError, "hall_V"),
        (table, "gremlins", UsageError, r"^Effect must be one of .*gremlins"),
        (table, "remanense", UsageError, r"^Did you mean remanence\? Effect must be one of"),
        (rising(once, every=3), "hall_offset", TableError, "twice"),  # no neighbours on a line to guess the noise from
    ):
        with pytest.raises(error, match=words):
            ff.add_effects(levitation_model, data, [effect])


def test_a_constant_that_nothing_depends_on_is_not_suspicious(strong_pot):
    table = campaign(strong_pot, 45, [hidden("core_saturation", mmf_loss_6=0.1)], noise=OF_POT, runs=4)
    law = strong_pot.magnetics  # and one on which the fit of a sweep, to rounding, depends
    swept = replace(law, coefficients=(*law.coefficients, replace(law.coefficients[0], current_power=1, value=1e-18)))
    result = ff.add_effects(replace(strong_pot, magnetics=swept), table, ["core_saturation"])
    assert not [sentence for sentence in result.suspicious if "magnet" in sentence]


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


def warming(levitation_model, seed, final_K, time):
    """A campaign whose coil warms without a thermometer; ``time`` is counted in readings."""

    def change(readings, rows):
        hot = final_K * -np.expm1(-(1.0 + rows["order"].to_numpy()) / time)
        return readings | {"voltage_V": (1.0 + 3.93e-3 * hot) * readings["voltage_V"]}

    return without(campaign(levitation_model, seed, change=change, **LARGE), "coil_temperature_C")


@pytest.mark.parametrize(
    ("final_K", "time", "shown", "settled"),
    [(100.0, 1700.0, 100.0 * -np.expm1(-139.0 / 1700.0), False), (25.0, 30.0, 25.0, True)],
)
def test_a_warming_is_written_to_its_end_or_as_far_as_it_was_seen(levitation_model, final_K, time, shown, settled):
    """A twelfth of a time constant of a warming by 100 K: the readings show 8 K, and no end."""
    result = ff.add_effects(levitation_model, warming(levitation_model, 49, final_K, time), ["coil_temperature"])
    assert ("not-settled" not in {one.code for one in result.findings}) is settled
    # The winding's resistance as plant and filters have it, over that without effects
    at, one, added = replace(Conditions(nominal_of(result.model)), running=True), np.ones(1), result.added[0]
    resistance, _ = added.effect.circuit(one, 0.0 * one, EffectPoint(one, one, at, added.parameters))
    assert resistance == pytest.approx(1.0 + 3.93e-3 * shown, abs=0.01)
    (fall,) = [one for one in result.fall.channels if one.channel == "voltage_V"]
    assert fall.after_over_noise < 2.0  # a warming that only begins is nearly a straight line


@pytest.mark.parametrize("offset_V", [0.0, 0.8], ids=["absent", "implausible"])
def test_an_effect_that_is_absent_or_too_large_is_called_suspicious(levitation_model, offset_V):
    table = campaign(levitation_model, 45, [hidden("hall_offset", offset_V=offset_V)])
    result = ff.add_effects(levitation_model, table, ["hall_offset"])
    low, high = result.added[0].ci95["offset_V"]
    assert (low < 0.0 < high) is (offset_V == 0.0)
    assert any("hall_offset" in sentence for sentence in result.suspicious)


@pytest.mark.parametrize(
    ("before", "after", "accepted"), [(0.68, 11.2, False), (11.2, 0.9, True), (1.3, 0.5, True), (1.3, None, False)]
)
def test_an_effect_with_which_the_filter_is_lost_is_not_accepted(both, before, after, accepted):
    result = replace(both[1], filter={"mean_square": {"before": before, "after": after}})
    assert result.accepted is accepted


@pytest.mark.nightly
def test_an_effect_that_is_there_makes_the_filter_what_it_claims(model):
    loop = closed_loop(model, [hidden("coil_temperature", warmer_K=20.0)], runs=2, seconds=2.0, seed=4)
    record = recorded(loop, runs=(1, 2), distance_m=3e-5, current_A=4e-3)
    result = ff.add_effects(model, record, "coil_temperature")
    assert result.accepted
    assert result.filter["mean_square"]["before"] > 4.0
    assert result.filter["mean_square"]["after"] == pytest.approx(1.0, abs=0.05)


def test_the_picture_before_and_after_is_of_filters_that_do_not_read_the_distance(tmp_path):
    device = solenoid()
    warm = replace(device, circuits=(replace(device.circuit, resistance_ohm=1.12 * device.circuit.resistance_ohm),))
    record = logged([switched([0.0, 0.01], [6.0, 9.0], 0.08, model=warm)])
    write_before_after((device, warm), record, tmp_path / "replay.png")
    assert (tmp_path / "replay.png").stat().st_size > 10_000
    with pytest.raises(TableError, match="distance"):
        write_before_after((device, warm), without(record, "distance_m"), tmp_path / "replay.png")
