"""Records in need of care: lost rows, columns that contradict the model, commands beyond the supply."""

from dataclasses import replace

import numpy as np
import pytest

import femfit as ff
from femfit.core.errors import TableError
from femfit.estimate.record import on_grid, repeated
from femfit.estimate.record_checks import given_voltage, require_possible_step, suspect_record
from femfit.estimate.rests import Track
from support.one_current import within
from support.replays import STEP_S, damped, logs, series
from support.solenoids import solenoid
from support.switching import logged, switched

COMMANDS = [0.0, 0.01, 0.02, 0.05], [0.0, 24.0, 6.0, 24.0]


def test_commands_beyond_the_supply_are_taken_as_clamped_and_said():
    loop = switched(*COMMANDS, 0.08, model=solenoid())
    record = logged([loop])
    commanded = record.rows["voltage_V"].to_numpy(copy=True)
    commanded[commanded >= 11.9] = 24.0
    record = replace(record, rows=record.rows.assign(voltage_V=commanded))
    comparison = ff.compare(solenoid(), record)
    assert comparison.verdict == "agrees", str(comparison)
    assert "clamped" in {finding.code for finding in comparison.findings}
    seen = ff.observe(solenoid(), record, find=False)
    assert "clamped" in {finding.code for finding in seen.findings}
    as_drawn = ff.observe(solenoid(), logged([loop]), find=False)
    size, right = (observed.filters[0].innovations[0].mean_square for observed in (seen, as_drawn))
    assert size == pytest.approx(right, rel=1e-6)
    assert any("supply" in line for line in str(seen).splitlines()[:4])


def test_the_diodes_drop_lasts_until_a_falling_current_has_come_to_its_end():
    model, noise_A = solenoid(), 3e-3
    model = replace(model, circuits=(replace(model.circuit, drive=replace(model.circuit.drive, diode_V=0.7)),))
    time = 1e-4 * np.arange(400)
    current = np.maximum(0.1 - 8.0 * time, 0.0)
    current[current > 0.0] += np.random.default_rng(1).normal(0.0, noise_A, int((current > 0.0).sum()))
    distance = np.full(400, model.validity.distance_max_m)
    track = Track(time, np.zeros(400, dtype=int), distance, current[:, None], 1e-6, [noise_A])
    given = given_voltage(model, track, np.zeros(400), 0).voltage_V
    conducts = int((given == -0.7).sum())
    assert set(given) == {-0.7, 0.0}
    assert abs(conducts - 125) <= 3  # it would end 11 samples before, three standard deviations from zero


@pytest.fixture(scope="module")
def log():
    truth, records = logs(2000, 1, seed=7)
    return truth[:, 0], records[0]


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
    jitter = 0.1 * STEP_S * np.sin(np.arange(len(log[1].rows)))
    record = replace(log[1], rows=log[1].rows.assign(time_s=log[1].rows["time_s"] + jitter))
    same, added = on_grid(record)
    assert same.findings == record.findings
    assert not added.any()
    rows = log[1].rows.copy()
    rows.loc[1000:, ["time_s", "segment"]] += [7.3 * STEP_S, 1]
    assert not on_grid(replace(log[1], rows=rows)).added.any()
    steps = np.random.default_rng(3).uniform(0.5, 3.0, len(log[1].rows)) * STEP_S
    with pytest.raises(TableError, match="equal steps"):
        on_grid(replace(log[1], rows=log[1].rows.assign(time_s=np.cumsum(steps))))


def test_a_filter_predicts_over_lost_rows_as_well_as_it_says(log):
    truth, record = log
    seen = ff.observe(damped(), without(record, 0.05)[0], find=False)
    one = seen.filters[0]
    error = (one.replayed.mean - truth)[300:] / one.replayed.deviation[300:]
    np.testing.assert_allclose(np.sqrt(np.mean(error**2, axis=0)), 1.0, atol=0.5)  # few independent errors
    assert one.innovations[0].mean_square == pytest.approx(1.0, rel=0.15)


def test_a_record_on_a_grid_keeps_its_segments_its_clipped_samples_and_no_new_reading(log):
    values = np.array([1.0, 1.0, np.nan, 1.0, 2.0, 2.0, 2.0, 2.0])
    np.testing.assert_array_equal(repeated(values, np.array([0]), 4).astype(int), [0, 1, 0, 1, 0, 1, 1, 1])
    short, kept = without(log[1], 0.05)
    levels = np.where(np.arange(len(short.rows)) == 50, 9.0, np.nan)
    full = on_grid(replace(short, clipped={"current_A": levels})).series
    assert np.flatnonzero(np.isfinite(full.clipped["current_A"])) == np.flatnonzero(kept)[50]
    record = series(np.ones(40), np.ones(40), segment=np.repeat([0, 1], 20))
    rows = record.rows.assign(time_s=record.rows["time_s"] + record.rows["segment"])
    full = on_grid(replace(record, rows=rows.drop(index=[5, 30]).reset_index(drop=True))).series
    np.testing.assert_array_equal(full.rows["segment"], np.repeat([0, 1], 20))


@pytest.fixture(scope="module")
def record():
    return logs(600, 1, seed=3)[1][0]


def one_sided():
    model = damped()
    limits = {"voltage_min_V": 0.0, "voltage_max_V": 12.0}
    return replace(model, circuits=(replace(model.circuits[0], **limits),), validity=within(model.validity, low=0.0))


def turned(record, *names):
    return replace(record, rows=record.rows.assign(**{name: -record.rows[name] for name in names}))


def suspected(model, record):
    return [(one.code, one.column) for one in suspect_record(model, record)]


def test_commands_and_currents_of_the_other_polarity_are_named(record):
    assert suspected(one_sided(), record) == []
    assert suspected(damped(), record) == []
    found = suspect_record(one_sided(), turned(record, "voltage_V"))
    assert [(one.code, one.column) for one in found] == [("suspected-sign", "voltage_V")]
    assert "supply" in found[0].text
    model = damped()
    limits = {"voltage_min_V": -12.0, "voltage_max_V": 12.0}
    most = model.validity.current_max_A
    both = replace(model, circuits=(replace(model.circuits[0], **limits),), validity=within(model.validity, low=-most))
    assert suspected(both, record) == []
    assert suspected(both, turned(record, "current_A")) == [("suspected-sign", "voltage_V")]
    rows = turned(record, "current_A").rows
    missing = np.where(np.arange(len(rows)) % 2, rows["current_A"], np.nan)
    assert suspected(one_sided(), replace(record, rows=rows.assign(current_A=missing))) == [
        ("suspected-sign", "current_A")
    ]
    seen = ff.observe(one_sided(), turned(record, "distance_m"), find=False)
    assert (seen.findings[0].code, seen.findings[0].column) == ("suspected-sign", "distance_m")


@pytest.mark.parametrize("name", ["current_A", "distance_m"])
def test_a_setting_of_the_other_sign_is_named(record, name):
    assert suspected(one_sided(), turned(record, name)) == [("suspected-sign", name)]


@pytest.mark.parametrize(("factor", "words"), [(1e6, "too long"), (1e-6, "too short")])
def test_a_step_that_no_filter_can_take_is_refused_by_the_unit_of_time(record, factor, words):
    slow = replace(record, rows=record.rows.assign(time_s=factor * record.rows["time_s"]))
    with pytest.raises(TableError, match=f"1,000,000 times {words}"):
        ff.observe(damped(), slow)


@pytest.mark.parametrize("factor", [1e-3, 1e-1, 1.0, 10.0])
def test_usual_steps_are_taken(factor):
    require_possible_step(damped(), factor * STEP_S, "log")
