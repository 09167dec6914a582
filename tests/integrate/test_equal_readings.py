"""A column that repeats one reading is named where it cannot have been alive, and a quiet one is left in peace."""

import numpy as np
import pandas as pd
import pytest
from scipy.signal import lfilter

from femfit.integrate.integrate_coil import integrate_coil

AREA, RATE = 0.05, 500.0
TIME = np.arange(30_000) / RATE
SET_CURRENT = np.interp(TIME % 20.0, [0.0, 5.0, 8.0, 15.0, 18.0, 20.0], [0.0, 0.0, 80.0, 80.0, 0.0, 0.0])
LAG = 0.3 * RATE  # Samples of eddy currents
FIELD = lfilter([1.0 / LAG], [1.0, 1.0 / LAG - 1.0], 0.01 * SET_CURRENT)
INDUCED = AREA * np.gradient(FIELD, 1.0 / RATE)
LARGEST = np.abs(INDUCED).max()
STEP = 2.44e-4
"""Of a converter of 12 bits, V: twelve times the noise."""


def record(noise_V=2e-5):
    """Three cycles of 20 s to 0.8 T."""
    volts, hall, current = np.random.default_rng(5).normal(size=(3, len(TIME)))
    columns = {
        "time_s": TIME,
        "coil_voltage_V": INDUCED + 8e-6 + noise_V * volts,
        "hall_T": FIELD + 2e-4 * hall,
        "current_A": SET_CURRENT + 0.01 * current,
    }
    return pd.DataFrame(columns)


def coarse(rows, step=STEP):
    return rows.assign(coil_voltage_V=np.round(rows["coil_voltage_V"] / step) * step)


RECORD = record()
VOLTAGE = RECORD["coil_voltage_V"]
CLIPPED = RECORD.assign(coil_voltage_V=VOLTAGE.clip(-0.98 * LARGEST, 0.98 * LARGEST))
BEYOND = RECORD.assign(hall_T=RECORD["hall_T"].clip(upper=0.5))
"""It goes beyond its range and comes back, so that nothing has moved from begin to end."""

FROZEN = RECORD.assign(hall_T=RECORD["hall_T"].where(np.arange(len(TIME)) < 13_000, RECORD["hall_T"][13_000]))
COARSE = coarse(RECORD)


@pytest.mark.parametrize(
    ("rows", "options", "code", "refuted"),
    [
        (BEYOND, {"coil_area_m2": AREA}, "stuck", True),
        (BEYOND, {"method": "trapezoid"}, "stuck", False),
        (FROZEN, {"coil_area_m2": AREA}, "stuck", True),
        (FROZEN, {"method": "trapezoid"}, "stuck", False),
        (CLIPPED, {"coil_area_m2": AREA}, "clipped", True),
        (CLIPPED[["time_s", "coil_voltage_V"]], {"method": "trapezoid"}, "clipped", True),
        (CLIPPED[:4000], {"coil_area_m2": AREA}, "clipped", True),
        # A column of another unit, which spoils what is mixed of coil and probe, not the coil alone
        (RECORD.assign(hall_T=1e3 * RECORD["hall_T"]), {"coil_area_m2": AREA}, "gain", True),
        (RECORD.assign(hall_T=1e3 * RECORD["hall_T"]), {"coil_area_m2": AREA, "method": "trapezoid"}, "gain", False),
    ],
)
def test_the_column_that_cannot_be_is_named_and_numbers_that_rest_on_it_are_refuted(rows, options, code, refuted):
    integral = integrate_coil(rows, **options)
    codes = {finding.code for finding in integral.findings}
    assert codes - {"innovations"} == {code}
    assert (code in integral.refuted_by) == refuted
    innovations = [str(finding) for finding in integral.findings if finding.code == "innovations"]
    word = {"clipped": "converter", "gain": "area"}.get(code, "Hall probe, which")
    assert all(word in text.split("Suspect:")[1] for text in innovations)


SWING = 0.5 * (1.0 - np.cos(TIME))
ROUND = RECORD.assign(coil_voltage_V=0.5 * AREA * np.sin(TIME), hall_T=SWING, current_A=100.0 * SWING)
QUIET = {
    "as it is": RECORD,
    "a converter of coarse steps": COARSE,
    "steps as small as the noise": coarse(RECORD, 2e-5),
    "steps of three times the noise": coarse(RECORD, 6e-5),
    "a maximum that is round": coarse(ROUND),
    "computed without noise": RECORD.assign(coil_voltage_V=INDUCED),
    "a voltage of four digits": RECORD.assign(
        coil_voltage_V=[float(f"{v:.4g}") for v in record(3e-6)["coil_voltage_V"]]
    ),
    "each sample three times": RECORD.assign(coil_voltage_V=VOLTAGE[np.arange(len(TIME)) // 3 * 3].to_numpy()),
}


@pytest.mark.parametrize("options", [{"method": "trapezoid"}, {"method": "ffa2", "coil_area_m2": AREA}])
@pytest.mark.parametrize("columns", [("hall_T", "current_A"), ()], ids=", ".join)
@pytest.mark.parametrize("name", QUIET)
def test_a_quiet_record_is_left_in_peace(name, columns, options):
    rows = QUIET[name][["time_s", "coil_voltage_V", *columns]]
    codes = {finding.code for finding in integrate_coil(rows, **options).findings}
    assert codes <= {"plateau"}


def test_a_wrong_area_beside_a_coarse_converter_is_a_gain_and_nothing_stuck():
    """A Hall probe shows that the coil's area is off by a fifth, though the converter repeats most readings."""
    integral = integrate_coil(COARSE, method="trapezoid", coil_area_m2=1.2 * AREA)
    assert [finding.code for finding in integral.findings] == ["gain"]
