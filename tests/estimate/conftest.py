"""A closed-loop record for the filters: the truth, the voltage and the noisy Hall voltage."""

from types import SimpleNamespace

import numpy as np
import pytest

from femfit.estimate.holding import holding_currents
from support.steps import runge_kutta_step


@pytest.fixture(scope="module", autouse=True)
def compiled_steps():
    """Thousands of samples by few filters: here a compiler pays."""
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("FEMFIT_COMPILER", raising=False)
        yield


@pytest.fixture(scope="session")
def record(levitation_model):
    """About 22 mm for 75 ms, in which what a body is off grows by a factor of ten; voltages held from before."""
    model, steps, runs, rng = levitation_model, 150, 3, np.random.default_rng(7)
    rest = np.array([0.022, 0.0, holding_currents(model, 0.022)[0]])
    state = np.tile(rest, (runs, 1)) + np.array([5e-5, 0.0, 0.0]) * rng.normal(size=(runs, 1))
    swing = 0.1 * np.sin(2.0 * np.pi * np.arange(steps)[:, None] / [20.0, 15.0, 12.0])
    truth, voltages = np.empty((steps, runs, 3)), model.circuit.resistance_ohm * rest[2] + swing
    for k in range(steps):
        truth[k] = state = runge_kutta_step(model, state, voltages[k], model.sample_time_s)
    hall = model.sensor.voltage(truth[..., 0], truth[..., 2]) + model.sensor.noise_V * rng.normal(size=(steps, runs))
    return SimpleNamespace(voltage=voltages, hall=hall)
