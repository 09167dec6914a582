"""Controllers: poles where they were placed, stable over the whole range, clamped; the Riccati equation of scipy."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from femfit.core.errors import DomainError
from femfit.simulation.adjust import adjusted
from femfit.simulation.controllers import SplitController
from femfit.simulation.design import CONTROLLERS
from femfit.simulation.operating_point import feedback_gain, operating_point, solve_riccati, zero_order_hold
from femfit.simulation.plant import Plant
from femfit.simulation.targets import Reference
from femfit.simulation.tune import design_pid
from femfit.simulation.words import sentence


def closed_loop_poles(model, controller, distance):
    """Continuous poles of plant and controller, from the linearised one-sample map of the code itself."""
    point = operating_point(model, distance)
    rest = np.array([distance, 0.0, point.currents_A[0]])
    words = controller.words
    still = np.zeros(1)
    reference = Reference(np.array([distance]), still, still)

    def advance(z):
        state, memory = z[None, :3], z[None, 3:]
        voltage, memory = controller.command(memory, state, reference)
        return np.concatenate([Plant(model).step(state, voltage)[0], memory[0]])

    centre = np.concatenate([rest, np.zeros(words)])
    steps = np.concatenate([[1e-7, 1e-5, 1e-5], np.full(words, 1e-6)])  # volts from these stay far below the clamp
    if words:
        steps[5:] = 1e-8  # errors in metres, times 5000 V/m
    columns = [(advance(centre + e) - advance(centre - e)) / (2 * e.max()) for e in np.diag(steps)]
    multipliers = np.linalg.eigvals(np.array(columns).T)
    return np.log(np.maximum(np.abs(multipliers), 1e-12)) / model.sample_time_s


@pytest.mark.parametrize("name", CONTROLLERS)
@pytest.mark.parametrize("distance", np.linspace(0.022, 0.030, 5))
def test_the_loop_is_stable_over_the_range(levitation_model, design, name, distance):
    slowest = closed_loop_poles(levitation_model, design.controller(name), distance).max()
    assert slowest < -8.0  # 1/s: settles in half a second; the plant's own unstable pole is +25 or more


def test_backstepping_without_enough_velocity_gain_is_unstable(levitation_model, design):
    b, points = design.controller("backstepping"), design.points
    needed = max((p.unstable_pole_rad_s**2 + b.position_gain) / p.coil_pole_rad_s for p in points)
    assert b.velocity_gain > needed
    lame = replace(b, velocity_gain=0.7 * needed)
    assert closed_loop_poles(levitation_model, lame, points[0].distance_m).max() > 0.0


def test_backstepping_puts_the_three_poles_at_a_third_of_the_coils(design):
    b = design.controller("backstepping")
    point = max(design.points, key=lambda p: p.unstable_pole_rad_s)
    p = min(q.coil_pole_rad_s for q in design.points)
    polynomial = [1 / p, 1.0, b.velocity_gain - point.unstable_pole_rad_s**2 / p, b.position_gain]
    np.testing.assert_allclose(np.array(polynomial) * p, np.poly(np.full(3, -p / 3)), rtol=1e-9)


def test_pid_has_its_quadruple_pole_where_it_is_designed(levitation_model, design):
    middle = design.points[len(design.points) // 2]
    pid = design_pid(levitation_model, middle)
    phi, gamma = zero_order_hold(middle.A, middle.B, levitation_model.sample_time_s)
    a = np.poly(phi)
    c = np.poly(phi - np.outer(gamma[:, 0], [1.0, 0.0, 0.0])) - a
    closed = np.polymul(np.polymul(a, [1.0, -1.0]), [1.0, -pid.filter_pole])
    closed = np.polyadd(closed, np.polymul(c[1:], pid.gains))
    roots = np.roots(closed)
    slow = roots[np.argsort(-np.abs(roots))[:4]]
    # a quadruple root splits by the fourth root of rounding, but its mean does not
    assert np.ptp(np.abs(slow)) < 3e-3
    w = -np.log(np.mean(slow).real) / levitation_model.sample_time_s
    n, coil, unstable = 3 * middle.coil_pole_rad_s, middle.coil_pole_rad_s, middle.unstable_pole_rad_s
    assert 10 * w**2 - 4 * (coil + n) * w + n * coil == pytest.approx(
        unstable**2, rel=0.3
    )  # continuous against sampled


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


def test_a_split_controller_gives_each_run_its_own(design):
    estimate = np.array([[0.0221, 0.01, 0.3], [0.0222, 0.0, 0.3], [0.0219, 0.0, 0.3]])
    zero = np.zeros(())
    reference = Reference(np.array(0.022), zero, zero)
    split = SplitController(
        ((np.array([0, 2]), design.controller("backstepping")), (np.array([1]), design.controller("pid")))
    )
    voltage, memory = split.command(np.zeros((3, split.words)), estimate, reference)
    for run, controller in (
        (0, design.controller("backstepping")),
        (1, design.controller("pid")),
        (2, design.controller("backstepping")),
    ):
        own = estimate[run : run + 1]
        alone, words = controller.command(np.zeros((1, controller.words)), own, reference)
        assert voltage[run] == alone[0]
        np.testing.assert_array_equal(memory[run, : words.shape[1]], words[0])


def test_gains_given_and_printed_are_those_of_the_controller(design):
    """The gains of the recursion are sums of large numbers: what they leave of no integral is rounding."""
    assert adjusted(design, "pid", gains={"ki": 0.0}).controller("pid").parts["ki"] == 0.0
    controller = design.controller("state-feedback")
    printed = re.findall(r"(\w+) (-?[\d.e+-]+) ", sentence("loop", "gains", design, controller))
    again = adjusted(design, "state-feedback", gains={name: float(value) for name, value in printed})
    own = again.controller("state-feedback")
    np.testing.assert_allclose(own.gains, controller.gains, rtol=1e-3)
    np.testing.assert_allclose(own.integral, controller.integral, rtol=1e-3)


@pytest.mark.parametrize("latency", [0, 2])
def test_poles_lie_where_they_are_given(design, latency):
    """Of x+ = A x + B u(k - q), q+ = q + t d, u = -K x - P (pending) - k q, all written out here."""
    poles = [-300.0, -120.0 + 60.0j, -120.0 - 60.0j, -40.0]
    late = replace(design, latency=latency)
    found = adjusted(late, "state-feedback", poles_rad_s=poles).controller("state-feedback")
    bench, step = late.bench("exact"), design.model.sample_time_s
    plant = bench.plants[bench.middle]
    loop = np.zeros((4 + latency, 4 + latency))
    law = -np.concatenate([found.gains[0], found.pending[0], found.integral])
    loop[:3, :3], loop[-1, -1], loop[-1, 0] = plant.A[:3, :3], 1.0, step
    if latency:
        loop[:3, 2 + latency] = plant.B[:3, 0]
        loop[3] = law
        for k in range(1, latency):
            loop[3 + k, 2 + k] = 1.0
    else:
        loop[:3] += np.outer(plant.B[:3, 0], law)
    multipliers = np.linalg.eigvals(loop)
    multipliers = multipliers[np.argsort(-np.abs(multipliers))]
    rates = np.log(multipliers[:4]) / step
    np.testing.assert_allclose(np.sort_complex(rates), np.sort_complex(np.array(poles)), rtol=1e-5)
    # Commands on their way stay at zero, where a double root splits by the root of rounding
    assert np.all(np.abs(multipliers[4:]) < 1e-3)


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
