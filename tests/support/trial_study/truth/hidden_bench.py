"""Hidden effects of the bench: stage, meters, load cell, driver, integrator, stops."""

import numpy as np

from support.trial_study.truth.bench import Channels, Hidden, Points
from support.trial_study.truth.families import Truth
from support.trial_study.truth.thermal import COPPER_PER_K, REFERENCE_C

_STEP_M, _PITCH_M = 2.5e-6, 1e-3
"""A stage's smallest step and its leadscrew's pitch."""


def _staged(distance: np.ndarray, periodic: float) -> np.ndarray:
    """Where a stage of finite steps and a wobbling screw really stops."""
    return np.round(distance / _STEP_M) * _STEP_M + periodic * np.sin(2.0 * np.pi * distance / _PITCH_M)


def distance_offset(truth: Truth, generator: np.random.Generator) -> Hidden:
    """A stage with a wrong zero."""
    low, high = truth.base.distances
    sign, periodic = float(generator.choice([-1.0, 1.0])), float(generator.uniform(0.0, 3e-6))
    return Hidden(
        "distance_offset",
        typical=1e-4,
        limit=min(1e-3, 0.15 * low + 0.01 * (high - low)),
        unit="m",
        setting=lambda size, at: (_staged(at.distance, periodic) + sign * size, at.current),
        constants={"sign": sign, "periodic_m": periodic},
    )


def distance_scale(truth: Truth, generator: np.random.Generator) -> Hidden:
    """A stage with a wrong pitch, zeroed at the face."""
    sign, periodic = float(generator.choice([-1.0, 1.0])), float(generator.uniform(0.0, 3e-6))
    return Hidden(
        "distance_scale",
        typical=0.01,
        limit=0.05,
        unit="",
        setting=lambda size, at: (_staged(at.distance, periodic) * (1.0 + sign * size), at.current),
        constants={"sign": sign, "periodic_m": periodic},
    )


def current_gain(truth: Truth, generator: np.random.Generator) -> Hidden:
    """A shunt that is off, and a little nonlinear."""
    sign, bend = float(generator.choice([-1.0, 1.0])), float(generator.uniform(-0.1, 0.1))
    scale = max(map(abs, truth.actuator.sweep.currents_A))
    return Hidden(
        "current_gain",
        typical=0.02,
        limit=0.15,
        unit="",
        setting=lambda size, at: (
            at.distance,
            at.current * (1.0 + sign * size * (1.0 + bend * np.abs(at.current) / scale)),
        ),
        constants={"sign": sign, "bend": bend},
    )


def current_offset(truth: Truth, generator: np.random.Generator) -> Hidden:
    """A current meter with a zero error."""
    sign = float(generator.choice([-1.0, 1.0]))
    scale = max(map(abs, truth.actuator.sweep.currents_A))
    return Hidden(
        "current_offset",
        typical=0.02 * scale,
        limit=0.15 * scale,
        unit="A",
        setting=lambda size, at: (at.distance, at.current + sign * size),
        constants={"sign": sign},
    )


def force_gain(truth: Truth, generator: np.random.Generator) -> Hidden:
    """A load cell with a wrong slope, and a little nonlinear."""
    sign, bend = float(generator.choice([-1.0, 1.0])), float(generator.uniform(-0.1, 0.1))
    scale = _largest_force(truth)

    def reading(size: float, values: Channels, at: Points) -> Channels:
        force = values["force_N"]
        return {"force_N": force * (1.0 + sign * size * (1.0 + bend * force / scale))}

    return Hidden(
        "force_gain", typical=0.03, limit=0.2, unit="", reading=reading, constants={"sign": sign, "bend": bend}
    )


def force_offset(truth: Truth, generator: np.random.Generator) -> Hidden:
    """A load cell with a zero error."""
    return _added_force("force_offset", truth, generator)


def constant_force(truth: Truth, generator: np.random.Generator) -> Hidden:
    """A cable or spring that pulls at the body."""
    return _added_force("constant_force", truth, generator)


def _added_force(name: str, truth: Truth, generator: np.random.Generator) -> Hidden:
    sign, scale = float(generator.choice([-1.0, 1.0])), _largest_force(truth)
    return Hidden(
        name,
        typical=0.02 * scale,
        limit=0.3 * scale,
        unit="N",
        reading=lambda size, values, at: {"force_N": values["force_N"] + sign * size},
        constants={"sign": sign},
    )


def end_stop_contact(truth: Truth, generator: np.random.Generator) -> Hidden:
    """A round stop that the body touches at small distances and dents by Hertz's law: F = K (d_stop - d)^1.5.

    References
    ----------
    K. L. Johnson, Contact Mechanics (Cambridge, 1985), section 4.2.
    """
    low, high = truth.actuator.sweep.distances_m[0], truth.actuator.sweep.distances_m[-1]
    stop = low + float(generator.uniform(0.1, 0.3)) * (high - low)
    typical = 0.1 * _largest_force(truth) / (stop - low) ** 1.5

    def reading(size: float, values: Channels, at: Points) -> Channels:
        return {"force_N": values["force_N"] - size * np.maximum(stop - at.distance, 0.0) ** 1.5}

    return Hidden(
        "end_stop_contact",
        typical=typical,
        limit=50.0 * typical,
        unit="N/m^1.5",
        reading=reading,
        constants={"stop_m": stop},
    )


def coil_temperature(truth: Truth, generator: np.random.Generator) -> Hidden:
    """Copper that warms; size 1 is copper's coefficient."""
    resistance = truth.actuator.coil.resistance_ohm

    def reading(size: float, values: Channels, at: Points) -> Channels:
        warmer = resistance * size * COPPER_PER_K * (at.coil_C - REFERENCE_C)
        return {"voltage_V": values["voltage_V"] + warmer * at.current}

    return Hidden("coil_temperature", typical=1.0, limit=1.3, unit="", reading=reading)


def flux_integrator_drift(truth: Truth, generator: np.random.Generator) -> Hidden:
    """An integrator with an offset voltage, set to zero before each run."""
    sign = float(generator.choice([-1.0, 1.0]))
    return Hidden(
        "flux_integrator_drift",
        typical=1e-6,
        limit=1e-4,
        unit="V",
        reading=lambda size, values, at: {"flux_linkage_Wb": values["flux_linkage_Wb"] + sign * size * at.time_s},
        constants={"sign": sign},
    )


def _largest_force(truth: Truth) -> float:
    near = np.array([truth.actuator.sweep.distances_m[0]])
    return float(np.abs(truth.base.at(near, np.array([truth.actuator.sweep.currents_A[-1]])).force)[0])
