"""Each check finds its fault in a table that is wrong, once, and says nothing of three that are right."""

import numpy as np
import pandas as pd
import pytest

from femfit.core.results import Finding
from femfit.tables.checks import Expected, beyond_limits, faulty_samples
from femfit.tables.sweep_checks import (
    force_sign,
    gaps,
    holes_of_grid,
    incomplete_rows,
    repeated_points,
    solved_sizes,
)
from femfit.tables.units import suspected_by_size

BOX = Expected(limits={"distance_m": (0.004, 0.026), "current_A": (-0.5, 1.5)})


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


# Check, code of what it says, the table that is wrong, and three that are right
CASES = {
    "size": (
        suspected_by_size,
        "suspected-unit",
        lambda law: bench(law).assign(distance_m=lambda rows: 1e3 * rows["distance_m"]),
        [bench, lambda law: record(), lambda law: sweep(law, coil_temperature_C=25.0)],
    ),
    "limits": (
        beyond_limits,
        "suspected-unit",
        lambda law: bench(law).assign(current_A=lambda rows: 1e3 * rows["current_A"]),
        [bench, lambda law: bench(law).assign(current_A=0.0), lambda law: bench(law).assign(distance_m=0.1)],
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
}


def said(name, law, rows):
    findings = CASES[name][0](rows, BOX if name == "limits" else None)
    assert all(isinstance(remark, Finding) for remark in findings)
    return findings


@pytest.mark.parametrize("name", CASES)
def test_a_check_names_its_fault_once(name, law):
    _, code, wrong, _ = CASES[name]
    assert [remark.code for remark in said(name, law, wrong(law))] == [code]


@pytest.mark.parametrize("place", range(3))
@pytest.mark.parametrize("name", CASES)
def test_a_check_says_nothing_of_a_table_that_is_right(name, place, law):
    assert said(name, law, CASES[name][3][place](law)) == []
