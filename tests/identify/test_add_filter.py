"""An added effect is judged by what it does to the filter on runs of a record that were left out."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import femfit as ff
from femfit.core.errors import TableError
from femfit.effects.catalogue import effect_by_name
from femfit.effects.conditions import Conditions
from femfit.effects.effect import AddedEffect
from femfit.identify.readings.bench import placed
from femfit.identify.refit.filter_fall import _unread, filter_fall, less_likely, lost_runs
from femfit.model.with_effects import nominal_of
from femfit.report.motion_figures import write_before_after
from support.closed_loop import closed_loop, recorded
from support.solenoids import solenoid
from support.switching import logged, switched

NOISE = {"distance_m": 3e-5, "current_A": 4e-3}


def added(name, **parameters):
    effect = effect_by_name(name)
    return AddedEffect(effect, effect.null() | parameters)


@pytest.fixture(scope="module")
def model(levitation_model):
    return replace(levitation_model, sample_time_s=1e-3)


@pytest.fixture(scope="module")
def clean(model):
    return recorded(closed_loop(model, runs=2, seconds=2.0, seed=3), runs=(1, 2), **NOISE)


def test_an_effect_that_is_there_makes_the_filter_on_a_run_left_out_what_it_claims(model):
    hidden = closed_loop(model, [added("coil_temperature", warmer_K=20.0)], runs=2, seconds=2.0, seed=4)
    record = recorded(hidden, runs=(1, 2), **NOISE)
    result = ff.add_effects(model, record, "coil_temperature", base="never")
    seen = result.filter
    assert seen.better
    assert result.accepted
    assert seen.mean_square[0] > 10.0
    assert seen.mean_square[1] == pytest.approx(1.0, abs=0.05)
    assert seen.unread["distance_m"].after < 0.3 * seen.unread["distance_m"].before
    assert "left out" in str(result).splitlines()[1]
    assert seen.samples == 3000  # of 4,000: what a long record costs is bounded, and said
    assert "3,000 samples of 2 runs" in str(seen)


def test_a_mean_square_that_moves_away_from_one_is_not_called_better(model):
    hidden = closed_loop(model, [added("coil_temperature", warmer_K=20.0)], runs=2, seconds=0.5, seed=4)
    record = recorded(hidden, runs=(1, 2), **NOISE)
    seen = ff.add_effects(model, record, "coil_temperature", base="never").filter
    likely = replace(seen, gain=1.0, gain_error=0.01, less_likely=False, unread={})
    for squares, better in (((1.0, 0.958), False), ((0.958, 1.0), True), ((1.3, 0.9), True), ((0.9, 1.3), False)):
        assert replace(likely, mean_square=squares).better is better, squares


def test_runs_in_which_a_filter_is_lost_are_counted_by_what_it_reads(model):
    record = recorded(closed_loop(model, runs=2, seconds=0.5, seed=4), runs=(1, 2), **NOISE)
    wrong = {k: (added("coil_temperature", warmer_K=100.0),) for k in (0, 1)}
    seen = filter_fall(model, model, (), record, placed(model, record), wrong)
    assert set(seen.lost) == {"", "distance_m"}
    for one in seen.lost.values():
        assert max(one.before, one.after) <= seen.runs == 2
    both = replace(seen, lost=dict.fromkeys(seen.lost, replace(seen.lost[""], before=2.0, after=1.0)))
    assert "with every sensor lost in 2 -> 1 of 2 runs; without distance_m lost in 2 -> 1 of 2 runs" in str(both)


def test_an_effect_that_is_not_there_is_not_called_better(model, clean):
    result = ff.add_effects(model, clean, "coil_temperature", base="never")
    assert not result.filter.better
    assert result.filter.mean_square[1] == pytest.approx(result.filter.mean_square[0], abs=0.01)


def test_an_effect_with_which_the_filter_goes_wrong_is_not_accepted(model, clean):
    """As an asymptote that the runs did not show: the winding 100 K warmer than it is."""
    wrong = {1: (added("coil_temperature", warmer_K=100.0),)}
    seen = filter_fall(model, model, (), clean, placed(model, clean), wrong)
    assert not seen.accepted
    assert seen.gain < 0.0
    assert str(seen).endswith("worse.")


def test_a_warming_that_only_begins_is_written_as_far_as_the_record_shows_it(model, clean):
    """100 K with a time constant of 60 s, of which runs of 2 s show 3.3 K: the filter runs with that and no end."""
    rows = clean.rows
    warm = 100.0 * -np.expm1(-rows["time_s"].to_numpy() / 60.0)
    drop = model.circuit.resistance_ohm * 3.93e-3 * warm * rows["current_A"].to_numpy()
    record = replace(clean, rows=rows.assign(voltage_V=rows["voltage_V"] + drop))
    result = ff.add_effects(model, record, "coil_temperature", base="never")
    at, one = replace(Conditions(nominal_of(model)), running=True), np.ones(1)
    (effect,) = result.model.effects
    growth = float(effect.effect.circuit(one, one, one, at, effect.parameters)[0][0]) - 1.0
    assert growth == pytest.approx(3.93e-3 * warm.max(), abs=0.007)  # of 39 % in the end
    assert result.filter.accepted
    assert result.filter.mean_square[1] <= result.filter.mean_square[0]


def test_compare_says_in_one_line_whether_the_filter_is_consistent(model, clean):
    comparison = ff.compare(model, clean)
    assert comparison.filter.trusted
    assert sum(line.startswith("Filter ukf: consistent") for line in str(comparison).splitlines()) == 1
    assert comparison.to_dict()["filter"]["trusted"]


def test_a_record_without_commands_has_no_filter_line(model, clean):
    silent = replace(
        clean,
        rows=clean.rows.assign(voltage_V=np.nan),
        given=tuple(name for name in clean.given if name != "voltage_V"),
    )
    assert ff.compare(model, silent).filter is None


def test_the_picture_before_and_after_is_of_filters_that_do_not_read_the_distance(tmp_path):
    device = solenoid()
    warm = replace(device, circuits=(replace(device.circuit, resistance_ohm=1.12 * device.circuit.resistance_ohm),))
    record = logged([switched([0.0, 0.01], [6.0, 9.0], 0.08, model=warm)])
    write_before_after((device, warm), record, tmp_path / "replay.png")
    assert (tmp_path / "replay.png").stat().st_size > 10_000
    silent = replace(record, given=tuple(name for name in record.given if name != "distance_m"))
    with pytest.raises(TableError, match="recorded distance"):
        write_before_after((device, warm), silent, tmp_path / "replay.png")


@pytest.mark.parametrize(
    ("newly", "regained", "worse"),
    [(1, 0, False), (3, 2, False), (4, 0, False), (5, 0, True), (9, 1, True), (0, 5, False)],
)
def test_one_more_run_lost_is_chance_and_many_are_not(newly, regained, worse):
    held, lost = SimpleNamespace(lost_at_s=None), SimpleNamespace(lost_at_s=0.1)
    pairs = [(held, lost)] * newly + [(lost, held)] * regained + [(held, held), (lost, lost)]
    assert lost_runs(pairs).worse is worse


def estimated(error_m):
    """A filter that did not read the distance and was off by this, its sign changing."""
    return SimpleNamespace(lost_at_s=None, unread={"distance_m": error_m * np.tile([1.0, -1.0], 200)})


def test_a_distance_that_both_filters_are_blind_to_is_not_compared():
    blind = estimated(np.nan)
    assert _unread([(blind, blind)], 2.3e-3) == {}


def test_filters_that_are_both_off_by_as_much_as_the_travel_decide_nothing():
    """A plate that was lost both times, 4.5 mm and 4.9 mm away in a travel of 8 mm."""
    unknowing = 8e-3 / np.sqrt(12.0)
    assert _unread([(estimated(4.5e-3), estimated(4.9e-3))], unknowing) == {}
    assert _unread([(estimated(0.1e-3), estimated(4.9e-3))], unknowing)["distance_m"].worse
    assert not _unread([(estimated(4.5e-3), estimated(0.1e-3))], unknowing)["distance_m"].worse


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
