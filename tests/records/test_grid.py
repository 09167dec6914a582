"""Rows that a recorder lost stand on the record's grid as rows without readings."""

from dataclasses import replace

import numpy as np
import pytest

import femfit as ff
from femfit.core.errors import TableError
from femfit.estimate.record import on_grid, repeated
from tests.support.replays import STEP_S, damped, logs, series


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


def test_a_grid_is_found_where_most_rows_are_lost(log):
    short, _ = without(log[1], 0.6)  # then the usual step is two of the grid
    assert len(on_grid(short).series.rows) == len(log[1].rows)


def test_a_complete_record_is_left_as_it_is(log):
    jitter = 0.1 * STEP_S * np.sin(np.arange(len(log[1].rows)))
    record = replace(log[1], rows=log[1].rows.assign(time_s=log[1].rows["time_s"] + jitter))
    same, added = on_grid(record)
    assert same.findings == record.findings
    assert not added.any()


def test_gaps_between_segments_are_not_filled(log):
    rows = log[1].rows.copy()
    rows.loc[1000:, ["time_s", "segment"]] += [7.3 * STEP_S, 1]
    assert not on_grid(replace(log[1], rows=rows)).added.any()


def test_steps_of_any_length_are_refused(log):
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


def test_a_lost_row_within_a_slow_sensors_repeats_makes_no_new_reading():
    values = np.array([1.0, 1.0, np.nan, 1.0, 2.0, 2.0, 2.0, 2.0])
    np.testing.assert_array_equal(repeated(values, np.array([0]), 4).astype(int), [0, 1, 0, 1, 0, 1, 1, 1])


def test_a_record_keeps_what_is_clipped_beside_its_sample(log):
    short, kept = without(log[1], 0.05)
    levels = np.where(np.arange(len(short.rows)) == 50, 9.0, np.nan)
    full = on_grid(replace(short, clipped={"current_A": levels})).series
    assert np.flatnonzero(np.isfinite(full.clipped["current_A"])) == np.flatnonzero(kept)[50]


def test_series_of_several_segments_keep_their_numbers():
    record = series(np.ones(40), np.ones(40), segment=np.repeat([0, 1], 20))
    rows = record.rows.assign(time_s=record.rows["time_s"] + record.rows["segment"])
    full = on_grid(replace(record, rows=rows.drop(index=[5, 30]).reset_index(drop=True))).series
    np.testing.assert_array_equal(full.rows["segment"], np.repeat([0, 1], 20))
