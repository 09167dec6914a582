"""Records over time of a device in open loop, by equations of their own, with one thing other than drawn.

Explicit Runge-Kutta steps of 20 us on bicubic splines of the model's field: stops are stiff springs with damping, dry
friction is rounded within 1 mm/s, sticking friction is a bristle that bends, an eddy path is a resistance beside the
inductance, the freewheel diode keeps the current from turning round.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.interpolate import RectBivariateSpline

from support.one_current import flat

STEP_S, SAMPLE_STEPS = 20e-6, 5
CREEP_M_S = 1e-3
BRISTLE_M = 20e-6
STOP_N_PER_M, STOP_N_S_PER_M = 2e7, 600.0
DIODE_V = 0.7
DURATION_S, RUNS = 0.35, 2
NOISE_A, NOISE_M = 3e-3, 4e-6

_BOTH = {
    "stiffer_spring": ("spring_stiffness",),
    "bent_position": ("position_nonlinearity",),
    "weak_supply": ("supply_sag",),
}
CAUSES = {
    "solenoid": _BOTH
    | {
        "worn_stop": ("stop_position",),
        "eddy_path": ("eddy_current_lag",),
        "kinked_spring": (),
        "side_pull": ("side_pull_friction",),
    },
    "voice-coil": _BOTH
    | {
        "more_damping": ("viscous_friction",),
        "heavier": ("mass_error",),
        "sticking": ("coulomb_friction",),
        "dead_zone": ("driver_dead_zone",),
        "hardening_spring": (),
    },
}
"""By device and cause: the effects of the catalogue that say the same; none where it has nothing like it."""


@dataclass(frozen=True)
class Physics:
    """What acts beside the field; ``push`` is along growing distance in N, ``drag`` against the velocity."""

    mass_kg: float
    push: Callable
    drag: Callable  # (velocity, magnetic force) -> N
    ends_m: tuple[float, float]
    resistance_ohm: float  # Of winding and supply together
    one_sided: bool
    sticking_N: float = 0.0
    eddy_S: float = 0.0  # Conductance beside the inductance, seen from the winding
    dead_zone_V: float = 0.0


def record(actuator, model, cause, rng):
    """Runs of two commands with white noise on current and distance, and the size of the cause, 1 in the middle."""
    size = float(rng.uniform(0.6, 1.4))
    physics, field = _changed(actuator, model, cause, size), Field(model)
    mechanics, box = actuator.mechanics, model.validity
    start = mechanics.ends[1] if physics.one_sided else float(mechanics.springs[0].distance_m)
    runs = []
    for run in range(RUNS):
        rows = simulate(field, physics, _command(physics.one_sided, run, rng), start)
        if cause == "bent_position":  # a cubic characteristic: right at both ends and in the middle of the range
            travel = box.distance_max_m - box.distance_min_m
            x = 2.0 * (rows["distance_m"] - box.distance_min_m) / travel - 1.0
            rows["distance_m"] += 0.02 * size * travel * (x**3 - x)
        rows["current_A"] += rng.normal(0.0, NOISE_A, len(rows))
        rows["distance_m"] += rng.normal(0.0, NOISE_M, len(rows))
        runs.append(rows.assign(run=run + 1))
    return pd.concat(runs, ignore_index=True), size


def _changed(actuator, model, cause, size):
    """The drawn mechanics and circuit with one cause."""
    mechanics, circuit, box = actuator.mechanics, actuator.circuits[0], model.validity
    spring, half = mechanics.springs[0], 0.5 * (box.distance_max_m - box.distance_min_m)
    stiffness = size * spring.stiffness_N_per_m
    springs = {
        "stiffer_spring": lambda d: 0.35 * (size * spring.preload_N - stiffness * (d - spring.distance_m)),  # as long
        "kinked_spring": lambda d: 0.5 * stiffness * max(box.distance_max_m - 0.8 * half - d, 0.0),  # met on the way
        "hardening_spring": lambda d: -0.5 * stiffness * (d - spring.distance_m) ** 3 / half**2,
    }
    more = springs.get(cause, lambda d: 0.0)
    viscous = mechanics.viscous_N_s_per_m * (1.0 + 0.4 * size * (cause == "more_damping"))
    # A plunger off its axis leans on the bore the more, the harder it is pulled
    leaning = 0.08 * size * (cause == "side_pull")

    def drag(v, force):
        return viscous * v + (mechanics.coulomb_N + leaning * abs(force)) * float(np.tanh(v / CREEP_M_S))

    near, far = mechanics.ends
    return Physics(
        mass_kg=mechanics.mass_kg * (1.0 + 0.08 * size * (cause == "heavier")),
        push=lambda d: float(mechanics.static_force(np.array(d))) + more(d),
        drag=drag,
        ends_m=(near + 0.08e-3 * size * (cause == "worn_stop"), far),
        resistance_ohm=circuit.resistance_ohm * (1.0 + 0.05 * size * (cause == "weak_supply")),
        one_sided=circuit.drive.diode_V is not None,
        sticking_N=0.2 * size * (cause == "sticking"),
        eddy_S=0.1 / circuit.resistance_ohm * size * (cause == "eddy_path"),
        dead_zone_V=0.08 * size * (cause == "dead_zone"),
    )


def _command(one_sided, run, rng):
    t = np.arange(0.0, DURATION_S, STEP_S * SAMPLE_STEPS)
    if one_sided:
        high, period = rng.uniform(8.0, 12.0), rng.uniform(0.10, 0.14)
        return np.where(t % period < 0.55 * period, high, 0.0)
    swing = [(rng.uniform(1.0, 1.6), rng.uniform(4.0, 12.0)), (rng.uniform(0.4, 0.9), rng.uniform(25.0, 60.0))]
    phase = rng.uniform(0.0, np.pi) + run
    return sum(volts * np.sin(2.0 * np.pi * hertz * t + phase) for volts, hertz in swing)


class Field:
    """Force, flux linkage and its slopes of a model's field."""

    def __init__(self, model):
        box = model.validity
        margin = 0.02 * (box.distance_max_m - box.distance_min_m)
        d = np.linspace(box.distance_min_m - margin, box.distance_max_m + margin, 161)
        i = np.linspace(box.current_min_A, box.current_max_A, 61)
        grid = np.meshgrid(d, i, indexing="ij")
        self.force = RectBivariateSpline(d, i, flat(model.magnetics).force(*grid))
        self.flux = RectBivariateSpline(d, i, flat(model.magnetics).flux_linkage(*grid))


def simulate(field, physics, voltage, start_m):
    """Follow a command, given at the samples and held between, from rest: time, voltage, current and distance."""
    state, rows = np.array([start_m, 0.0, 0.0, 0.0]), []
    for k, command in enumerate(voltage.tolist()):
        rows.append((k * SAMPLE_STEPS * STEP_S, command, _terminal(physics, state, command)[1], state[0]))
        for _ in range(SAMPLE_STEPS):
            a = _rate(field, physics, state, command)
            b = _rate(field, physics, state + 0.5 * STEP_S * a, command)
            c = _rate(field, physics, state + 0.5 * STEP_S * b, command)
            d = _rate(field, physics, state + STEP_S * c, command)
            state = state + STEP_S / 6.0 * (a + 2.0 * b + 2.0 * c + d)
            state[2] = max(state[2], 0.0) if physics.one_sided else state[2]
    return pd.DataFrame(rows, columns=["time_s", "voltage_V", "current_A", "distance_m"])


def _terminal(physics, state, command):
    """Voltage and current of the winding; what flows beside the magnetising current drives the eddy path."""
    applied = command
    if physics.one_sided and command <= 0.0:
        applied = -DIODE_V if state[2] > 0.0 else 0.0
    applied -= float(np.clip(applied, -physics.dead_zone_V, physics.dead_zone_V))
    return applied, (state[2] + physics.eddy_S * applied) / (1.0 + physics.eddy_S * physics.resistance_ohm)


def _rate(field, physics, state, command):
    """Rates of distance, velocity, magnetising current and the bend of the bristles over their largest."""
    d, v, i, bend = state
    force = float(field.force(d, i)[0, 0])
    near, far = physics.ends_m
    contact = 0.0
    for depth, sign in ((near - d, 1.0), (d - far, -1.0)):
        if depth > 0.0:
            contact += sign * max(STOP_N_PER_M * depth - sign * STOP_N_S_PER_M * v, 0.0)
    push = physics.push(d) - force - physics.drag(v, force) - physics.sticking_N * bend + contact
    applied, current = _terminal(physics, state, command)
    induced = float(field.flux(d, i, dx=1)[0, 0]) * v
    change = (applied - physics.resistance_ohm * current - induced) / float(field.flux(d, i, dy=1)[0, 0])
    return np.array([v, push / physics.mass_kg, change, (v - abs(v) * bend) / BRISTLE_M])
