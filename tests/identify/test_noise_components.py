"""The scatter of mounts and runs where its search does not end."""

import numpy as np
from scipy.optimize import OptimizeResult

from femfit.identify.noise import components
from femfit.identify.readings.bench import bench_observations
from support.campaign import campaign


def test_a_search_that_does_not_end_takes_no_scatter_for_smaller_than_it_is(levitation_model, monkeypatch):
    observations = bench_observations(levitation_model, campaign(levitation_model, 1))
    found = components.estimate_noise(observations)

    def lost(cost, start, **options):
        return OptimizeResult(x=np.full(len(start), -4.0), success=False)

    monkeypatch.setattr(components.optimize, "minimize", lost)
    unknown = components.estimate_noise(observations)
    assert np.all(unknown.run >= 0.5 * found.run)
    assert unknown.mount_m >= 0.5 * found.mount_m
