"""Smoothing uses the whole record: the batch least-squares solution, and smaller errors than the filter's."""

from dataclasses import replace

import numpy as np
import pytest
from arpaia2022.sensors import PAPER_COIL

from femfit.integrate.increments import LastSample, increments
from femfit.integrate.kalman import KalmanIntegrator
from femfit.integrate.offset_filter import OffsetFilter
from femfit.integrate.smoother import smooth
from femfit.integrate.uncertainty import LinearSigma, Noise
from femfit.tables.coil_block import CoilBlock

DT = 1e-3
NOISE = Noise(LinearSigma(2e-6), LinearSigma(1e-5), 1e-3)


def made(samples, seed=1, wander=1e-6):
    """A moving field, its coil with an offset that walks, its probe; and the truth."""
    rng = np.random.default_rng(seed)
    time = np.arange(samples) * DT
    field = 0.5 + 0.01 * np.sin(3.0 * time)
    offset = 5e-6 + np.cumsum(rng.normal(size=samples)) * wander * np.sqrt(DT)
    voltage = 0.059394 * 0.03 * np.cos(3.0 * time) + offset + 2e-6 * rng.normal(size=samples)
    return CoilBlock(time, voltage, field + 1e-5 * rng.normal(size=samples)), field


def test_one_state_smoothing_is_the_batch_least_squares_solution():
    record, _ = made(60)
    integrator = KalmanIntegrator(PAPER_COIL, NOISE, DT, initial_field=0.4)
    _, steps = increments(LastSample(), record, PAPER_COIL, NOISE, DT)
    # Rows: prior of the first sample, each increment, each reading; weighted by their sigmas.
    n = len(record)
    difference = np.eye(n) - np.eye(n, k=-1)
    step_sigma = np.sqrt(np.r_[NOISE.initial_T**2, steps.variance[1:]])
    matrix = np.concatenate([difference / step_sigma[:, None], np.eye(n) / 1e-5])
    right = np.r_[np.r_[0.4, steps.field[1:]] / step_sigma, record.hall / 1e-5]
    normal = matrix.T @ matrix
    expected = np.linalg.solve(normal, matrix.T @ right)
    smoothed = smooth(integrator, record)
    # The normal equations' condition of 1e6 costs six of sixteen digits.
    np.testing.assert_allclose(smoothed.field, expected, atol=1e-10)
    np.testing.assert_allclose(smoothed.variance, np.diag(np.linalg.inv(normal)), rtol=1e-5)


@pytest.mark.parametrize("two_states", [False, True], ids=["cs1", "cs1-offset"])
def test_smoothing_halves_the_variance_inside_the_record_and_ends_where_the_filter_does(two_states):
    record, truth = made(30_000)
    integrator = KalmanIntegrator(PAPER_COIL, replace(NOISE, voltage=LinearSigma(3e-5)), DT)
    if two_states:
        integrator = OffsetFilter(PAPER_COIL, NOISE, DT, offset_wander=1e-6)
    _, filtered = integrator.advance(integrator.start(), record)
    smoothed = smooth(integrator, record)
    inside = slice(3000, 27_000)

    def rms(block):
        return np.sqrt(np.mean((block.field - truth)[inside] ** 2))

    # A random walk's smoothed variance is half the filtered one, 0.71 in rms; that of two states is smaller still.
    assert rms(smoothed) < 0.75 * rms(filtered)
    assert smoothed.field[-1] == filtered.field[-1]
    assert np.all(smoothed.variance[inside] < filtered.variance[inside])


def test_two_state_smoothing_is_as_sure_as_it_is_right():
    errors = []
    for seed in range(12):
        record, truth = made(10_000, seed)
        smoothed = smooth(OffsetFilter(PAPER_COIL, NOISE, DT, offset_wander=1e-6), record)
        errors.append((smoothed.field - truth)[3000:7000:500] / np.sqrt(smoothed.variance[3000:7000:500]))
    # 96 nearly independent errors: their rms is 1 within 7 % (one standard deviation).
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(1.0, abs=0.25)


def test_a_record_shorter_than_a_correction_is_only_filtered():
    record, _ = made(3)
    integrator = OffsetFilter(PAPER_COIL, NOISE, DT)
    np.testing.assert_array_equal(
        smooth(integrator, record).field, integrator.advance(integrator.start(), record)[1].field
    )


@pytest.mark.parametrize("two_states", [False, True], ids=["cs1", "cs1-offset"])
@pytest.mark.parametrize(("name", "change"), [("reference", 1e-3), ("reference_unit", 1e-4), ("voltage_unit", 1e-6)])
def test_a_smoothed_fields_responses_are_what_a_systematic_error_does_to_it(name, change, two_states):
    record, _ = made(3000)
    wrong = {
        "reference": replace(record, hall=record.hall * (1.0 + change)),
        "reference_unit": replace(record, hall=record.hall + change),
        "voltage_unit": replace(record, voltage=record.voltage + change),
    }[name]
    integrator = KalmanIntegrator(PAPER_COIL, NOISE, DT)
    if two_states:
        integrator = OffsetFilter(PAPER_COIL, NOISE, DT)
    smoothed = smooth(integrator, record)
    moved = (smooth(integrator, wrong).field - smoothed.field) / change
    expected = getattr(smoothed.responses, name)
    # Both are linear in the record; differences of 1 T over the change keep ten digits.
    np.testing.assert_allclose(moved, expected, rtol=1e-6, atol=1e-9 * max(1.0, abs(expected).max()))
