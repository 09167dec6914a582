"""A steady current tells the winding's resistance, whatever the filter makes of the record."""

import functools
from dataclasses import replace

import numpy as np
import pytest

import femfit as ff
from femfit.device.electrics import CurrentSensor
from femfit.estimate.process import FilterOutcome
from femfit.model.json_file import write_model
from support.command import worked
from support.solenoids import solenoid
from support.switching import CURRENT_A, logged, switched

WARMER = 1.1376
"""Of copper that is 35 K warmer."""


def record(factor, seed=1, mass=1.0):
    """Two pulses of 12 V on a device whose resistance and mass are so many times the drawn ones."""
    own = solenoid()
    plant = replace(
        own,
        circuits=(replace(own.circuit, resistance_ohm=factor * own.circuit.resistance_ohm),),
        motion=replace(own.motion, mass_kg=mass * own.motion.mass_kg),
    )
    return logged([switched([0.0, 0.01, 0.05, 0.07, 0.10], [0.0, 12.0, 0.0, 12.0, 0.0], 0.13, model=plant)], seed)


@functools.cache
def seen_by_the_drawn_model(factor):
    return ff.observe(solenoid(), record(factor), find=False)


@pytest.mark.parametrize("factor", [1.0, WARMER])
def test_voltage_over_steady_current_is_the_true_resistance_within_its_interval(factor):
    drawn = solenoid().circuit.resistance_ohm
    seen = seen_by_the_drawn_model(factor)
    (shown,) = seen.resistances
    assert shown.ohm == pytest.approx(factor * drawn, rel=3e-3)
    half = 0.5 * (shown.high_ohm - shown.low_ohm)
    assert abs(shown.ohm - factor * drawn) < 1.5 * half < 0.02 * drawn  # 1.5 of 95 % are three deviations
    assert shown.contradicts == (factor != 1.0)
    assert ("resistance" in str(seen).splitlines()[0]) == (factor != 1.0)


@pytest.mark.nightly
def test_a_resistance_that_accounts_for_little_of_the_misfit_is_not_blamed_for_it():
    """A body of twice the mass makes nearly all of it; 1.2 % of the resistance are significant all the same."""
    seen = ff.observe(solenoid(), record(1.012, mass=2.0))
    lines = str(seen).splitlines()
    assert seen.resistances[0].contradicts
    assert not seen.to_dict()["of_resistance"]
    assert lines[0] == seen.filters[0].sentence
    assert "1.2 % larger" in lines[1]
    assert set(seen.noise.lines(lost=False)) <= set(lines)


@pytest.mark.nightly
def test_a_small_resistance_that_accounts_for_the_misfit_is_said_first():
    seen = seen_by_the_drawn_model(1.012)
    assert seen.of_resistance
    assert "1.2 % larger" in str(seen).splitlines()[0]


@pytest.mark.nightly
def test_an_ammeter_of_another_gain_looks_like_a_resistance_and_is_named_beside_it():
    """It reads 3 % too little, so that voltage over current is 1 / 0.97 of the resistance."""
    right = record(1.0)
    little = replace(right, rows=right.rows.assign(current_A=0.97 * right.rows["current_A"]))
    seen = ff.observe(solenoid(), little, find=False)
    (shown,) = seen.resistances
    assert shown.ohm == pytest.approx(solenoid().circuit.resistance_ohm / 0.97, rel=3e-3)
    assert "ammeter" in str(shown)
    assert not seen.of_resistance  # the force follows the true current


def test_a_current_at_the_end_of_its_range_tells_no_resistance():
    own = solenoid()
    ammeter = CurrentSensor(name="ammeter", noise=CURRENT_A, circuit=own.circuit.name, maximum=0.3)
    clipped = record(1.0)
    clipped = replace(clipped, rows=clipped.rows.assign(current_A=clipped.rows["current_A"].clip(upper=0.3)))
    seen = ff.observe(replace(own, other_sensors=(ammeter,)), clipped, find=False)
    assert not any(one.contradicts for one in seen.resistances)


@pytest.mark.nightly
def test_a_warm_winding_is_the_first_line_and_no_advice_on_the_sensor(tmp_path):
    write_model(solenoid(), tmp_path / "model.json")
    columns = ["time_s", "voltage_V", "current_A", "distance_m"]
    record(WARMER).rows[columns].to_csv(tmp_path / "warm.csv", index=False)
    done = worked("observe", tmp_path / "model.json", tmp_path / "warm.csv", "--json", tmp_path / "seen.json")
    first = done.stdout.splitlines()[0]
    assert "resistance" in first
    assert "14 % larger" in first
    assert "offset" not in done.stdout
    assert "are 100 %" not in done.stdout


def test_a_covariance_that_breaks_down_is_blamed_on_the_reading_that_broke_it():
    seen = seen_by_the_drawn_model(1.0).filters[0]
    row = 500
    outcome = np.where(np.arange(len(seen.replayed.outcome)) < row, 0, int(FilterOutcome.COVARIANCE_LOST))
    innovation = seen.replayed.innovation.copy()
    innovation[row, 1] = 40.0 * np.sqrt(seen.replayed.variance[row, 1])
    broken = replace(
        seen,
        replayed=replace(seen.replayed, outcome=outcome, innovation=innovation),
        lost_at_s=0.05,
        outcome=FilterOutcome.COVARIANCE_LOST,
    )
    assert "40" in broken.sentence


@pytest.mark.nightly
def test_a_noise_is_not_told_that_may_be_anything_above_what_the_filter_was_given():
    found = ff.observe(solenoid(), record(1.0)).noise
    wide = replace(found.estimates[0], known=False, high=68.0, assumed=0.02)
    assert "at most 68" not in "\n".join(replace(found, estimates=(wide,)).lines())
    low = replace(wide, high=0.01)
    assert "at most 0.010" in "\n".join(replace(found, estimates=(low,)).lines())
