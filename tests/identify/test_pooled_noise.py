"""What an estimated noise is worth, of several channels together; and when effects explain most of a misfit."""

from dataclasses import dataclass, replace
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


@dataclass
class _White:
    """Readings that are white as they are."""

    misfit: None = None

    def full(self, misfit):
        return misfit


@pytest.mark.parametrize(("before", "after", "explains"), [(380, 385, False), (380, 379, False), (460, 420, True)])
def test_a_misfit_shorter_than_its_noise_is_explained_by_nothing(before, after, explains):
    readings = np.ones(400) / 20.0
    observations = SimpleNamespace(
        value=np.zeros(400),
        residual=before**0.5 * readings,
        predict=lambda _: -(after**0.5) * readings,
        mean_square=lambda misfit: np.array([misfit @ misfit]),
    )
    campaign = SimpleNamespace(whitening=_White(), observations=observations, noise=SimpleNamespace(sigma=np.ones(1)))
    assert _explains_most(campaign, SimpleNamespace(effects=())) is explains
