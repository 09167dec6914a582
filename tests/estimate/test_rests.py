"""Records in need of care: rests, held bodies, lost rows, columns that contradict the model, clamped commands."""

from dataclasses import replace

import numpy as np
import pytest

import femfit as ff
from femfit.core.errors import TableError
from femfit.device.electrics import Drive
from femfit.device.mechanics import Spring, Stop
from femfit.estimate.record import on_grid, repeated
from femfit.estimate.record_checks import given_voltage, suspect_record
from femfit.estimate.rests import Track, find_rests
from femfit.simulation.plant import with_force_scale
from support.closed_loop import closed_loop, recorded
from support.one_current import within
from support.parts import free as without_stops
from support.parts import with_circuit, with_motion
from support.replays import STEP_S, changed, damped, logs, series
from support.solenoids import solenoid
from support.switching import CURRENT_A, DISTANCE_M, logged, switched


def rests_of(model, record, noise_m=DISTANCE_M):
    *columns, current = (record.rows[name].to_numpy() for name in ("time_s", "segment", "distance_m", "current_A"))
    return find_rests(model, Track(*columns, current[:, None], noise_m))


@pytest.fixture(scope="module")
def free():
    return switched([0.0, 0.02, 0.08], [0.0, 12.0, 0.0], 0.12)


@pytest.fixture(scope="module")
def blocked():
    return [switched([0.0, 0.02, 0.04], [0.0, 12.0, 4.0], 0.06, start_m=at, blocked=True) for at in (1.5e-3, 3e-3)]


def test_rests_on_both_stops_lie_where_the_simulated_body_rests(free):
    found = rests_of(solenoid(), logged([free]))
    assert {rest.place for rest in found.rests} == {"near", "far"}
    still = free.table["velocity_m_s"] == 0.0
    assert found.held[still].mean() > 0.85  # blocks at the ends are given away
    off = np.minimum(np.abs(free.table["distance_m"] - 0.2e-3), np.abs(free.table["distance_m"] - 4e-3))
    assert off[found.held].max() < 2.0 * DISTANCE_M  # bounces that noise hides
    assert not found.contact[(free.table["distance_m"] > 0.5e-3) & (free.table["distance_m"] < 3.5e-3)].any()


def test_the_samples_around_every_impact_are_contact_however_fast_the_body_is():
    elastic = with_motion(solenoid(), far_stop=Stop(4e-3, 0.9))
    loop = switched([0.0], [0.0], 0.06, model=elastic, start_m=1e-3)
    record = logged([loop])
    record = replace(record, rows=record.rows.iloc[::8].reset_index(drop=True))
    found, times = rests_of(solenoid(), record), record.rows["time_s"].to_numpy()
    hits = [event for event in loop.events if event.name == "hits_far" and abs(event.velocity_m_s) > 0.2]
    assert len(hits) == 2
    for event in hits:
        after = int(np.searchsorted(times, event.time_s))
        assert found.contact[after - 1 : after + 1].all(), event


def test_a_rest_ends_before_the_body_has_gone_as_far_as_the_noise(free):
    found = rests_of(solenoid(), logged([free]))
    starts = next(event.time_s for event in free.events if event.name == "starts")
    gone = 1e-4 * np.argmax(free.table["distance_m"] < 4e-3 - 2.0 * DISTANCE_M)
    assert starts - 1e-3 < 1e-4 * found.rests[0].last < gone


def test_a_blocked_body_away_from_stops_is_held_whatever_the_model_misses(blocked):
    for factor in (0.7, 1.0, 1.5):
        found = rests_of(with_force_scale(solenoid(), factor), logged(blocked))
        assert {rest.place for rest in found.rests} == {"held"}
        assert found.held.mean() > 0.9


def test_a_body_that_swings_on_its_spring_is_free():
    model = without_stops(solenoid())
    loop = switched([0.0], [0.0], 0.3, model, start_m=3.7e-3)
    assert not rests_of(with_motion(model, springs=(Spring(120.0, 0.1, 4e-3),)), logged([loop])).rests


@pytest.mark.nightly
def test_a_hover_is_free_though_the_model_misses_a_fifth_of_its_force(levitation_model):
    model = replace(levitation_model, sample_time_s=1e-3)
    record = recorded(closed_loop(model, runs=2, seconds=2.0, seed=3), distance_m=3e-5, current_A=4e-3)
    for factor in (0.8, 1.0, 1.25):
        assert not rests_of(with_force_scale(model, factor), record, 3e-5).rests


@pytest.mark.parametrize("with_blocked", [True, pytest.param(False, marks=pytest.mark.nightly)])
def test_compare_agrees_on_switching_with_and_without_blocked_runs(free, blocked, with_blocked):
    """A body that is balanced as free while it is held misses by hundreds of times the noise."""
    comparison = ff.compare(solenoid(), logged([free, *(blocked if with_blocked else ())]))
    assert comparison.verdict == "agrees", str(comparison)
    codes = {one.code for one in comparison.findings}
    assert "at-stop" in codes
    assert ("held" in codes) == with_blocked


def test_a_filter_does_not_let_a_held_body_fall(blocked):
    seen = ff.observe(solenoid(), logged(blocked), find=False)
    one = seen.filters[0]
    assert "is held" in str(seen).splitlines()[1]
    judged = {each.sensor: each.mean_square for each in one.innovations}
    assert judged == pytest.approx({"distance": 1.0, "current": 1.0}, abs=0.15)


def test_noise_of_the_sensors_alone_leaves_a_resting_body_at_rest():
    generator = np.random.default_rng(3)
    for _ in range(20):
        distance, current = generator.standard_normal((2, 4000)) * [[DISTANCE_M], [CURRENT_A]]
        (rest,) = rests_of(solenoid(), series(np.zeros(4000), current, 4e-3 + distance)).rests
        assert (rest.first, rest.last) == (0, 3999)


def test_commands_beyond_the_supply_are_taken_as_clamped_and_said():
    drawn = logged([switched([0.0, 0.01, 0.02, 0.05], [0.0, 24.0, 6.0, 24.0], 0.08)])
    volts = drawn.rows["voltage_V"]
    record = changed(drawn, voltage_V=volts.where(volts < 11.9, 24.0))
    comparison = ff.compare(solenoid(), record)
    assert comparison.verdict == "agrees", str(comparison)
    seen, as_drawn = (ff.observe(solenoid(), one, find=False) for one in (record, drawn))
    for said in (comparison, seen):
        assert "clamped" in {finding.code for finding in said.findings}
    size, right = (observed.filters[0].innovations[0].mean_square for observed in (seen, as_drawn))
    assert size == pytest.approx(right, rel=1e-6)
    assert any("supply" in line for line in str(seen).splitlines()[:4])


def test_the_diodes_drop_lasts_until_a_falling_current_has_come_to_its_end():
    model, noise_A = solenoid(drive=Drive(diode_V=0.7)), 3e-3
    time = 1e-4 * np.arange(400)
    falling = 0.1 - 8.0 * time
    current = np.where(falling > 0.0, falling + np.random.default_rng(1).normal(0.0, noise_A, 400), 0.0)
    track = Track(time, np.zeros(400, dtype=int), np.full(400, 6e-3), current[:, None], 1e-6, [noise_A])
    given, _, _ = given_voltage(model, track, np.zeros(400), 0)
    conducts = int((given == -0.7).sum())
    assert set(given) == {-0.7, 0.0}
    assert abs(conducts - 125) <= 3  # it would end 11 samples before, three standard deviations from zero


@pytest.fixture(scope="module")
def log():
    truth, (record,) = logs(2000, 1, seed=7)
    return truth[:, 0], record


def without(record, share, seed=1):
    kept = np.random.default_rng(seed).random(len(record.rows)) > share
    kept[[0, -1]] = True
    return replace(record, rows=record.rows[kept].reset_index(drop=True)), kept


def test_lost_rows_come_back_without_readings_and_with_the_command_between(log):
    record = log[1]
    short, kept = without(record, 0.05)
    full, added = on_grid(short)
    np.testing.assert_array_equal(added, ~kept)
    np.testing.assert_allclose(full.rows["time_s"], record.rows["time_s"], atol=1e-12)
    assert full.rows.loc[added, ["current_A", "distance_m"]].isna().all(axis=None)
    assert full.rows["voltage_V"].notna().all()
    assert {one.code for one in full.findings} == {"missing-rows"}


def test_a_grid_is_found_among_lost_rows_and_a_complete_record_and_gaps_of_segments_are_left(log):
    short, _ = without(log[1], 0.6)  # then the usual step is two of the grid
    assert len(on_grid(short).series.rows) == len(log[1].rows)
    count = len(log[1].rows)
    record = changed(log[1], time_s=log[1].rows["time_s"] + 0.1 * STEP_S * np.sin(np.arange(count)))
    same, added = on_grid(record)
    assert same.findings == record.findings
    assert not added.any()
    rows = log[1].rows.copy()
    rows.loc[1000:, ["time_s", "segment"]] += [7.3 * STEP_S, 1]
    assert not on_grid(replace(log[1], rows=rows)).added.any()
    steps = np.random.default_rng(3).uniform(0.5, 3.0, count) * STEP_S
    with pytest.raises(TableError, match="equal steps"):
        on_grid(changed(log[1], time_s=np.cumsum(steps)))


def test_a_filter_predicts_over_lost_rows_as_well_as_it_says(log):
    truth, record = log
    seen = ff.observe(damped(), without(record, 0.05)[0], find=False)
    one = seen.filters[0]
    error = (one.replayed.mean - truth)[300:] / one.replayed.deviation[300:]
    np.testing.assert_allclose(np.sqrt(np.mean(error**2, axis=0)), 1.0, atol=0.5)  # few independent errors
    assert one.innovations[0].mean_square == pytest.approx(1.0, rel=0.15)


def test_a_record_on_a_grid_keeps_its_segments_and_no_new_reading():
    values = np.array([1.0, 1.0, np.nan, 1.0, 2.0, 2.0, 2.0, 2.0])
    np.testing.assert_array_equal(repeated(values, np.array([0]), 4).astype(int), [0, 1, 0, 1, 0, 1, 1, 1])
    record = series(np.ones(40), np.ones(40), segment=np.repeat([0, 1], 20))
    rows = changed(record, time_s=record.rows["time_s"] + record.rows["segment"]).rows
    full = on_grid(replace(record, rows=rows.drop(index=[5, 30]).reset_index(drop=True))).series
    np.testing.assert_array_equal(full.rows["segment"], np.repeat([0, 1], 20))


@pytest.fixture(scope="module")
def record():
    return logs(600, 1, seed=3)[1][0]


def one_sided():
    return replace(with_circuit(damped(), voltage_min_V=0.0), validity=within(damped().validity, low=0.0))


def turned(record, name):
    return changed(record, **{name: -record.rows[name]})


def suspected(model, record):
    return [(one.code, one.column) for one in suspect_record(model, record)]


def test_commands_and_currents_of_the_other_polarity_are_named(record):
    assert suspected(one_sided(), record) == []
    assert suspected(damped(), record) == []  # of both signs
    assert suspected(damped(), turned(record, "current_A")) == [("suspected-sign", "voltage_V")]
    current = -record.rows["current_A"]
    missing = changed(record, current_A=current.where(current.index % 2 == 1))
    assert suspected(one_sided(), missing) == [("suspected-sign", "current_A")]
    for name in ("voltage_V", "current_A", "distance_m"):
        assert suspected(one_sided(), turned(record, name)) == [("suspected-sign", name)]
    first = ff.observe(one_sided(), turned(record, "distance_m"), find=False).findings[0]
    assert (first.code, first.column) == ("suspected-sign", "distance_m")


def test_swapped_columns_are_named_by_the_heat_and_a_noise_in_another_unit_by_its_size(record):
    swapped = changed(record, voltage_V=record.rows["current_A"], current_A=record.rows["voltage_V"])
    assert ("suspected-columns", "voltage_V") in suspected(damped(), swapped)
    for noise, codes in ((2e-3, []), (2.0, [("suspected-noise", "current_A")])):
        assert suspected(damped(), replace(record, declared_noise={"current_A": noise})) == codes


@pytest.mark.nightly
def test_a_comparison_of_a_record_says_first_which_columns_contradict_the_model(free):
    right = logged([free])
    for record in (turned(right, "current_A"), replace(right, declared_noise={"current_A": 5.0})):
        assert str(ff.compare(solenoid(), record)).startswith("Check first: ")
    assert not str(ff.compare(solenoid(), right)).startswith("Check first: ")


@pytest.mark.nightly
def test_a_record_of_which_most_lies_outside_of_the_validity_domain_is_warned_of(free):
    record = logged([free])
    rows = record.rows.copy()
    for part, severity in ((0.1, "info"), (0.6, "warning")):
        rows.loc[: int(part * len(rows)), "distance_m"] = 8e-3
        told = {told.code: told for told in ff.compare(solenoid(), replace(record, rows=rows)).findings}
        assert told["outside-domain"].severity == severity


@pytest.mark.parametrize(("factor", "words"), [(1e6, "too long"), (1e-6, "too short")])
def test_a_step_that_no_filter_can_take_is_refused_by_the_unit_of_time(record, factor, words):
    slow = changed(record, time_s=factor * record.rows["time_s"])
    with pytest.raises(TableError, match=f"1,000,000 times {words}"):
        ff.observe(damped(), slow)
