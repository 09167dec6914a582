"""Columns whose unit, sign or polarity contradicts the model are named before anything is filtered."""

from dataclasses import replace

import numpy as np
import pytest

import femfit as ff
from femfit.core.errors import TableError
from femfit.estimate.record_checks import require_possible_step, suspect_record
from tests.support.replays import STEP_S, damped, logs


@pytest.fixture(scope="module")
def record():
    return logs(600, 1, seed=3)[1][0]


def one_sided():
    model = damped()
    limits = {"voltage_min_V": 0.0, "voltage_max_V": 12.0}
    return replace(
        model, circuits=(replace(model.circuits[0], **limits),), validity=replace(model.validity, current_min_A=0.0)
    )


def turned(record, *names):
    return replace(record, rows=record.rows.assign(**{name: -record.rows[name] for name in names}))


def suspected(model, record):
    return [(one.code, one.column) for one in suspect_record(model, record)]


def test_a_record_of_the_model_is_not_suspected(record):
    assert suspected(one_sided(), record) == []
    assert suspected(damped(), record) == []


@pytest.mark.parametrize("name", ["current_A", "distance_m"])
def test_a_setting_of_the_other_sign_is_named(record, name):
    assert suspected(one_sided(), turned(record, name)) == [("suspected-sign", name)]


def test_commands_that_a_supply_gives_only_the_other_way_are_named(record):
    found = suspect_record(one_sided(), turned(record, "voltage_V"))
    assert [(one.code, one.column) for one in found] == [("suspected-sign", "voltage_V")]
    assert "supply" in found[0].text


def test_a_winding_that_gives_power_to_its_driver_has_a_column_of_the_other_polarity(record):
    model = damped()
    limits = {"voltage_min_V": -12.0, "voltage_max_V": 12.0}
    most = model.validity.current_max_A
    both = replace(
        model, circuits=(replace(model.circuits[0], **limits),), validity=replace(model.validity, current_min_A=-most)
    )
    assert suspected(both, record) == []
    assert suspected(both, turned(record, "current_A")) == [("suspected-sign", "voltage_V")]


def test_what_is_suspected_is_the_first_that_observe_says(record):
    seen = ff.observe(one_sided(), turned(record, "distance_m"), find=False)
    assert (seen.findings[0].code, seen.findings[0].column) == ("suspected-sign", "distance_m")


@pytest.mark.parametrize(("factor", "words"), [(1e6, "too long"), (1e-6, "too short")])
def test_a_step_that_no_filter_can_take_is_refused_by_the_unit_of_time(record, factor, words):
    slow = replace(record, rows=record.rows.assign(time_s=factor * record.rows["time_s"]))
    with pytest.raises(TableError, match=f"1,000,000 times {words}"):
        ff.observe(damped(), slow)


@pytest.mark.parametrize("factor", [1e-3, 1e-1, 1.0, 10.0])
def test_usual_steps_are_taken(factor):
    require_possible_step(damped(), factor * STEP_S, "log")


def test_a_missing_reading_does_not_hide_a_sign(record):
    rows = turned(record, "current_A").rows
    missing = np.where(np.arange(len(rows)) % 2, rows["current_A"], np.nan)
    assert suspected(one_sided(), replace(record, rows=rows.assign(current_A=missing))) == [
        ("suspected-sign", "current_A")
    ]
