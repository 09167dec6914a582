"""A record of a device with eddy currents through filters that know them, and through one that does not."""

import numpy as np
import pytest

import femfit as ff
from femfit.model.dynamics import runge_kutta_step
from support.eddies import with_eddies
from support.replays import STEP_S, damped, series

STEPS = 1500


@pytest.fixture(scope="module")
def model():
    return with_eddies(damped(), (4e-3, 3e-4))


@pytest.fixture(scope="module")
def log(model):
    """A coil fed with a square wave; the sensors' noises alone."""
    generator = np.random.default_rng(3)
    volts = 6.0 + 3.0 * np.sign(np.sin(np.arange(STEPS) / 47.0))
    state, rows = np.array([[3.5e-3, 0.0, 0.0, 0.0, 0.0]]), np.empty((STEPS, 5))
    for k in range(STEPS):
        rows[k] = state[0]
        state = runge_kutta_step(model, state, volts[k : k + 1], STEP_S, 4)
    noise = generator.standard_normal((STEPS, 2)) * [4e-3, 2e-5]
    return series(volts, rows[:, 2] + noise[:, 0], rows[:, 0] + noise[:, 1]), rows


def test_a_filter_estimates_the_eddy_currents_and_the_record_shows_its_noise(model, log):
    record, rows = log
    seen = ff.observe(model, record)
    table, late = seen.table, slice(STEPS // 3, None)
    for k, name in enumerate(("distance_m", "velocity_m_s", "current_A", "eddy_1_A", "eddy_2_A")):
        error = np.sqrt(np.mean((table[f"ukf_{name}"].to_numpy()[late] - rows[late, k]) ** 2))
        assert error < 0.1 * np.ptp(rows[late, k]), name
    assert seen.filters[0].replayed.mean.shape[1] >= 5
    found = {one.name: one for one in seen.noise.estimates}
    assert found["voltage"].assumed == pytest.approx(0.1, rel=1e-6)
    for name, wanted in (("current", 4e-3), ("laser", 2e-5)):
        (one,) = [each for key, each in found.items() if key.endswith(name)]
        assert one.value == pytest.approx(wanted, rel=0.1)
