"""Equation (11) to the letter, systematics by their sensitivities, and an uncertainty that holds what it says."""

from dataclasses import replace

import numpy as np
import pytest
from arpaia2022.kalman import KalmanIntegrator
from arpaia2022.sensors import PAPER_COIL, paper_noise

from femfit.integrate.integrator import LastSample, increments
from femfit.integrate.methods import IntegrationOptions, integrate_blocks, make_integrator
from femfit.integrate.offset_filter import OffsetFilter
from femfit.integrate.uncertainty import FieldBlock, LinearSigma, Noise, Responses, Systematics, white_sigma
from femfit.tables.coil_record import CoilBlock
from support.field_blocks import run

DT = 1e-3
KNOWN = Noise(LinearSigma(1e-5), LinearSigma(1e-5), 1e-3)


def test_the_literal_increment_is_equation_11():
    voltage, dt = np.array([0.010, 0.012]), np.array([1.0 / 204.8e3])
    sigma = 2.05e-3 + 3e-6 * voltage
    area = 0.059394
    # The area's term, 2.29e-6 m2 of it, is a ten-millionth of the voltage's and is left out.
    expected = dt**2 / (4 * area**2) * np.sum(sigma**2)
    assert (2.29e-6 / area * np.sum(voltage)) ** 2 < 2e-7 * np.sum(sigma**2)
    record = CoilBlock(dt * np.arange(2), voltage)
    found = increments(LastSample(), record, PAPER_COIL, paper_noise(True), dt[0])[1].variance
    np.testing.assert_allclose(found[1], expected[0], rtol=1e-12)


def test_independent_systematics_add_in_squares():
    one = np.ones(1)
    responses = Responses(2.0 * one, 3.0 * one, 0.5 * one, 100.0 * one)
    given = Systematics(coil_gain=1e-3, reference_gain=2e-3, reference_offset_T=4e-3, offset_voltage_V=1e-5)
    expected = (2e-3, 6e-3, 2e-3, 1e-3)
    np.testing.assert_allclose([part[0] for part in responses.parts(given).values()], expected)
    block = FieldBlock(*[16e-6 * one] * 6, responses)
    assert block.sigma(given)[0] ** 2 == pytest.approx(16e-6 + sum(value**2 for value in expected))


@pytest.mark.parametrize("sigma", [1e-9, 1e-3])
def test_white_noise_is_found_on_a_moving_signal(sigma):
    time = np.arange(20_000) * DT
    values = 1e-3 * np.sin(time) + sigma * np.random.default_rng(1).normal(size=len(time))
    # A median of 2e4 second differences: 1.5 %; the sine bends by 1e-9 a sample squared.
    assert white_sigma(values) == pytest.approx(sigma, rel=0.05 if sigma > 1e-6 else 0.3)


@pytest.mark.parametrize("method", ["trapezoid", "cs1-offset"])
def test_the_uncertainty_holds_what_it_says(method):
    """Errors of gain, area and offset drawn from what is claimed: the error over its sigma has an rms of 1."""
    rng, time = np.random.default_rng(3), np.arange(4000) * DT
    field = 0.2 + 0.1 * np.minimum(time, 2.0)
    claimed = Systematics(1e-3, 2e-3, 1e-4, 0.0 if method == "cs1-offset" else 1e-5)
    scores = []
    for _ in range(60):
        area, gain, zero, offset = rng.normal(size=4)
        voltage = 0.059394 * np.gradient(field, time) * (1 + 1e-3 * area) + 1e-5 * offset + 1e-6 * rng.normal(size=4000)
        hall = field * (1 + 2e-3 * gain) + 1e-4 * zero + 1e-5 * rng.normal(size=4000)
        record = CoilBlock(time, voltage, hall)
        options = IntegrationOptions(method, PAPER_COIL, initial_field=0.2 if method == "trapezoid" else None)
        ((_, block),) = integrate_blocks(make_integrator(options, record), [record])
        scores.append((block.field[-1] - field[-1]) / block.sigma(claimed)[-1])
    # 60 draws: the rms is known to 9 % (one standard deviation).
    assert np.sqrt(np.mean(np.square(scores))) == pytest.approx(1.0, abs=0.25)


def many_fields(options, time, rng, split, current=None):
    """Scatter of the fields of 400 records of 1e-5 V of noise and 50 uV of offset, in two parts, and the sigma said.

    400 draws: a standard deviation is known to 3.5 %. The trapezoid's ends differ from whole samples by half of one.
    """
    fields = []
    for _ in range(400):
        record = CoilBlock(time, 50e-6 + 1e-5 * rng.normal(size=len(time)), current=current)
        parts = [record[:split], record[split:]]
        out = [block for _, block in integrate_blocks(make_integrator(options, record), parts)]
        fields.append(np.concatenate([block.field for block in out]))
    return np.std(fields, axis=0), np.sqrt(np.concatenate([block.variance for block in out]))


def test_the_uncertainty_of_ffa1_holds_the_noise_of_its_zero_reading():
    """A field of zero and an offset of 50 uV: beside the samples' noise, the mean over the zero reading counts."""
    time = np.arange(601) * DT
    options = IntegrationOptions("ffa1", PAPER_COIL, initial_field=0.0, zero_reading=0.02, noise=KNOWN)
    found, said = many_fields(options, time, np.random.default_rng(4), 170)
    at = [22, 100, 600]
    np.testing.assert_allclose(found[at[1:]] / said[at[1:]], 1.0, atol=0.12)
    assert found[at[0]] <= 1.12 * said[at[0]]


def test_the_uncertainty_of_ffa2_holds_the_noise_of_its_windows_means():
    """A window's samples and its mean cancel once it has been in use as long as it lasts; longer use adds noise."""
    dt = 0.01
    time = np.arange(1200) * dt
    current = np.interp(time, [3.0, 4.0], [0.0, 50.0])  # No window from 3 s on is settled before 6 s
    options = IntegrationOptions("ffa2", PAPER_COIL, initial_field=0.0, settling=2.0, noise=KNOWN)
    found, said = many_fields(options, time, np.random.default_rng(5), 330, current)
    at = np.searchsorted(time, np.array([0.5, 1.0, 1.5, 2.0, 3.5, 5.0, 6.5, 9.0, 11.9]) - 0.5 * dt)
    np.testing.assert_allclose(found[at] / said[at], 1.0, atol=0.12)
    one_window = 1e-5 * dt * np.sqrt(100) / PAPER_COIL.area_m2
    assert said[at[3]] == pytest.approx(one_window, rel=0.01)  # at 2 s the first window's noise has cancelled
    assert said[at[-1]] > 2.0 * one_window


@pytest.mark.parametrize(("name", "change"), [("reference", 1e-3), ("reference_unit", 1e-4), ("voltage_unit", 1e-6)])
@pytest.mark.parametrize("integrator", [OffsetFilter, KalmanIntegrator])
def test_responses_are_what_a_systematic_error_does_to_the_field(name, change, integrator):
    """Of a moving field, its coil with an offset that walks, and its probe."""
    rng, time = np.random.default_rng(1), np.arange(3000) * DT
    offset = 5e-6 + np.cumsum(rng.normal(size=3000)) * 1e-6 * np.sqrt(DT)
    voltage = 0.059394 * 0.03 * np.cos(3.0 * time) + offset + 2e-6 * rng.normal(size=3000)
    record = CoilBlock(time, voltage, 0.5 + 0.01 * np.sin(3.0 * time) + 1e-5 * rng.normal(size=3000))
    changes = {
        "reference": {"hall": record.hall * (1.0 + change)},
        "reference_unit": {"hall": record.hall + change},
        "voltage_unit": {"voltage": record.voltage + change},
    }
    integrator = integrator(PAPER_COIL, Noise(LinearSigma(2e-6), LinearSigma(1e-5), 1e-3), DT, initial_field=0.4)
    block = run(integrator, record)
    moved = (run(integrator, replace(record, **changes[name])).field - block.field) / change
    expected = getattr(block.responses, name)
    # Both are linear in the record; differences of 1 T over the change keep ten digits.
    np.testing.assert_allclose(moved, expected, rtol=1e-6, atol=1e-9 * max(1.0, abs(expected).max()))
