"""Records over time: a solenoid that is switched, a voice coil that is swung, with one thing other than drawn."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pandas as pd

from femfit.core.arrays import FloatArray
from femfit.device.mechanics import spring_force
from support.device_trial.bench import Campaign
from support.device_trial.causes import CLEAN, Cause
from support.device_trial.motion import CREEP_M_S, SAMPLE_STEPS, STEP_S, Physics, dry, simulate
from support.device_trial.tables import SolvedDevice

DURATION_S, RUNS = 0.35, 2
NOISE_A, NOISE_M = 3e-3, 4e-6


def record_campaign(device: SolvedDevice, cause: Cause | None, rng: np.random.Generator) -> Campaign:
    """Runs of two commands, current and distance with white noise; nothing is hidden without a cause."""
    hidden = CLEAN if cause is None else cause.name
    size = float(rng.uniform(0.6, 1.4))
    physics = _changed(device, _drawn(device), hidden, size)
    pieces = []
    for run in range(RUNS):
        rows = simulate(device, physics, _command(device, run, rng), _start(device))
        if hidden == "bent_position":
            rows["distance_m"] = _bent(device, rows["distance_m"].to_numpy(), size)
        rows["current_A"] += rng.normal(0.0, NOISE_A, len(rows))
        rows["distance_m"] += rng.normal(0.0, NOISE_M, len(rows))
        pieces.append(rows.assign(run=run + 1))
    return Campaign(pd.concat(pieces, ignore_index=True), float("nan"))


def _drawn(device: SolvedDevice) -> Physics:
    mechanics, circuit = device.actuator.mechanics, device.actuator.circuits[0]
    friction = dry(mechanics.coulomb_N)
    return Physics(
        mass_kg=mechanics.mass_kg,
        push=lambda d: float(mechanics.static_force(np.array(d))),
        drag=lambda v, force: mechanics.viscous_N_s_per_m * v + friction(v, force),
        ends_m=mechanics.ends,
        resistance_ohm=circuit.resistance_ohm,
        one_sided=circuit.drive.diode_V is not None,
    )


def _changed(device: SolvedDevice, drawn: Physics, hidden: str, size: float) -> Physics:
    push, drag = _further_push(device, hidden, size), _further_drag(device, hidden, size)
    near, far = drawn.ends_m
    return replace(
        drawn,
        push=lambda d: drawn.push(d) + push(d),
        drag=lambda v, force: drawn.drag(v, force) + drag(v, force),
        mass_kg=drawn.mass_kg * (1.0 + 0.08 * size * (hidden == "heavier")),
        resistance_ohm=drawn.resistance_ohm * (1.0 + 0.05 * size * (hidden == "weak_supply")),
        ends_m=(near + 0.08e-3 * size * (hidden == "worn_stop"), far),
    )


def _further_push(device: SolvedDevice, hidden: str, size: float) -> Callable[[float], float]:
    spring, box = device.actuator.mechanics.springs[0], device.model.validity
    half = 0.5 * (box.distance_max_m - box.distance_min_m)
    stiffness, middle = size * spring.stiffness_N_per_m, spring.distance_m
    laws: dict[str, Callable[[float], float]] = {
        "stiffer_spring": lambda d: 0.35 * size * float(spring_force(spring, np.array(d))),  # of the same free length
        # a second spring that is met on the way
        "kinked_spring": lambda d: 0.5 * stiffness * max(box.distance_max_m - 0.8 * half - d, 0.0),
        "hardening_spring": lambda d: -0.5 * stiffness * (d - middle) ** 3 / half**2,
    }
    return laws.get(hidden, lambda _d: 0.0)


def _further_drag(device: SolvedDevice, hidden: str, size: float) -> Callable[[float, float], float]:
    viscous = device.actuator.mechanics.viscous_N_s_per_m
    laws: dict[str, Callable[[float, float], float]] = {
        # a plunger off its axis leans on the bore the more, the harder it is pulled
        "side_pull": lambda v, force: 0.08 * size * abs(force) * float(np.tanh(v / CREEP_M_S)),
        "more_damping": lambda v, _force: 0.4 * size * viscous * v,
    }
    return laws.get(hidden, lambda _v, _force: 0.0)


def _bent(device: SolvedDevice, distance: FloatArray, size: float) -> FloatArray:
    """A position sensor with a cubic characteristic: right at both ends and in the middle of its range."""
    box = device.model.validity
    x = 2.0 * (distance - box.distance_min_m) / (box.distance_max_m - box.distance_min_m) - 1.0
    return np.asarray(distance + 0.02 * size * (box.distance_max_m - box.distance_min_m) * (x**3 - x))


def _start(device: SolvedDevice) -> float:
    mechanics = device.actuator.mechanics
    return mechanics.ends[1] if device.name == "solenoid" else float(mechanics.springs[0].distance_m)


def _command(device: SolvedDevice, run: int, rng: np.random.Generator) -> FloatArray:
    t = np.arange(0.0, DURATION_S, STEP_S * SAMPLE_STEPS)
    if device.name == "solenoid":
        high, period = rng.uniform(8.0, 12.0), rng.uniform(0.10, 0.14)
        return np.where(t % period < 0.55 * period, high, 0.0)
    swing = [(rng.uniform(1.0, 1.6), rng.uniform(4.0, 12.0)), (rng.uniform(0.4, 0.9), rng.uniform(25.0, 60.0))]
    phase = rng.uniform(0.0, np.pi) + run
    return np.asarray(sum(volts * np.sin(2.0 * np.pi * hertz * t + phase) for volts, hertz in swing))
