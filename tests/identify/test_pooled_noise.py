"""What an estimated noise is worth, of several channels together; and when effects explain most of a misfit."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from femfit.identify.decision.naming import _explains_most
from femfit.identify.noise.whitening import NoiseModel

NOISE = NoiseModel(
    channels=("force_N", "flux_linkage_Wb", "hall_V"),
    sigma=np.ones(3),
    rho=np.zeros(3),
    mount_m=0.0,
    run=np.zeros(3),
    repeats=np.zeros(3),
    degrees_of_freedom=np.array([12.0, 40.0, 1e-9]),
    source={"force_N": "repeats", "flux_linkage_Wb": "repeats"},
)


def test_pooled_variances_scatter_as_one_of_their_degrees_of_freedom():
    channel = np.repeat([0, 1, 2], [20, 10, 7])  # nothing is known of the third
    rng, known = np.random.default_rng(3), NOISE.degrees_of_freedom[:2]
    pooled = (rng.chisquare(known, (200_000, 2)) / known) @ [20 / 30, 10 / 30]
    assert 2.0 / np.var(pooled) == pytest.approx(NOISE.pooled_degrees(channel), rel=0.02)
    declared = replace(NOISE, degrees_of_freedom=np.array([12.0, np.inf, np.inf]))
    assert declared.pooled_degrees(channel) == pytest.approx((30 / 20) ** 2 * 12)
    assert declared.pooled_degrees(np.array([1, 1])) == np.inf


@pytest.mark.parametrize(
    ("excess", "after", "explains"), [(-5.0, 385.0, False), (-5.0, 379.0, False), (60.0, 340.0, True)]
)
def test_a_residual_shorter_than_its_noise_is_explained_by_nothing(excess, after, explains):
    readings = 400
    residual = np.full(readings, np.sqrt(380.0 / readings))
    observations = SimpleNamespace(
        value=np.zeros(readings), residual=residual, predict=lambda _: np.zeros(readings), mean_square=lambda x: x @ x
    )
    campaign = SimpleNamespace(
        whitening=SimpleNamespace(residual=residual),
        patterns=SimpleNamespace(excess=lambda _: excess),
        observations=observations,
        noise=SimpleNamespace(sigma=np.ones(1)),
    )
    assert _explains_most(campaign, SimpleNamespace(chi2=after, effects=())) is explains
