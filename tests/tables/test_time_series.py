"""Recorded time series: what the file holds, what is wrong with clock, sensors and units; several files together."""

import numpy as np
import pandas as pd
import pytest

from femfit.core.errors import TableError
from femfit.tables.measurement import SERIES_COLUMNS, joined_measurements
from femfit.tables.measurement_file import read_measurement


def record(samples=2000, step=1e-3):
    """Two channels with noise: a current and a distance that swing."""
    time, noise = step * np.arange(samples), np.random.default_rng(0).standard_normal((2, samples))
    current = 0.5 + 0.1 * np.sin(30.0 * time) + 1e-3 * noise[0]
    distance = 0.02 + 1e-3 * np.cos(20.0 * time) + 1e-5 * noise[1]
    return pd.DataFrame({"time_s": time, "current_A": current, "distance_m": distance})


@pytest.fixture
def series(tmp_path):
    def read(table):
        table.to_csv(tmp_path / "record.csv", index=False)
        return read_measurement(tmp_path / "record.csv")

    return read


def finding(result, code, column=""):
    """The text of the only finding of a code."""
    (text,) = [str(one) for one in result.findings if (one.code, one.column) == (code, column)]
    return text


def spoilt(column, rows, value):
    """The record with some numbers of a column replaced."""
    table = record()
    table.loc[rows, column] = value(table[column]) if callable(value) else value
    return table


def test_a_sound_record_is_one_segment_without_findings(series):
    result = series(record())
    assert tuple(result.rows) == (*SERIES_COLUMNS, "segment")
    assert result.given == ("time_s", "current_A", "distance_m")
    assert result.channels == ("current_A", "distance_m")
    assert result.rows["run"].unique().tolist() == [1.0]
    uneven = np.random.default_rng(1).random(len(record())) < 0.5
    steps = np.array([1e-3, 0.02, 5e-5])
    coarse = np.round(record() / steps) * steps
    for sound in (result, series(record()[uneven]), series(coarse)):
        assert sound.findings == ()
        assert sound.rows["segment"].unique().tolist() == [0]


OVER = record()["current_A"] > 0.55


@pytest.mark.parametrize(
    ("table", "column", "lost", "code", "fact"),
    [
        (spoilt("distance_m", slice(900, 1100), lambda x: x[900]), "distance_m", range(900, 1101), "stuck", "201"),
        (spoilt("current_A", OVER, 0.55), "current_A", np.flatnonzero(OVER), "clipped", "0.55"),
        (spoilt("current_A", 100, 1e30), "current_A", [100], "outliers", "1e+30"),
        (spoilt("current_A", slice(10, 12), np.nan), "current_A", [10, 11, 12], "cells", "3"),
        (spoilt("distance_m", slice(None), lambda x: 1e3 * x), "distance_m", [], "suspected-unit", "mm"),
        (spoilt("current_A", slice(None), 0.3), "current_A", range(2000), "stuck", "0.3"),
    ],
)
def test_what_no_sensor_reads_is_set_aside_and_said(series, table, column, lost, code, fact):
    result = series(table)
    assert np.flatnonzero(result.rows[column].isna()).tolist() == list(lost)
    assert fact in finding(result, code, column)
    assert (column in result.given) == (len(lost) < len(table))


@pytest.mark.parametrize(
    ("clock", "words"),
    [
        (np.zeros(600), "time_s"),
        (-1e-3 * np.arange(600), "time_s"),
        (np.floor(0.2 * np.arange(600) + 1e-9) * 1e-3, "stamp"),
    ],
    ids=["stands", "falls", "coarse stamps"],
)
def test_a_clock_that_does_not_rise_is_refused_with_a_remedy(series, clock, words):
    with pytest.raises(TableError, match=words):
        series(record(600, 2e-4).assign(time_s=clock))


def test_a_clock_that_jumps_back_and_one_that_pauses_begin_new_segments(series):
    table = record()
    table.loc[700:, "time_s"] -= 0.3
    table.loc[1500:, "time_s"] += 0.5
    result = series(table)
    assert np.flatnonzero(np.diff(result.rows["segment"])).tolist() == [699, 1499]
    back, pause = (str(one) for one in result.findings if (one.code, one.column, one.size) == ("clock", "time_s", 1.0))
    assert "0.4 s" in back
    assert "1.7 s" in pause
    np.testing.assert_allclose(result.rows["time_s"], table["time_s"])  # nothing is repaired


def test_runs_stand_together_each_in_its_own_segment(series):
    table = pd.concat([record(300).assign(run=run) for run in (2.0, 1.0)])
    result = series(table.sort_values("time_s", kind="stable"))
    assert result.rows["run"].tolist() == [2.0] * 300 + [1.0] * 300
    assert result.rows["segment"].tolist() == [0] * 300 + [1] * 300
    assert result.findings == ()


def test_a_sidecar_declares_the_noise_of_a_sample(series, tmp_path):
    sidecar = "distance_um = 20\nflux_linkage_Wb = 1e-5\n[noise]\ncurrent_A = 6.5e-3\n"
    (tmp_path / "record.toml").write_text(sidecar, encoding="utf-8")
    result = series(record())
    assert result.declared_noise == pytest.approx({"distance_m": 20e-6, "current_A": 6.5e-3})
    assert "flux_linkage_Wb" in finding(result, "unused-setting")


@pytest.mark.parametrize("name", SERIES_COLUMNS[2:])
def test_every_column_is_read_by_its_own_name(name, series):
    table = record(50)
    table[name] = np.linspace(1.0, 1.1, len(table))
    read = series(table)
    assert name in read.given
    assert "unused-column" not in {one.code for one in read.findings}


def bench(path, runs=2, noise="", **columns):
    rows = pd.DataFrame({"distance_mm": [5.0, 6.0, 7.0] * runs, "force_N": np.arange(3.0 * runs)})
    rows.insert(0, "run", np.repeat(np.arange(1, runs + 1), 3))
    rows.assign(**columns).to_csv(path, index=False)
    if noise:
        path.with_suffix(".toml").write_text(f"[noise]\nforce_N = {noise}\n")
    return read_measurement(path)


def test_runs_mounts_and_segments_of_each_file_are_its_own(tmp_path, series):
    joined = joined_measurements([bench(tmp_path / "a.csv"), bench(tmp_path / "b.csv", 1, mount=7, current_A=0.5)])
    assert joined.rows["run"].tolist() == [1, 1, 1, 2, 2, 2, 3, 3, 3]
    assert joined.rows["mount"].tolist() == [1, 1, 1, 2, 2, 2, 3, 3, 3]
    assert joined.rows["force_N"].tolist() == [0, 1, 2, 3, 4, 5, 0, 1, 2]
    assert "current_A" in joined.given
    assert "a.csv and " in joined.source
    alone = bench(tmp_path / "a.csv")
    assert joined_measurements([alone]) is alone
    one, other = series(record(500)), series(record(501))
    joined = joined_measurements([one, other])
    assert joined.rows["run"].nunique() == 2
    assert joined.rows["segment"].nunique() == one.rows["segment"].nunique() + other.rows["segment"].nunique()
    assert len(joined.rows) == len(one.rows) + len(other.rows)


def test_what_does_not_belong_together_is_refused(tmp_path, series):
    table, log = bench(tmp_path / "a.csv", noise="1e-3"), series(record(500))
    another, copy = (bench(tmp_path / f"{name}.csv", noise=noise) for name, noise in (("b", "2e-3"), ("copy", "1e-3")))
    for tables, words in (
        ([table, log], "bench tables"),
        ([table, another], "noise"),
        ([table, copy], "copy"),
        ([], "measurement"),
    ):
        with pytest.raises(TableError, match=words):
            joined_measurements(tables)


def test_a_record_that_was_pasted_twice_counts_once(series):
    once, twice = record(), pd.concat([record(), record()])
    for table in (twice, twice.assign(run=7)):
        result = series(table)
        assert len(result.rows) == len(once)
        assert f"{len(once):,}" in finding(result, "copies")
    another = record()
    another["current_A"] += 1e-3
    assert len(series(pd.concat([once, another])).rows) == 2 * len(once)
