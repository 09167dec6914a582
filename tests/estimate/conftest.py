"""A closed-loop record for the filters: the truth, the voltage and the noisy Hall voltage."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from femfit.core.numerics import central_differences
from femfit.estimate.holding import holding_current
from femfit.model.actuator_model import ActuatorModel
from support.steps import runge_kutta_step


@pytest.fixture(scope="module", autouse=True)
def compiled_steps():
    """Thousands of samples by few filters: here a compiler pays."""
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("FEMFIT_COMPILER", raising=False)
        yield


@dataclass(frozen=True)
class Record:
    truth: np.ndarray  # (steps, runs, 3)
    voltage: np.ndarray  # (steps, runs): held from the sample before to this one
    hall: np.ndarray  # (steps, runs)


def feedback_gain(A: np.ndarray, B: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Discrete LQR gain by iterating the Riccati equation to rest."""
    S = weights
    for _ in range(20_000):
        K = (B @ S @ A) / (1.0 + B @ S @ B)
        S = weights + A.T @ S @ (A - np.outer(B, K))
    return K


def stabilised_record(model: ActuatorModel, steps: int, runs: int, rng: np.random.Generator, sigmas=None) -> Record:
    """Hold 22 mm by true-state feedback with process noise of the covariance that the filters are told."""
    rest = np.array([0.022, 0.0, holding_current(model, 0.022)])
    resting_voltage = model.circuit.resistance_ohm * rest[2]
    t = model.sample_time_s
    volts = np.full(6, resting_voltage)  # of two points a state
    A = central_differences(lambda x: runge_kutta_step(model, x, volts, t), rest[None], np.array([0.02, 0.02, 1.0]))[0]
    width = 1e-6
    B = (
        runge_kutta_step(model, rest, np.asarray(resting_voltage + width), t)
        - runge_kutta_step(model, rest, np.asarray(resting_voltage - width), t)
    ) / (2.0 * width)
    K = feedback_gain(A, B, np.diag([1e6, 1e2, 1.0]))
    state = np.tile(rest, (runs, 1)) + np.array([2e-4, 0.0, 0.0]) * rng.normal(size=(runs, 1))
    truth, voltages, hall = (np.empty((steps, runs, 3)), np.empty((steps, runs)), np.empty((steps, runs)))
    for k in range(steps):
        wander = 5e-4 * np.sin(2.0 * np.pi * k / 300.0)
        voltage = np.clip(resting_voltage - (state - rest - np.array([wander, 0.0, 0.0])) @ K, 0.5, 3.0)
        state = runge_kutta_step(model, state, voltage, t)
        if sigmas is not None:
            state = state + rng.normal(size=(runs, 3)) @ sigmas.T
        truth[k], voltages[k] = state, voltage
        hall[k] = model.sensor.voltage(state[:, 0], state[:, 2]) + model.sensor.noise_V * rng.normal(size=runs)
    return Record(truth, voltages, hall)


@pytest.fixture(scope="session")
def record(levitation_model: ActuatorModel) -> Record:
    return stabilised_record(levitation_model, steps=150, runs=3, rng=np.random.default_rng(7))


@pytest.fixture(scope="session")
def stabilised():
    return stabilised_record


@pytest.fixture(scope="session")
def as_the_plant_moves(levitation_model):
    """Turns a process of Euler steps into one of the Runge-Kutta steps that the records were made with."""
    t = levitation_model.sample_time_s

    def moved(process):
        return replace(
            process,
            transition=lambda x, u: runge_kutta_step(levitation_model, x, u, t),
            transition_jacobian=None,
        )

    return moved
