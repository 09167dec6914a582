"""A gain between coil and Hall probe is found, measured, and told from drift, jumps and noise."""

import re

import numpy as np
import pandas as pd
import pytest

import femfit as ff

AREA, RATE = 0.031, 500.0
TIME = np.arange(0.0, 60.0, 1.0 / RATE)
FIELD = np.interp(TIME, [6.0, 12.0, 20.0, 26.0, 34.0, 40.0], [0.0, 0.32, 0.32, 0.1, 0.1, 0.32])
DRIFT, JUMP = 1e-5 * TIME + 5e-4 * np.sin(TIME / 5.0), 2e-3 * (TIME > 9.0)


def integrated(hall, seed=1, **options):
    """A coil of 30 uV noise whose offset voltage drifts, beside a probe of 40 uT noise."""
    rng = np.random.default_rng(seed)
    rise = AREA * np.diff(FIELD, append=FIELD[-1]) * RATE
    # The mean of two neighbours is the trapezoid of a field that is sampled: what the coil integrates is exact
    voltage = 0.5 * (rise + np.roll(rise, 1)) + 6e-6 + 1e-7 * TIME + 30e-6 * rng.normal(size=len(TIME))
    reading = hall + 40e-6 * rng.normal(size=len(TIME))
    rows = pd.DataFrame({"time_s": TIME, "coil_voltage_V": voltage, "hall_T": reading})
    return ff.integrate_coil(rows, method="cs1-offset", coil_area_m2=AREA, **options)


def findings(result):
    return {finding.code: finding for finding in result.findings}


@pytest.mark.parametrize("gain", [0.97, 0.996, 1.004, 1.03])
def test_a_gain_is_measured_and_suspected(gain):
    result = integrated(gain * FIELD)
    found = findings(result)["gain"]
    off, expanded = map(float, re.search(r"off by ([\d.]+) \+- ([\d.]+) % \(k = 2\)", found.text).groups())
    assert expanded < 0.15
    assert off == pytest.approx(100.0 * abs(gain - 1.0), abs=1.5 * expanded)  # 3 sigma
    assert found.size * (gain - 1.0) > 0.0
    assert "--reference-gain-sigma" in found.remedy
    assert "innovations" in findings(result) or abs(gain - 1.0) < 0.01


@pytest.mark.parametrize("seed", range(4))
def test_a_clean_record_is_not_suspected(seed):
    result = integrated(FIELD, seed)
    assert result.findings == ()


@pytest.mark.parametrize("error", [DRIFT, JUMP, 2e-3], ids=["drift", "jump on a ramp", "offset"])
def test_what_is_no_gain_is_not_called_one(error):
    assert "gain" not in findings(integrated(FIELD + error))


def test_a_gain_within_what_was_declared_is_no_warning():
    result = integrated(1.03 * FIELD, reference_gain_sigma=0.02)
    assert findings(result)["gain"].severity == "info"
    assert findings(integrated(1.03 * FIELD, reference_gain_sigma=0.002))["gain"].severity == "warning"
