"""Commands beyond the supply are believed where the current follows them."""

from dataclasses import replace

import numpy as np
import pytest

import femfit as ff
from femfit.estimate.record_checks import given_voltage
from tests.support.solenoids import solenoid
from tests.support.switching import logged, switched

COMMANDS = [0.0, 0.01, 0.02, 0.05], [0.0, 24.0, 6.0, 24.0]


def stronger():
    """The same device on a supply of 24 V."""
    return replace(solenoid(), circuits=(replace(solenoid().circuit, voltage_max_V=24.0),))


@pytest.mark.parametrize(("truth", "code"), [(stronger(), "beyond-supply"), (solenoid(), "clamped")])
def test_the_current_says_whether_the_driver_gave_what_was_commanded(truth, code):
    loop = switched(*COMMANDS, 0.08, model=truth)
    record = logged([loop])
    commanded = record.rows["voltage_V"].to_numpy(copy=True)
    commanded[commanded >= 11.9] = 24.0
    record = replace(record, rows=record.rows.assign(voltage_V=commanded))
    comparison = ff.compare(solenoid(), record)
    assert comparison.verdict == "agrees", str(comparison)
    assert code in {one.code for one in comparison.findings}
    seen = ff.observe(solenoid(), record, find=False)
    assert code in {one.code for one in seen.findings}
    as_drawn = ff.observe(truth, logged([loop]), find=False)  # bounces are no part of the filter
    size, right = (one.filters[0].innovations[0].mean_square for one in (seen, as_drawn))
    assert size == pytest.approx(right, rel=0.15)  # the filter's own noise of the voltage is that of 12 V
    assert any("supply" in line for line in str(seen).splitlines()[:4])


def test_without_a_current_the_record_cannot_tell():
    loop = switched(*COMMANDS, 0.08, model=stronger())
    record = logged([loop], drop=("current_A",))
    seen = ff.observe(replace(solenoid(), sample_time_s=1e-4), record, sensors=("distance",), find=False)
    (said,) = [one for one in seen.findings if one.code == "clamped"]
    assert "cannot tell" in str(said)
    assert np.isfinite(seen.filters[0].replayed.mean).any()


def test_the_diodes_drop_lasts_until_a_falling_current_has_come_to_its_end():
    model, noise_A = solenoid(), 3e-3
    model = replace(model, circuits=(replace(model.circuit, drive=replace(model.circuit.drive, diode_V=0.7)),))
    time = 1e-4 * np.arange(400)
    current = np.maximum(0.1 - 8.0 * time, 0.0)
    current[current > 0.0] += np.random.default_rng(1).normal(0.0, noise_A, int((current > 0.0).sum()))
    distance = np.full(400, model.validity.distance_max_m)
    noise, segment = (noise_A, 1e-6), np.zeros(400, dtype=int)
    given = given_voltage(model, time, segment, np.zeros(400), current, distance, noise).voltage_V
    conducts = int((given == -0.7).sum())
    assert set(given) == {-0.7, 0.0}
    assert abs(conducts - 125) <= 3  # it would end 11 samples before, three standard deviations from zero
