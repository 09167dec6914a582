"""What the baselines find in misfits of known form, and what their correction is worth on readings not seen."""

import numpy as np
import pytest
from benchmarks.baselines import Problem, gaussian_process, lasso_bic, pysindy_powers, stepwise_aicc


def problem(form, seed=3):
    """A misfit of a given form over the places, ten times the noise; the last fifth of the readings is not seen."""
    rng = np.random.default_rng(seed)
    place = rng.uniform(-1.0, 1.0, (400, 3))
    columns = np.stack([place[:, 0], place[:, 1] ** 2, place[:, 2] ** 3], axis=1)
    target = 10.0 * form(*place.T) + rng.standard_normal(400)
    names, channels = ("offset", "gain", "drift"), ("force_N",)
    everything = np.ones(400, dtype=bool)
    campaign = Problem(np.ones(400), target, everything, columns, names, place, channels, np.zeros(400, dtype=int))
    return campaign.only(np.arange(400) < 320)


def error_after(campaign, answer):
    """Root mean square of what a correction leaves of the readings that were not seen, in standard deviations."""
    return np.sqrt(np.mean((campaign.target - answer.correction)[~campaign.seen] ** 2))


@pytest.mark.parametrize(
    ("method", "package", "name"),
    [
        (lasso_bic, "sklearn", "gain"),
        (stepwise_aicc, "sklearn", "gain"),
        (pysindy_powers, "pysindy", "force_N: current^2"),
    ],
)
def test_what_made_the_misfit_is_named_and_readings_that_were_not_seen_are_corrected(method, package, name):
    pytest.importorskip(package)
    campaign = problem(lambda d, i, f: i**2)
    answer = method(campaign)
    assert name in answer.names
    assert error_after(campaign, answer) < 1.2  # of 80 readings, two standard deviations


def test_a_gaussian_process_corrects_what_depends_on_distance_and_current_and_names_only_the_channel():
    pytest.importorskip("sklearn")
    campaign = problem(lambda d, i, f: np.sin(2.0 * d) * i)
    answer = gaussian_process(campaign)
    assert answer.names == ("force_N: something",)
    assert error_after(campaign, answer) < 1.5
    assert gaussian_process(problem(lambda d, i, f: 0.0 * d)).names == ()
