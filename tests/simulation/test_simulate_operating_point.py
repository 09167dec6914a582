"""Operating points, the linear model and reference about them, and controllers: poles, clamped commands, gains."""

import re
from dataclasses import replace

import numpy as np
import pytest

from femfit.core.errors import DomainError
from femfit.simulation.allocation import currents_for_force, limited
from femfit.simulation.design import CONTROLLERS, adjusted, design_loop
from femfit.simulation.experiment import Experiment
from femfit.simulation.operating_point import operating_point, solve_riccati
from femfit.simulation.plant import Plant
from femfit.simulation.targets import Reference, reference_rate, reference_steps
from femfit.simulation.words import sentence
from support.closed_loop import run
from support.levitation import STEEL
from support.one_current import flat, within
from support.parts import with_circuit, with_motion, with_sensor


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_currents_for_force_inverts_the_force_wherever_the_driver_ends(levitation_model, sign):
    model = levitation_model
    if sign < 0.0:
        model = with_circuit(model, voltage_min_V=-3.0, voltage_max_V=0.0)
        model = replace(model, validity=within(model.validity, low=-1.2, high=0.0))
    d, i = np.meshgrid(np.linspace(0.02, 0.032, 7), sign * np.linspace(0.2, 1.0, 7))
    np.testing.assert_allclose(currents_for_force(model, d, flat(model.magnetics).force(d, i))[..., 0], i, rtol=1e-9)


@pytest.mark.parametrize("currents", [None, (0.25, 0.9)])
def test_currents_for_force_stops_at_the_clamp_and_within_the_model(levitation_model, currents):
    circuit, model = levitation_model.circuit, levitation_model
    if currents:
        model = replace(model, validity=within(model.validity, *currents))
    ends = currents or np.array([circuit.voltage_min_V, circuit.voltage_max_V]) / circuit.resistance_ohm
    np.testing.assert_allclose(currents_for_force(model, np.full(2, 0.025), np.array([-1.0, 1.0]))[..., 0], ends)


def test_targets_are_derived_where_the_model_has_none_and_its_hall_element_is_not_saturated(levitation_model):
    free = replace(levitation_model, reference_distances_m=())
    design = design_loop(free)
    near, far, again = design.targets_m
    assert near == again
    circuit = levitation_model.circuit
    assert all(circuit.voltage_min_V < point.commands[0] < circuit.voltage_max_V for point in design.points)
    assert far - near > 3e-3
    # 8.3 mT fill the range above the quiescent output at 300 V/T; the magnet alone has 8.7 mT at 20 mm.
    design = design_loop(with_sensor(free, sensitivity_V_per_T=300.0))
    assert min(design.targets_m) > near
    for point in design.points:
        assert 0.0 < design.model.sensor.voltage(np.array([point.distance_m]), point.currents_A)[0] < 5.0


def test_the_reference_starts_at_rest_reaches_each_target_and_its_rates_belong_together():
    step, rate = 1e-4, 25.0
    r, v, a = reference_steps((0.022, 0.030), 20_000, step, rate)
    assert (r[0], v[0], a[0]) == (0.022, 0.0, 0.0)
    # after 1 s: (1 + 25 + 25^2/2) e^-25 = 5e-9 of the step
    assert r[-1] == pytest.approx(0.030, abs=1e-9)
    np.testing.assert_allclose(np.gradient(r, step), v, atol=1e-5 * v.max())
    np.testing.assert_allclose(np.gradient(v, step)[9_900:], a[9_900:], atol=3e-3 * a.max())


def test_the_reference_leaves_half_of_the_voltage_to_the_feedback(levitation_model):
    targets = levitation_model.reference_distances_m
    rate = reference_rate(levitation_model, targets)
    circuit, motion = levitation_model.circuit, levitation_model.motion
    distance, _, acceleration = reference_steps(targets, 3000, 1e-3, rate)
    wanted = motion.mass_kg * (motion.gravity_m_s2 - acceleration)
    voltage = circuit.resistance_ohm * currents_for_force(levitation_model, distance, wanted)[..., 0]
    assert voltage.min() > circuit.voltage_min_V + 0.1
    assert voltage.max() < circuit.voltage_max_V - 0.3
    assert reference_rate(with_circuit(levitation_model, voltage_min_V=0.7, voltage_max_V=2.5), targets) < rate


def reversed_current(function):
    """A co-energy, or a field, of a coil whose leads are the wrong way round."""
    spline, ends = function.spline, function.spline.y_knots
    return replace(function, spline=replace(spline, y_knots=-ends[::-1], coefficients=spline.coefficients[:, ::-1]))


@pytest.mark.nightly
def test_a_coil_with_its_leads_reversed_is_held_by_currents_of_the_other_sign(levitation_model):
    repelling = with_circuit(levitation_model, voltage_min_V=-3.0, voltage_max_V=-0.5)
    repelling = with_sensor(repelling, field=reversed_current(repelling.sensor.field))
    box = within(repelling.validity, low=-1.4, high=0.0)
    repelling = replace(repelling, magnetics=reversed_current(repelling.magnetics), validity=box)
    usual, reversed_ = design_loop(levitation_model), design_loop(repelling)
    for there, here in zip(usual.points, reversed_.points, strict=True):
        assert here.currents_A[0] == pytest.approx(-there.currents_A[0], rel=1e-9)
        assert here.unstable_pole_rad_s == pytest.approx(there.unstable_pole_rad_s, rel=1e-9)
    assert reversed_.controller("pid").direction == (-1.0,)
    for name in CONTROLLERS:
        assert run(reversed_, Experiment(name, "ukf", (0.022,)), runs=2, steps=400).held.all()


def test_the_controllers_ask_for_no_current_that_the_model_does_not_cover(levitation_model):
    """A driver of 30 V could hold 11 A: the voltage may be as high while the current changes, and no longer."""
    model, strong = levitation_model, with_circuit(levitation_model, voltage_max_V=30.0)
    assert design_loop(strong).model.circuit.voltage_max_V == 30.0
    changing = 0.7 * 2.69 + model.inductance(0.022, 0.7) * 0.63 / 0.5e-3
    # At the last covered current what holds it
    cases = (strong, 1.33, 1.33 * 2.69), (strong, 0.7, changing), (model, 1.33, model.circuit.voltage_max_V)
    for driven, current, volts in cases:
        found = limited(driven, np.array([[0.022, 0.0, current]]), np.array([[30.0]]))[0, 0]
        assert found == pytest.approx(volts, rel=1e-6)


@pytest.mark.nightly
def test_a_coil_that_settles_within_three_samples_is_held(levitation_model):
    quick = with_circuit(levitation_model, resistance_ohm=100.0, voltage_max_V=110.0, voltage_min_V=20.0)
    loop = design_loop(quick)
    assert run(loop, Experiment("pid", "ukf", (0.022,)), runs=3, steps=400, supported_steps=0).held.all()


def test_steel_alone_is_held_by_a_driver_of_both_signs_as_by_one_of_positive_voltages(levitation_model):
    designs = []
    for low in (-1.0, 0.0):
        model = with_circuit(levitation_model, voltage_min_V=3.0 * low)
        box = within(levitation_model.validity, low=1.2 * low, high=1.2)
        designs.append(design_loop(replace(model, magnetics=STEEL, validity=box, reference_distances_m=())))
    both, positive = ([point.currents_A[0] for point in design.points] for design in designs)
    assert min(both) > 0.0
    np.testing.assert_allclose(both, positive, rtol=1e-6)


def test_a_coil_slower_than_the_body_leaves_the_reference_a_tenth_of_the_bodys_rate(levitation_model):
    """A loop that holds a body which runs away is faster than it, whatever R/L is."""
    targets = (0.022, 0.024)
    slow = with_circuit(levitation_model, voltage_min_V=-3.0, inductance_H=0.6)
    point = operating_point(slow, targets[0])
    assert point.coil_pole_rad_s / 3.0 < 0.1 * point.natural_rad_s
    assert reference_rate(slow, targets) == pytest.approx(0.1 * point.natural_rad_s)


def test_a_loop_of_short_samples_stays_for_fewer_seconds(levitation_model):
    slow, fast = (design_loop(replace(levitation_model, sample_time_s=step)) for step in (1e-3, 5e-5))
    assert slow.stay_s == 1.0
    assert fast.stay_s == max(fast.step_s, 2000 * 5e-5) < 1.0


def test_pid_removes_a_constant_disturbance(levitation_model, design):
    controller, point = design.controller("pid"), operating_point(levitation_model, 0.026)
    plant = Plant(with_motion(levitation_model, gravity_m_s2=1.02 * levitation_model.motion.gravity_m_s2))
    state, memory, zero = point.state[None], np.zeros((1, controller.words)), np.zeros(1)
    reference = Reference(np.array([0.026]), zero, zero, point.currents_A[None])
    for _ in range(4000):
        voltage, memory = controller.command(memory, state, reference)
        state = plant.step(state, voltage)
    assert state[0, 0] == pytest.approx(0.026, abs=1e-7)  # backstepping would be off by 0.02 g/k_p = 0.2 mm


@pytest.mark.parametrize("name", CONTROLLERS)
def test_commands_stay_within_the_clamp_and_nothing_winds_up_behind_it(levitation_model, design, name):
    circuit, controller = levitation_model.circuit, design.controller(name)
    far, zero = np.array([[0.030, 0.0, 0.5]]), np.zeros(1)
    reference = Reference(np.array([0.022]), zero, zero, operating_point(levitation_model, 0.022).currents_A[None])
    memory, memories = np.zeros((1, controller.words)), []
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
    for part in ("gains", "integral"):
        own, wanted = (getattr(one, part) for one in (again.controller("state-feedback"), controller))
        np.testing.assert_allclose(own, wanted, rtol=1e-3)


def test_a_state_that_grows_is_brought_back_though_it_is_not_weighed_or_refused_where_it_cannot_be():
    A, B = np.diag([2.0, 0.5]), np.eye(2)
    X = solve_riccati(A, B, np.diag([0.0, 1.0]), np.eye(2))
    K = np.linalg.solve(np.eye(2) + B.T @ X @ B, B.T @ X @ A)
    assert np.abs(np.linalg.eigvals(A - B @ K)).max() == pytest.approx(0.5)  # the growing one mirrored
    with pytest.raises(DomainError, match="stabilising"):
        solve_riccati(A, np.array([[0.0], [1.0]]), np.eye(2), np.eye(1))
