"""Smoothing is the batch least-squares solution; responses of filters and smoother; the paper's folded recursions."""

from dataclasses import replace

import numpy as np
import pytest
from arpaia2022.kalman import KalmanIntegrator
from arpaia2022.parallel_prefix import CHUNK_LENGTH, Folding, affine_recursion, riccati_recursion
from arpaia2022.sensors import PAPER_COIL

from femfit.integrate.feed_forward import LastSample, increments
from femfit.integrate.offset_filter import OffsetFilter, smooth
from femfit.integrate.uncertainty import LinearSigma, Noise
from femfit.tables.coil_record import CoilBlock
from support.field_blocks import run

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


def test_smoothing_is_the_batch_least_squares_solution():
    record, _ = made(60)
    wander = 1e-5
    integrator = OffsetFilter(PAPER_COIL, NOISE, DT, None, 0.4, offset_wander=wander, interval=DT)
    _, steps = increments(LastSample(), record, PAPER_COIL, NOISE, DT)
    n, late = len(record), DT / PAPER_COIL.area_m2
    # Unknown are field and offset of each sample; rows: the start, each step of both, each reading, by their sigmas.
    rows, right = [], []
    for k in range(n):
        now, before = np.zeros((2, 2 * n)), np.zeros((2, 2 * n))
        now[:, 2 * k : 2 * k + 2] = np.eye(2)
        if k == 0:
            covariance, step = np.diag([NOISE.initial_T**2, integrator.offset_sigma**2]), np.array([0.4, 0.0])
        else:
            before[:, 2 * k - 2 : 2 * k] = [[1.0, -late], [0.0, 1.0]]
            walk = wander**2 * DT * np.array([[late**2 / 3.0, -late / 2.0], [-late / 2.0, 1.0]])
            covariance, step = walk + np.diag([steps.variance[k], 0.0]), np.array([steps.field[k], 0.0])
        weight = np.linalg.inv(np.linalg.cholesky(covariance))
        rows += [weight @ (now - before), now[:1] / 1e-5]
        right += [weight @ step, record.hall[k : k + 1] / 1e-5]
    matrix = np.concatenate(rows)
    expected = np.linalg.lstsq(matrix, np.concatenate(right), rcond=None)[0]
    smoothed = smooth(integrator, record)
    # Rows whose weights are 1e6 apart cost six of sixteen digits.
    np.testing.assert_allclose(smoothed.field, expected[::2], atol=1e-9)
    np.testing.assert_allclose(smoothed.offset, expected[1::2], atol=1e-9)
    spread = np.diag(np.linalg.inv(matrix.T @ matrix))[::2]
    np.testing.assert_allclose(smoothed.variance, spread, rtol=1e-4)


def test_smoothing_halves_the_variance_inside_the_record_and_ends_where_the_filter_does():
    record, truth = made(30_000)
    integrator = OffsetFilter(PAPER_COIL, NOISE, DT, offset_wander=1e-6)
    _, filtered = integrator.advance(integrator.start(), record)
    smoothed = smooth(integrator, record)
    inside = slice(3000, 27_000)

    def rms(block):
        return np.sqrt(np.mean((block.field - truth)[inside] ** 2))

    # A random walk's smoothed variance is half the filtered one, 0.71 in rms; with the offset it is smaller still.
    assert rms(smoothed) < 0.75 * rms(filtered)
    assert smoothed.field[-1] == filtered.field[-1]
    assert np.all(smoothed.variance[inside] < filtered.variance[inside])


def test_two_state_smoothing_is_as_sure_as_it_is_right():
    errors = []
    for seed in range(6):
        record, truth = made(10_000, seed)
        smoothed = smooth(OffsetFilter(PAPER_COIL, NOISE, DT, offset_wander=1e-6), record)
        errors.append((smoothed.field - truth)[3000:7000:500] / np.sqrt(smoothed.variance[3000:7000:500]))
    # 48 nearly independent errors: their rms is 1 within 10 % (one standard deviation).
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(1.0, abs=0.25)


def test_a_record_shorter_than_a_correction_is_only_filtered():
    record, _ = made(3)
    integrator = OffsetFilter(PAPER_COIL, NOISE, DT)
    np.testing.assert_array_equal(
        smooth(integrator, record).field, integrator.advance(integrator.start(), record)[1].field
    )


@pytest.mark.parametrize(("name", "change"), [("reference", 1e-3), ("reference_unit", 1e-4), ("voltage_unit", 1e-6)])
@pytest.mark.parametrize(
    ("integrate", "integrator"),
    [
        (smooth, OffsetFilter(PAPER_COIL, NOISE, DT)),
        (run, OffsetFilter(PAPER_COIL, NOISE, DT, initial_field=0.4)),
        (run, KalmanIntegrator(PAPER_COIL, NOISE, DT, initial_field=0.4)),
    ],
    ids=["smoother", "offset filter", "the paper's filter"],
)
def test_responses_are_what_a_systematic_error_does_to_the_field(name, change, integrate, integrator):
    record, _ = made(3000)
    wrong = {
        "reference": replace(record, hall=record.hall * (1.0 + change)),
        "reference_unit": replace(record, hall=record.hall + change),
        "voltage_unit": replace(record, voltage=record.voltage + change),
    }[name]
    block = integrate(integrator, record)
    moved = (integrate(integrator, wrong).field - block.field) / change
    expected = getattr(block.responses, name)
    # Both are linear in the record; differences of 1 T over the change keep ten digits.
    np.testing.assert_allclose(moved, expected, rtol=1e-6, atol=1e-9 * max(1.0, abs(expected).max()))


@pytest.mark.parametrize("samples", [1, CHUNK_LENGTH - 1, CHUNK_LENGTH, CHUNK_LENGTH + 1, 5000])
@pytest.mark.parametrize("strength", [1e-9, 1.0, 1e6])
def test_folded_recursions_are_those_of_a_loop(samples, strength):
    rng, folding = np.random.default_rng(2), Folding(samples)
    a, b, w = rng.uniform(0.9, 1.0, samples), rng.normal(size=samples), rng.uniform(0.5, 2.0, samples)
    j = strength * rng.uniform(0.5, 2.0, samples) * (rng.uniform(size=samples) > 0.1)  # a tenth without a reading
    x, variance, expected = 0.7, 5.0, np.empty((3, samples))
    for k in range(samples):
        x, prior = a[k] * x + b[k], variance + w[k]
        gain = prior * j[k] / (1.0 + prior * j[k])
        variance = (1.0 - gain) * prior
        expected[:, k] = x, variance, 1.0 - gain
    (affine,) = affine_recursion(folding.fold(a, 1.0), [folding.fold(b, 0.0)], [0.7])
    np.testing.assert_allclose(folding.unfold(affine), expected[0], rtol=1e-12, atol=1e-12)
    posterior, share = riccati_recursion(folding.fold(w, 0.0), folding.fold(j, 0.0), 5.0)
    # 1 - K cancels digits in the loop where K is within 1e-6 of 1; the folded form does not subtract.
    np.testing.assert_allclose(folding.unfold(posterior), expected[1], rtol=1e-9)
    np.testing.assert_allclose(folding.unfold(share), expected[2], rtol=1e-9)
