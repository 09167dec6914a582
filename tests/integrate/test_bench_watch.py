"""Faults of a bench record are named; a good one is left in peace."""

import numpy as np
import pytest

from femfit.integrate.bench_table import resistance_finding, watch_run
from femfit.integrate.plateaus import PlateauOptions, plateau_flux

RATE, INDUCTANCE, RESISTANCE = 100.0, 0.02, 2.0
RAMP = np.sin(0.5 * np.pi * np.linspace(0.0, 1.0, 40)) ** 2
CURRENT = np.concatenate([np.zeros(100), RAMP, np.ones(100), 1.0 - RAMP, np.zeros(100)])
TIME = np.arange(len(CURRENT)) / RATE
DISTANCE = np.full(len(CURRENT), 0.02)


def induced(seed=1):
    return INDUCTANCE * np.gradient(CURRENT, TIME) + np.random.default_rng(seed).normal(0.0, 1e-6, len(CURRENT))


def watched(rows, voltage, taken=RESISTANCE):
    time, current = TIME[rows], CURRENT[rows]
    without = voltage - taken * current
    found = plateau_flux(time, without, current, DISTANCE[rows], PlateauOptions())
    return found, [one.code for one in watch_run(time, voltage, without, current, found)]


ALL = np.arange(len(CURRENT))


@pytest.mark.parametrize("seed", range(5))
def test_a_good_record_is_left_in_peace(seed):
    assert watched(ALL, induced(seed) + RESISTANCE * CURRENT)[1] == []


def test_readings_that_repeat_on_a_plateau_are_not_clipped():
    # A converter of 1 mV reads the top plateau's R i of 2 V, its largest voltage, again and again.
    assert watched(ALL, np.round(induced() + RESISTANCE * CURRENT, 3))[1] == []


def test_a_change_cut_off_at_the_converters_limit_is_clipped():
    assert watched(ALL, np.clip(induced() + RESISTANCE * CURRENT, -1.5, 1.5))[1] == ["clipped"]


def test_a_coil_wired_the_wrong_way_round_is_named():
    assert watched(ALL, -induced(), taken=0.0)[1] == ["sign"]


def test_a_gap_between_plateaus_is_named_and_paid_for_and_one_on_a_plateau_costs_nothing():
    voltage = induced() + RESISTANCE * CURRENT
    lost = np.delete(ALL, range(110, 125))
    found, kinds = watched(lost, voltage[lost])
    assert kinds == ["gap"]
    # The largest voltage before the gap, for as long as the gap.
    without = (voltage - RESISTANCE * CURRENT)[:110]
    assert found.sigma[1] == pytest.approx(np.abs(without).max() * 16 / RATE, rel=1e-3)
    held = np.delete(ALL, range(40, 60))
    found, kinds = watched(held, voltage[held])
    assert kinds == ["gap"]
    assert found.sigma[1] < 1e-6


def test_a_clock_that_stutters_is_named():
    time = TIME.copy()
    time[300:] -= 0.6 / RATE
    without = induced()
    found = plateau_flux(time, without, CURRENT, DISTANCE, PlateauOptions())
    kinds = [one.code for one in watch_run(time, without + RESISTANCE * CURRENT, without, CURRENT, found)]
    assert kinds == ["clock"]


LEVELS = np.array([0.0, 0.5, 1.0, 1.5, 1.0, 0.0])
OFFSETS = np.random.default_rng(2).normal(5e-6, 2e-6, 6)


@pytest.mark.parametrize(
    ("resistance", "given", "words"),
    [
        (2.0, 2.05, None),  # 2.5 %: a few degrees
        (0.0, None, None),
        (2.3, 2.0, "warm"),
        (-2.0, 2.0, "sign"),
        (2.0, None, "--resistance-ohm 2"),
    ],
)
def test_the_plateaus_tell_the_resistance(resistance, given, words):
    finding = resistance_finding(resistance * LEVELS + OFFSETS, LEVELS, given)
    assert (finding is None) if words is None else (words in str(finding))
