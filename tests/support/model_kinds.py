"""Models of every kind that the equations of motion know, and these equations with an axis of circuits throughout."""

from dataclasses import replace

import casadi as ca
import numpy as np
from casadi import SX

from femfit.core.graph import GraphFunction, building
from femfit.core.numerics import central_differences
from femfit.device.electrics import Circuit
from femfit.device.mechanics import ForceTable, Mechanics, Spring, Stop
from femfit.fit.build import fit_model
from femfit.model.dynamics import evaluated, state_derivative, state_scale
from femfit.model.magnetics import Coefficient, LawMagnetics
from support.eddies import magnets_alone, with_eddies
from support.halves import cut_in_two
from support.solenoids import solenoid
from support.steps import exponential_step
from support.sweeps import WIDE, SaturatingCircuit

SPRUNG = Mechanics(
    4.35e-3,
    springs=(Spring(0.4, 2e-3, 0.024), ForceTable((0.01, 0.02, 0.04), (2e-3, 1e-3, -3e-3))),
    viscous_N_s_per_m=0.02,
    load_N=-1e-3,
    near_stop=Stop(0.016),
)


def state_jacobian(model, state, voltage):
    """Jacobian of the state's derivative with respect to the state."""
    order = state.shape[-1]
    with building():
        x, u = SX.sym("x", order), SX.sym("u", len(model.circuits))
        slope = ca.vec(ca.jacobian(model.equations.rates_at(x, u), x))
        columns = evaluated(model, GraphFunction([x, u, SX.sym("others", 3)], slope), state, voltage)
    return np.swapaxes(columns.reshape(*state.shape[:-1], order, order), -1, -2)


def with_choke(rig):
    """An inductance in series with the one circuit."""
    return replace(rig, circuits=(replace(rig.circuit, inductance_H=4e-3),))


def law_model(rig):
    """A force law with a constant inductance in place of the spline, and the numbers that no fit gives."""
    coefficients = (
        Coefficient("d^-4", 0, 0.1 + 0.2, "N m^4", ci95=(1e-9, 2.0 / 3.0), bounds=(0.0, np.inf)),
        Coefficient("d^-2", 1, 4.51e-6, "N m^2/A", active="lower"),
    )
    magnetics = LawMagnetics("F1e", coefficients, {}, 0.0162, 1.0 / 3.0)
    return replace(rig, magnetics=magnetics, covariance=np.diag([1e-20, 1.0 / 7.0]))


def saturating(_):
    """Iron that saturates at the least distance, swept to 1 A."""
    fitted = fit_model(SaturatingCircuit().table(np.linspace(0.0, 1.0, 6), WIDE)).model
    return replace(fitted, circuits=(Circuit(10.0, 0.0, 150.0),), motion=Mechanics(0.05, 0.0))


KINDS = {
    "one circuit": lambda rig: rig,
    "choke": with_choke,
    "springs": lambda rig: replace(rig, motion=SPRUNG),
    "dry friction": lambda rig: replace(rig, motion=replace(SPRUNG, coulomb_N=2e-3)),
    "solenoid": lambda _: solenoid(Mechanics(0.025, 0.0, springs=(Spring(200.0, 0.1, 4e-3),))),
    "saturating": saturating,
    "law": law_model,
    "halves": lambda rig: cut_in_two(with_choke(rig)),
    "magnets": magnets_alone,
    "eddies": with_eddies,
    "halves with eddies": lambda rig: with_eddies(cut_in_two(rig)),
    "magnets with eddies": lambda rig: with_eddies(magnets_alone(rig)),
}
"""From the rig of the tests."""


def held(model):
    """The same with a body that nothing moves."""
    return replace(model, motion=Mechanics(1e12, 0.0))


def states_of(model, count=30, seed=5):
    """Random states inside of the validity domain, off every knot, and voltages (count, n)."""
    generator, box, n = np.random.default_rng(seed), model.validity, len(model.circuits)
    stroke = box.distance_max_m - box.distance_min_m
    d = box.distance_min_m + stroke * generator.uniform(0.1, 0.85, count)
    v = generator.normal(0.0, 0.1, count)
    low, high = box.current_limits_A.T[:, :n] if n else np.zeros((2, 0))
    i = generator.uniform(low, high, (count, n))
    eddy = generator.normal(0.0, 0.3, (count, len(model.eddy_names)))
    memory = 0.05 * generator.normal(size=(count, len(model.memory_names)))
    return np.column_stack([d, v, i, eddy, memory]), generator.uniform(-3.0, 3.0, (count, n))


def voltage_of(model, volts):
    """Voltages (..., n) as the equations take them."""
    return volts[..., 0] if len(model.circuits) == 1 else volts


def rates(model, states, volts):
    return state_derivative(model, states, voltage_of(model, volts))


def slopes(model, states, volts):
    return state_jacobian(model, states, voltage_of(model, volts))


def by_volt(model, distance, bias, frequency):
    """Small sinusoidal currents (windings, circuits) in A for a volt at each circuit about a bias, the body held."""
    n, windings = len(model.circuits), model.windings
    state = np.zeros((1, model.order))
    state[0, 0], state[0, 2 : 2 + n] = distance, bias
    about = slopes(model, state, (model.resistances_ohm * bias)[None])[0, 2:, 2:]
    inductance = windings.magnetics.inductance(np.asarray(distance), state[0, 2:]) + windings.series_H
    return np.linalg.solve(2j * np.pi * frequency * np.eye(windings.count) - about, np.linalg.inv(inductance)[:, :n])


def step(model, states, volts, seconds):
    return exponential_step(model, states, voltage_of(model, volts), seconds)


def step_slopes(model, states, volts, seconds):
    """Jacobians (points, order, order) of a step, column after column in the equations."""
    length = None if model.equations._losses is None else seconds
    equations = model.equations
    slope = equations.function(
        ("slope", length), lambda x, u, h, *_: ca.vec(ca.jacobian(equations.step_at(x, u, length or h), x))
    )
    values = evaluated(model, slope, states, voltage_of(model, volts), step=seconds)
    return values.reshape(len(states), model.order, model.order).swapaxes(1, 2)


def differences(model, function, states, volts):
    """The Jacobian (points, rows, states) of a function of states and voltages by central differences."""
    wide = np.concatenate([volts] * (2 * states.shape[1]))
    return central_differences(lambda x: function(model, x, wide), states, state_scale(model))


def field_energy(model, distance, currents):
    """Sum of i times flux linkage less the co-energy, in J."""
    coenergy = model.windings.magnetics.coenergy(distance, currents)
    in_series = 0.5 * np.einsum("pj,jk,pk->p", currents, model.windings.series_H, currents)
    linked = model.windings.magnetics.flux_linkage(distance, currents)
    return (currents * linked).sum(axis=1) - coenergy + in_series
