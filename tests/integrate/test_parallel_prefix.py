"""Folded recursions give the numbers of the plain loop."""

import numpy as np
import pytest
from arpaia2022.parallel_prefix import CHUNK_LENGTH, Folding, affine_recursion, riccati_recursion

# Rounding of some thousand operations, each 1e-16.
ROUNDING = 1e-12
LENGTHS = [1, 2, CHUNK_LENGTH - 1, CHUNK_LENGTH, CHUNK_LENGTH + 1, 3 * CHUNK_LENGTH, 5000]


@pytest.mark.parametrize("samples", LENGTHS)
def test_affine_recursion_is_that_of_a_loop(samples):
    rng = np.random.default_rng(1)
    a, b = rng.uniform(0.9, 1.0, samples), rng.normal(size=samples)
    x, expected = 0.7, np.empty(samples)
    for k in range(samples):
        expected[k] = x = a[k] * x + b[k]
    folding = Folding(samples)
    first, second = affine_recursion(folding.fold(a, 1.0), [folding.fold(b, 0.0), folding.fold(0 * b, 0.0)], [0.7, 1.0])
    np.testing.assert_allclose(folding.unfold(first), expected, rtol=ROUNDING, atol=ROUNDING)
    np.testing.assert_allclose(folding.unfold(second), np.cumprod(a), rtol=ROUNDING)


@pytest.mark.parametrize("samples", LENGTHS)
@pytest.mark.parametrize("strength", [1e-9, 1e-3, 1.0, 1e6])
def test_riccati_recursion_is_that_of_a_loop(samples, strength):
    rng = np.random.default_rng(2)
    w = rng.uniform(0.5, 2.0, samples)
    j = strength * rng.uniform(0.5, 2.0, samples) * (rng.uniform(size=samples) > 0.1)  # a tenth without a reading
    variance, expected, gain = 5.0, np.empty(samples), np.empty(samples)
    for k in range(samples):
        prior = variance + w[k]
        gain[k] = prior * j[k] / (1.0 + prior * j[k])
        expected[k] = variance = (1.0 - gain[k]) * prior
    folding = Folding(samples)
    posterior, share = riccati_recursion(folding.fold(w, 0.0), folding.fold(j, 0.0), 5.0)
    # 1 - K cancels digits in the loop where K is within 1e-6 of 1; the folded form does not subtract.
    np.testing.assert_allclose(folding.unfold(posterior), expected, rtol=1e-9)
    np.testing.assert_allclose(folding.unfold(share), 1.0 - gain, rtol=1e-9)
