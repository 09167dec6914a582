"""Each check finds its fault in a table that is wrong, once, and says nothing of three that are right."""

import inspect
from functools import partial

import numpy as np
import pandas as pd
import pytest

from femfit.core.results import Finding
from femfit.estimate.record_checks import suspect_record
from femfit.tables import checks, outliers, sweep_checks
from femfit.tables.checks import BENCH_CHECKS, Expected, checked
from femfit.tables.measurement import check_clock
from support.force_law import Law

LAW = Law()
BOX = Expected(limits={"distance_m": (0.004, 0.026), "current_A": (-0.5, 1.5)})


def clock(rows, _model):
    return check_clock(rows)[1]


def bench(seed=0, noise=1e-3):
    """A bench with noise, in the order of measuring."""
    rng, rows = np.random.default_rng(seed), LAW.table()
    rows["force_N"] *= 1.0 + noise * rng.standard_normal(len(rows))
    hall = 0.5 + 1e-4 * rng.standard_normal(len(rows))
    return rows.assign(run=1.0, order=np.arange(len(rows)), branch=0.0, hall_V=hall)


def record(seed=0, noise=1e-3):
    """A body that swings, sampled each millisecond."""
    rng, time = np.random.default_rng(seed), np.arange(1500) / 1000.0
    swing = np.sin(7.0 * time), np.cos(5.0 * time)
    current, distance = (wave + noise * rng.standard_normal(len(time)) for wave in swing)
    return pd.DataFrame({"run": 1.0, "time_s": time, "current_A": 0.5 + current, "distance_m": 0.02 + 5e-3 * distance})


def sweep(**columns):
    rows = LAW.table(distances=np.linspace(5e-3, 25e-3, 31)).assign(**columns)
    return rows.assign(source="t.csv", line=np.arange(len(rows)) + 2)


def spoilt(rows, column, places, value):
    rows = rows.copy()
    rows.loc[places, column] = value(rows.loc[places, column]) if callable(value) else value
    return rows


def scaled(rows, column, factor):
    return rows.assign(**{column: factor * rows[column]})


def together(*tables):
    return pd.concat(tables, ignore_index=True)


def rough(rows):
    return scaled(rows, "force_N", 1.0 + 0.03 * np.random.default_rng(5).standard_normal(len(rows)))


# Check and code of what it says
CASES = {
    "size": (checks.suspected_units, "suspected-unit"),
    "limits": (checks.suspected_units, "suspected-unit"),
    "copies": (checks.copies, "copies"),
    "stuck": (checks.faulty_readings, "stuck"),
    "outliers": (outliers.outliers, "outliers"),
    "impossible": (checks.faulty_samples, "outliers"),
    "samples": (checks.faulty_samples, "stuck"),
    "clock": (clock, "clock"),
    "incomplete": (sweep_checks.incomplete_rows, "cells"),
    "solved sizes": (sweep_checks.solved_sizes, "distance"),
    "repeated": (sweep_checks.repeated_points, "contradictions"),
    "holes": (sweep_checks.holes_of_grid, "holes"),
    "sign": (sweep_checks.force_sign, "force-sign"),
    "gaps": (sweep_checks.gaps, "gaps"),
    "reciprocity": (sweep_checks.reciprocity, "reciprocity"),
    "noise": (sweep_checks.force_noise, "noise"),
}
SAY_WHAT_HOLDS = {"reciprocity", "noise"}
"""Where what is wrong is a warning or an error."""

WRONG = {
    "size": lambda: scaled(bench(), "distance_m", 1e3),
    "limits": lambda: scaled(bench(), "current_A", 1e3),
    "copies": lambda: together(bench(), bench()),
    "stuck": lambda: spoilt(bench(), "hall_V", slice(30, 54), 0.5),
    "outliers": lambda: spoilt(bench(), "force_N", 30, lambda force: 3.0 * force),
    "impossible": lambda: spoilt(record(), "current_A", 77, 1e9),
    "samples": lambda: spoilt(record(), "current_A", slice(300, 600), 0.7),
    "clock": lambda: spoilt(record(), "time_s", slice(700, None), lambda time: time - 0.3),
    "incomplete": lambda: spoilt(sweep(), "force_N", [3, 9], np.nan),
    "solved sizes": lambda: spoilt(sweep(), "distance_m", 3, -1e-3),
    "repeated": lambda: together(sweep(), sweep(force_N=1.0)[:3]),
    "holes": lambda: sweep().drop(index=[7, 50]),
    "sign": lambda: scaled(sweep(), "force_N", -1.0),
    "gaps": lambda: spoilt(sweep(), "flux_linkage_Wb", 5, np.nan),
    "reciprocity": lambda: scaled(sweep(), "flux_linkage_Wb", 30.0),
    "noise": lambda: rough(sweep()),
}
RIGHT = {
    "size": [bench, record, lambda: sweep(coil_temperature_C=25.0)],
    "limits": [bench, lambda: bench().assign(current_A=0.0), lambda: bench().assign(distance_m=0.1)],
    "copies": [
        bench,
        lambda: together(bench(), bench(1).assign(run=2.0)),
        lambda: together(*2 * [bench()[["distance_m", "current_A"]]]).assign(force_N=np.arange(168.0)),
    ],
    "stuck": [
        bench,
        lambda: bench().round({"hall_V": 3}),
        lambda: bench().assign(voltage_V=np.repeat([0.0, 6.0, 12.0, 24.0], 21)),
    ],
    "outliers": [
        bench,
        lambda: scaled(bench(), "force_N", 1.2),
        lambda: spoilt(bench(), "force_N", slice(0, 21), lambda force: 1.5 * force),
    ],
    "impossible": [
        record,
        lambda: scaled(record(1), "current_A", 1e9),
        lambda: record(2)[["run", "time_s"]].assign(coil_temperature_C=-196.0),
    ],
    "samples": [
        record,
        lambda: record(1).round({"current_A": 2}),
        # What was computed rests at a stop, and at a current that is commanded
        lambda: record(noise=0.0).assign(distance_m=lambda rows: rows["distance_m"].clip(0.018, 0.022)),
        lambda: record(noise=0.0).assign(distance_m=0.02),
    ],
    "clock": [
        record,
        lambda: record()[np.random.default_rng(1).random(1500) < 0.5].reset_index(drop=True),
        lambda: together(record(), record(1).assign(run=2.0)),
    ],
    "incomplete": [sweep, lambda: sweep(flux_linkage_Wb=np.nan), lambda: sweep(force_N=0.0)],
    "solved sizes": [sweep, lambda: sweep(force_N=0.0), lambda: sweep()[::-1]],
    "repeated": [sweep, lambda: sweep()[:5], lambda: sweep()[::2]],
    "holes": [sweep, lambda: sweep()[::-1], lambda: sweep()[:62]],
    "sign": [sweep, lambda: sweep(force_N=0.0), lambda: sweep()[:31]],
    "gaps": [sweep, lambda: sweep().drop(columns="flux_linkage_Wb"), lambda: sweep(hall_T=0.0)],
    "reciprocity": [sweep, lambda: sweep().query("distance_m > 0.01"), lambda: sweep()[62:]],
    "noise": [sweep, lambda: sweep()[:31], lambda: scaled(sweep(), "force_N", 1e3)],
}


def said(name, rows):
    force = LAW.force(rows["distance_m"].to_numpy(), rows["current_A"].to_numpy()) if name == "outliers" else None
    findings = CASES[name][0](rows, {"limits": BOX, "outliers": Expected({"force_N": force})}.get(name))
    assert all(isinstance(remark, Finding) for remark in findings)
    return [remark for remark in findings if name not in SAY_WHAT_HOLDS or remark.severity != "info"]


@pytest.mark.parametrize("name", CASES)
def test_a_check_names_its_fault_once(name):
    assert [remark.code for remark in said(name, WRONG[name]())] == [CASES[name][1]]


@pytest.mark.parametrize(("name", "right"), [(name, right) for name, tables in RIGHT.items() for right in tables])
def test_a_check_says_nothing_of_a_table_that_is_right(name, right):
    assert said(name, right()) == []


def test_fifteen_checks_at_most_look_at_a_table_and_each_is_tried():
    functions = {f for m in (checks, sweep_checks, outliers) for f in vars(m).values() if inspect.isfunction(f)}
    every = {f for f in functions if [*inspect.signature(f).parameters][1:2] in (["model"], ["_model"])}
    assert every | {clock} == {check for check, _ in CASES.values()}
    assert len({*every, check_clock, suspect_record}) <= 15


def test_what_a_check_sets_aside_is_missing_in_what_goes_on():
    rows, (remark,) = checked(WRONG["stuck"](), BENCH_CHECKS)
    assert np.flatnonzero(rows["hall_V"].isna()).tolist() == list(range(30, 55))
    assert type(remark) is Finding
    kept, _ = checked(WRONG["sign"](), [partial(sweep_checks.force_sign, keep=True)])
    assert (kept["force_N"] < 0).all()
