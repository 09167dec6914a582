"""No circuit, one and several obey the same equations, and what is in series with a coil counts."""

import json
from dataclasses import replace

import numpy as np
import pytest

from femfit.core.errors import MissingPartError
from femfit.core.numerics import central_differences
from femfit.device.electrics import CurrentSensor
from femfit.device.mechanics import Mechanics
from femfit.effects.catalogue import effect_by_name
from femfit.effects.effect import AddedEffect
from femfit.model.dynamics import runge_kutta_step, state_derivative, state_jacobian
from femfit.model.exponential_step import exponential_step
from femfit.model.float_steps import float_step
from femfit.model.json_file import model_to_dict
from femfit.model.sensors import reading_of
from femfit.model.validity import ActuatorKind, ValidityBox
from femfit.model.with_effects import with_effects
from support.command import femfit
from support.halves import NAMES, cut_in_two
from support.readings import predict_sensors

SERIES_H = 4e-3


@pytest.fixture(scope="module")
def whole(levitation_model):
    """One circuit, with a choke in series."""
    return replace(levitation_model, circuits=(replace(levitation_model.circuit, inductance_H=SERIES_H),))


@pytest.fixture(scope="module")
def halves(whole):
    return cut_in_two(whole)


@pytest.fixture(scope="module")
def magnets(levitation_model):
    """The magnet and the iron alone."""
    kind = ActuatorKind(True, True, False, False, coil=False, saturates=False)
    box = replace(levitation_model.validity, current_max_A=0.0)
    return replace(levitation_model, circuits=(), sensor=None, kind=kind, validity=box)


def a_state(circuits, count=30, alike=False):
    generator = np.random.default_rng(5)
    d, v = generator.uniform(0.018, 0.04, count), generator.normal(0.0, 0.1, count)
    i = generator.uniform(0.0, 1.4, (circuits, count))
    return np.column_stack([d, v, *([i[0]] * circuits if alike else i)])


@pytest.mark.parametrize("name", ["whole", "halves", "magnets"])
def test_force_and_motional_constants_at_distances_that_stay_are_those_of_the_state(request, name):
    model = request.getfixturevalue(name)
    states = a_state(len(model.circuits))
    distance, currents = states[:, 0], states[:, 2:]
    at = model.magnetics.state_of_circuits(distance, currents)
    force, motional_constant = model.magnetics.at_distances(distance)(currents)
    np.testing.assert_allclose(force, at.force, rtol=1e-12)
    np.testing.assert_allclose(motional_constant, at.motional_constant, rtol=1e-12)


@pytest.mark.parametrize("name", ["whole", "halves", "magnets"])
def test_the_jacobian_is_that_of_differences(request, name):
    model = request.getfixturevalue(name)
    n = len(model.circuits)
    states, volts = a_state(n), np.random.default_rng(6).uniform(-3.0, 3.0, (30, n))
    volts = volts[:, 0] if n == 1 else volts
    scale = np.array([1e-2, 0.1, *[1.0] * n])
    slopes = central_differences(
        lambda x: state_derivative(model, x, np.concatenate([volts] * (2 * model.order))), states, scale
    )
    found = state_jacobian(model, states, volts)
    size = np.abs(slopes).max(axis=0) + 1e-12
    # Rates of 1e3 A/s that cancel to slopes of some 10 are rounded over steps of 2e-7 m
    assert (np.abs(found - slopes) / size).max() < 1e-7
    assert found.shape == (30, 2 + n, 2 + n)


def test_two_halves_fed_alike_move_as_the_whole(whole, halves):
    one, two = a_state(1), a_state(2, alike=True)
    volts = np.linspace(0.5, 3.0, 30)
    rates, of_halves = (
        state_derivative(whole, one, volts),
        state_derivative(halves, two, np.repeat(0.5 * volts[:, None], 2, axis=1)),
    )
    np.testing.assert_allclose(of_halves[:, :3], rates, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(of_halves[:, 3], rates[:, 2], rtol=1e-9, atol=1e-12)


def test_an_inductance_in_series_slows_the_current_of_one_circuit(whole, levitation_model):
    """Held at one place, the current rises with the time constant (L + L_s) / R."""
    sag = effect_by_name("supply_sag")
    under_effects = with_effects(whole, [AddedEffect(sag, sag.null())])
    assert under_effects.dynamics.drives
    for model, series in ((levitation_model, 0.0), (whole, SERIES_H), (under_effects, SERIES_H)):
        held = replace(model, motion=Mechanics(1e9, 0.0))
        ohms = model.circuit.resistance_ohm
        inductance = float(model.inductance(0.03, 0.5)) + series  # the same at every current
        state = runge_kutta_step(held, np.array([[0.03, 0.0, 0.0]]), np.array([ohms]), 5e-3, 50)
        assert state[0, 2] == pytest.approx(1.0 - np.exp(-5e-3 * ohms / inductance), rel=1e-6)


def test_a_printed_model_says_what_is_in_series(whole, levitation_model):
    assert "4.00 mH in series" in str(whole)
    assert "in series" not in str(levitation_model)


def test_the_step_in_floats_counts_it_too(whole):
    state = np.array([[0.03, 0.1, 0.4]])
    step = float_step(whole)([[one] for one in state[0]], 2.0)
    np.testing.assert_allclose(
        np.array(step).T, exponential_step(whole, state, np.array([2.0]), whole.sample_time_s), rtol=1e-13
    )


def test_magnets_alone_fall_and_pull_as_their_force_says(magnets):
    state = np.array([[0.03, 0.2]])
    rates = state_derivative(magnets, state, np.zeros((1, 0)))
    weight = magnets.motion.gravity_m_s2
    assert rates[0].tolist() == pytest.approx(
        [0.2, weight - float(magnets.magnetics.force(0.03, 0.0)) / magnets.motion.mass_kg]
    )
    magnets.require_dynamics()


def test_a_winding_whose_resistance_is_unknown_is_no_pair_of_magnets(levitation_model):
    with pytest.raises(MissingPartError, match="circuit"):
        replace(levitation_model, circuits=()).require_dynamics()


def test_a_current_sensor_reads_the_circuit_that_it_names(halves):
    model = replace(halves, other_sensors=tuple(CurrentSensor(name=f"shunt_{one}", circuit=one) for one in NAMES))
    assert predict_sensors(model, np.array([0.02, 0.0, 0.3, 0.7])).tolist() == [0.3, 0.7]
    assert [reading_of(model, f"shunt_{one}").column for one in NAMES] == ["current_inner_A", "current_outer_A"]
    lost = replace(halves, other_sensors=(CurrentSensor(name="shunt", circuit="middle"),))
    with pytest.raises(MissingPartError, match="inner, outer"):
        predict_sensors(lost, np.array([0.02, 0.0, 0.3, 0.7]))


def test_a_domain_spans_a_grid_of_all_currents():
    d, i = ValidityBox(1e-3, 2e-3, 0.0, 1.0, ((-1.0, 1.0),)).grid(2, 3)
    assert (d.shape, i.shape) == ((18,), (18, 2))
    assert {tuple(row) for row in i.tolist()} == {(a, b) for a in (0.0, 0.5, 1.0) for b in (-1.0, 0.0, 1.0)}
    assert ValidityBox(1e-3, 2e-3, 0.0, 1.0).grid(2, 3)[1].shape == (6,)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda data: data["circuits"][1].update(name="inner"), "circuits"),
        (lambda data: data["circuits"][1].update(name="other"), "other"),
        (lambda data: data["magnetics"].update(circuits=["inner", "inner"]), "circuits"),
        (lambda data: data["validity"].update(current_min_A=0.0, current_max_A=0.0), "range"),
        (lambda data: data["motion"].update(mass_kg=1e-320), "mass_kg"),
    ],
)
def test_circuits_that_cannot_be_told_apart_and_absurd_numbers_are_refused_in_a_file(halves, tmp_path, change, said):
    data = model_to_dict(halves)
    change(data)
    (tmp_path / "model.json").write_text(json.dumps(data))
    done = femfit("simulate", tmp_path / "model.json")
    assert done.returncode == 1
    assert said in done.stderr


def test_a_range_that_ends_at_zero_has_no_sign_there(halves):
    text = str(replace(halves, validity=replace(halves.validity, current_min_A=-3.0, current_max_A=-0.0)))
    assert "-3 to 0 A" in text
