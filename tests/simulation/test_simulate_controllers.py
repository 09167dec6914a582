"""Controllers: poles where they were placed, stable over the whole range, clamped; the Riccati equation of scipy."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from femfit.core.errors import DomainError
from femfit.simulation.adjust import adjusted
from femfit.simulation.design import CONTROLLERS
from femfit.simulation.operating_point import feedback_gain, operating_point, solve_riccati
from femfit.simulation.plant import Plant
from femfit.simulation.targets import Reference
from femfit.simulation.words import sentence


def test_pid_removes_a_constant_disturbance(levitation_model, design):
    point = operating_point(levitation_model, 0.026)
    heavier = replace(levitation_model.motion, gravity_m_s2=1.02 * levitation_model.motion.gravity_m_s2)
    plant = Plant(replace(levitation_model, motion=heavier))
    state = np.array([[0.026, 0.0, point.currents_A[0]]])
    memory, zero = np.zeros((1, design.controller("pid").words)), np.zeros(1)
    for _ in range(4000):
        voltage, memory = design.controller("pid").command(memory, state, Reference(np.array([0.026]), zero, zero))
        state = plant.step(state, voltage)
    assert state[0, 0] == pytest.approx(0.026, abs=1e-7)  # backstepping would be off by 0.02 g/k_p = 0.2 mm


@pytest.mark.parametrize("name", CONTROLLERS)
def test_commands_stay_within_the_clamp_and_nothing_winds_up_behind_it(levitation_model, design, name):
    circuit, controller = levitation_model.circuit, design.controller(name)
    far = np.array([[0.030, 0.0, 0.5]])
    zero = np.zeros(1)
    reference = Reference(np.array([0.022]), zero, zero)
    memory = np.zeros((1, controller.words))
    memories = []
    for _ in range(2000):
        voltage, memory = controller.command(memory, far, reference)
        assert circuit.voltage_min_V <= voltage[0, 0] <= circuit.voltage_max_V
        memories.append(memory)
    assert voltage[0, 0] == pytest.approx(circuit.voltage_max_V)
    np.testing.assert_allclose(memories[-1], memories[1000], atol=1e-6)  # an integrator would have doubled


def test_gains_given_and_printed_are_those_of_the_controller(design):
    """The gains of the recursion are sums of large numbers: what they leave of no integral is rounding."""
    assert adjusted(design, "pid", gains={"ki": 0.0}).controller("pid").parts["ki"] == 0.0
    controller = design.controller("state-feedback")
    printed = re.findall(r"(\w+) (-?[\d.e+-]+) ", sentence("loop", "gains", design, controller))
    again = adjusted(design, "state-feedback", gains={name: float(value) for name, value in printed})
    own = again.controller("state-feedback")
    np.testing.assert_allclose(own.gains, controller.gains, rtol=1e-3)
    np.testing.assert_allclose(own.integral, controller.integral, rtol=1e-3)


@pytest.mark.parametrize("seed", range(6))
def test_the_solution_is_that_of_scipy(seed):
    generator = np.random.default_rng(seed)
    n, m = 4, 1 + seed % 3
    A, B = generator.standard_normal((n, n)), generator.standard_normal((n, m))
    root, R = generator.standard_normal((n, n)), np.diag(generator.uniform(0.1, 10.0, m))
    X = solve_discrete_are(A, B, root @ root.T, R)
    # Both solve to rounding, times the condition of some hundreds that random matrices have
    np.testing.assert_allclose(solve_riccati(A, B, root @ root.T, R), X, rtol=1e-8, atol=1e-8 * np.abs(X).max())
    K = np.linalg.solve(R + B.T @ X @ B, B.T @ X @ A)
    np.testing.assert_allclose(feedback_gain(A, B, root @ root.T, R), K, rtol=1e-7, atol=1e-7 * np.abs(K).max())


def test_a_state_that_grows_is_brought_back_though_it_is_not_weighed_or_refused_where_it_cannot_be():
    A, B = np.diag([2.0, 0.5]), np.eye(2)
    X = solve_riccati(A, B, np.diag([0.0, 1.0]), np.eye(2))
    K = np.linalg.solve(np.eye(2) + B.T @ X @ B, B.T @ X @ A)
    assert np.abs(np.linalg.eigvals(A - B @ K)).max() == pytest.approx(0.5)  # the growing one mirrored
    with pytest.raises(DomainError, match="stabilising"):
        solve_riccati(A, np.array([[0.0], [1.0]]), np.eye(2), np.eye(1))
