"""Each check finds its fault in a table that is wrong, once, and says nothing of three that are right."""

import inspect
from functools import partial

import numpy as np
import pandas as pd
import pytest

from femfit.core.results import Finding
from femfit.estimate.record_checks import suspect_record
from femfit.tables import checks as table_checks
from femfit.tables import outliers as outlier_checks
from femfit.tables import sweep_checks
from femfit.tables.checks import (
    BENCH_CHECKS,
    Expected,
    checked,
    copies,
    faulty_readings,
    faulty_samples,
    suspected_units,
)
from femfit.tables.measurement import check_clock
from femfit.tables.outliers import outliers
from femfit.tables.sweep_checks import (
    force_noise,
    force_sign,
    gaps,
    holes_of_grid,
    incomplete_rows,
    reciprocity,
    repeated_points,
    solved_sizes,
)

BOX = Expected(limits={"distance_m": (0.004, 0.026), "current_A": (-0.5, 1.5)})


def clock(rows, _model):
    return check_clock(rows)[1]


def bench(law, seed=0, noise=1e-3):
    """A bench with noise, in the order of measuring."""
    rng = np.random.default_rng(seed)
    rows = law.table()
    rows["force_N"] *= 1.0 + noise * rng.standard_normal(len(rows))
    return rows.assign(
        run=1.0, order=np.arange(len(rows)), branch=0.0, hall_V=0.5 + 1e-4 * rng.standard_normal(len(rows))
    )


def record(seed=0, noise=1e-3):
    """A body that swings, sampled each millisecond."""
    rng, time = np.random.default_rng(seed), np.arange(1500) / 1000.0
    swing = np.sin(7.0 * time), np.cos(5.0 * time)
    current, distance = (wave + noise * rng.standard_normal(len(time)) for wave in swing)
    return pd.DataFrame({"run": 1.0, "time_s": time, "current_A": 0.5 + current, "distance_m": 0.02 + 5e-3 * distance})


def sweep(law, **columns):
    rows = law.table(distances=np.linspace(5e-3, 25e-3, 31)).assign(**columns)
    return rows.assign(source="t.csv", line=np.arange(len(rows)) + 2)


def spoilt(rows, column, places, value):
    rows = rows.copy()
    rows.loc[places, column] = value(rows.loc[places, column]) if callable(value) else value
    return rows


def twice(rows):
    return pd.concat([rows, rows], ignore_index=True)


def predicted(law, rows):
    return Expected({"force_N": law.force(rows["distance_m"].to_numpy(), rows["current_A"].to_numpy())})


def rough(rows):
    return rows.assign(force_N=rows["force_N"] * (1.0 + 0.03 * np.random.default_rng(5).standard_normal(len(rows))))


# Check, code of what it says, the table that is wrong, and three that are right
CASES = {
    "size": (
        suspected_units,
        "suspected-unit",
        lambda law: bench(law).assign(distance_m=lambda rows: 1e3 * rows["distance_m"]),
        [bench, lambda law: record(), lambda law: sweep(law, coil_temperature_C=25.0)],
    ),
    "limits": (
        suspected_units,
        "suspected-unit",
        lambda law: bench(law).assign(current_A=lambda rows: 1e3 * rows["current_A"]),
        [bench, lambda law: bench(law).assign(current_A=0.0), lambda law: bench(law).assign(distance_m=0.1)],
    ),
    "copies": (
        copies,
        "copies",
        lambda law: twice(bench(law)),
        [
            bench,
            lambda law: pd.concat([bench(law), bench(law, 1).assign(run=2.0)], ignore_index=True),
            lambda law: twice(bench(law)[["distance_m", "current_A"]]).assign(force_N=np.arange(168.0)),
        ],
    ),
    "stuck": (
        faulty_readings,
        "stuck",
        lambda law: spoilt(bench(law), "hall_V", slice(30, 54), 0.5),
        [
            bench,
            lambda law: bench(law).assign(hall_V=lambda rows: rows["hall_V"].round(3)),
            lambda law: bench(law).assign(voltage_V=np.repeat([0.0, 6.0, 12.0, 24.0], 21)),
        ],
    ),
    "outliers": (
        outliers,
        "outliers",
        lambda law: spoilt(bench(law), "force_N", 30, lambda force: 3.0 * force),
        [
            bench,
            lambda law: bench(law).assign(force_N=lambda rows: 1.2 * rows["force_N"]),
            lambda law: spoilt(bench(law), "force_N", slice(0, 21), lambda force: 1.5 * force),
        ],
    ),
    "impossible": (
        faulty_samples,
        "outliers",
        lambda law: spoilt(record(), "current_A", 77, 1e9),
        [
            lambda law: record(),
            lambda law: record(1).assign(current_A=lambda rows: 1e9 * rows["current_A"]),
            lambda law: record(2)[["run", "time_s"]].assign(coil_temperature_C=-196.0),
        ],
    ),
    "samples": (
        faulty_samples,
        "stuck",
        lambda law: spoilt(record(), "current_A", slice(300, 600), 0.7),
        [
            lambda law: record(),
            lambda law: record(1).assign(current_A=lambda rows: rows["current_A"].round(2)),
            # What was computed rests at a stop, and at a current that is commanded
            lambda law: record(noise=0.0).assign(distance_m=lambda rows: rows["distance_m"].clip(0.018, 0.022)),
        ],
    ),
    "clock": (
        clock,
        "clock",
        lambda law: spoilt(record(), "time_s", slice(700, None), lambda time: time - 0.3),
        [
            lambda law: record(),
            lambda law: record()[np.random.default_rng(1).random(1500) < 0.5].reset_index(drop=True),
            lambda law: pd.concat([record(), record(1).assign(run=2.0)], ignore_index=True),
        ],
    ),
    "incomplete": (
        incomplete_rows,
        "cells",
        lambda law: spoilt(sweep(law), "force_N", [3, 9], np.nan),
        [sweep, lambda law: sweep(law, flux_linkage_Wb=np.nan), lambda law: sweep(law, force_N=0.0)],
    ),
    "solved sizes": (
        solved_sizes,
        "distance",
        lambda law: spoilt(sweep(law), "distance_m", 3, -1e-3),
        [sweep, lambda law: sweep(law, force_N=0.0), lambda law: sweep(law)[::-1]],
    ),
    "repeated": (
        repeated_points,
        "contradictions",
        lambda law: pd.concat([sweep(law), sweep(law).assign(force_N=1.0)[:3]], ignore_index=True),
        [sweep, lambda law: sweep(law)[:5], lambda law: sweep(law)[::2]],
    ),
    "holes": (
        holes_of_grid,
        "holes",
        lambda law: sweep(law).drop(index=[7, 50]),
        [sweep, lambda law: sweep(law)[::-1], lambda law: sweep(law)[:62]],
    ),
    "sign": (
        force_sign,
        "force-sign",
        lambda law: sweep(law, force_N=lambda rows: -rows["force_N"]),
        [sweep, lambda law: sweep(law, force_N=0.0), lambda law: sweep(law)[:31]],
    ),
    "gaps": (
        gaps,
        "gaps",
        lambda law: spoilt(sweep(law), "flux_linkage_Wb", 5, np.nan),
        [sweep, lambda law: sweep(law).drop(columns="flux_linkage_Wb"), lambda law: sweep(law, hall_T=0.0)],
    ),
    # These two say what holds, too: what is wrong is a warning or an error
    "reciprocity": (
        reciprocity,
        "reciprocity",
        lambda law: sweep(law, flux_linkage_Wb=lambda rows: 30.0 * rows["flux_linkage_Wb"]),
        [sweep, lambda law: sweep(law)[sweep(law)["distance_m"] > 0.01], lambda law: sweep(law)[62:]],
    ),
    "noise": (
        force_noise,
        "noise",
        lambda law: rough(sweep(law)),
        [sweep, lambda law: sweep(law)[:31], lambda law: sweep(law, force_N=lambda rows: 1e3 * rows["force_N"])],
    ),
}
SAY_WHAT_HOLDS = {"reciprocity", "noise"}


def said(name, law, rows):
    check = CASES[name][0]
    model = {"limits": BOX, "outliers": predicted(law, rows) if name == "outliers" else None}.get(name)
    findings = check(rows, model)
    assert all(isinstance(remark, Finding) for remark in findings)
    return [remark for remark in findings if name not in SAY_WHAT_HOLDS or remark.severity != "info"]


@pytest.mark.parametrize("name", CASES)
def test_a_check_names_its_fault_once(name, law):
    _, code, wrong, _ = CASES[name]
    assert [remark.code for remark in said(name, law, wrong(law))] == [code]


@pytest.mark.parametrize("place", range(3))
@pytest.mark.parametrize("name", CASES)
def test_a_check_says_nothing_of_a_table_that_is_right(name, place, law):
    assert said(name, law, CASES[name][3][place](law)) == []


def test_fifteen_checks_at_most_look_at_a_table_and_each_is_tried():
    modules = (table_checks, sweep_checks, outlier_checks)
    functions = {f for module in modules for f in vars(module).values() if inspect.isfunction(f)}
    checks = {f for f in functions if [*inspect.signature(f).parameters][1:2] in (["model"], ["_model"])}
    assert checks | {clock} == {check for check, *_ in CASES.values()}
    assert len({*checks, check_clock, suspect_record}) <= 15


def test_what_a_check_sets_aside_is_missing_in_what_goes_on(law):
    rows, (remark,) = checked(CASES["stuck"][2](law), BENCH_CHECKS)
    assert np.flatnonzero(rows["hall_V"].isna()).tolist() == list(range(30, 55))
    assert type(remark) is Finding
    cold, (remark,) = checked(bench(law).assign(coil_temperature_C=-400.0), BENCH_CHECKS)
    assert cold["coil_temperature_C"].isna().all()
    assert "beyond the possible -273.15 to 2000" in remark.text
    turned = sweep(law, force_N=lambda points: -points["force_N"])
    kept, _ = checked(turned, [partial(force_sign, keep=True)])
    assert (kept["force_N"] < 0).all()
