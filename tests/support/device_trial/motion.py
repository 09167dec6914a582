"""Records of a device in open loop, by equations of their own: elastic stops, springs and friction of any law.

Explicit Runge-Kutta steps of 20 us in (d, v, i) on bicubic splines of the drawn field; stops are stiff springs with
damping, dry friction is rounded within 1 mm/s, the freewheel diode keeps the current from turning round.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.interpolate import RectBivariateSpline

from femfit.core.arrays import FloatArray
from support.device_trial.tables import SolvedDevice

STEP_S, SAMPLE_STEPS = 20e-6, 5
CREEP_M_S = 1e-3
STOP_N_PER_M, STOP_N_S_PER_M = 2e7, 600.0
DIODE_V = 0.7


@dataclass(frozen=True)
class Physics:
    """What acts beside the drawn field; ``push`` is along growing distance in N, ``drag`` against the velocity."""

    mass_kg: float
    push: Callable[[float], float]
    drag: Callable[[float, float], float]  # (velocity, magnetic force) -> N
    ends_m: tuple[float, float]
    resistance_ohm: float  # Of winding and supply together
    one_sided: bool


def simulate(device: SolvedDevice, physics: Physics, voltage: FloatArray, start_m: float) -> pd.DataFrame:
    """Follow a command, given at the samples and held between, from rest.

    Returns
    -------
    DataFrame
        ``time_s``, ``voltage_V``, ``current_A`` and ``distance_m`` at every sample.
    """
    field = _Field(device)
    state, rows = np.array([start_m, 0.0, 0.0]), []
    for k, command in enumerate(voltage):
        rows.append((k * SAMPLE_STEPS * STEP_S, command, state[2], state[0]))
        for _ in range(SAMPLE_STEPS):
            state = _stepped(field, physics, state, float(command))
    return pd.DataFrame(rows, columns=["time_s", "voltage_V", "current_A", "distance_m"])


class _Field:
    """Force, flux linkage and its slopes of the drawn field."""

    def __init__(self, device: SolvedDevice) -> None:
        box = device.model.validity
        margin = 0.02 * (box.distance_max_m - box.distance_min_m)
        d = np.linspace(box.distance_min_m - margin, box.distance_max_m + margin, 161)
        i = np.linspace(box.current_min_A, box.current_max_A, 61)
        grid = np.meshgrid(d, i, indexing="ij")
        self.force = RectBivariateSpline(d, i, device.model.magnetics.force(*grid))
        self.flux = RectBivariateSpline(d, i, device.model.magnetics.flux_linkage(*grid))


def _stepped(field: _Field, physics: Physics, state: FloatArray, command: float) -> FloatArray:
    def rate(at: FloatArray) -> FloatArray:
        return _rate(field, physics, at, command)

    a = rate(state)
    b = rate(state + 0.5 * STEP_S * a)
    c = rate(state + 0.5 * STEP_S * b)
    d = rate(state + STEP_S * c)
    new = state + STEP_S / 6.0 * (a + 2.0 * b + 2.0 * c + d)
    if physics.one_sided and new[2] < 0.0:
        new[2] = 0.0
    return np.asarray(new)


def _rate(field: _Field, physics: Physics, state: FloatArray, command: float) -> FloatArray:
    d, v, i = state
    force = float(field.force(d, i)[0, 0])
    near, far = physics.ends_m
    contact = 0.0
    for depth, sign in ((near - d, 1.0), (d - far, -1.0)):
        if depth > 0.0:
            contact += sign * max(STOP_N_PER_M * depth - sign * STOP_N_S_PER_M * v, 0.0)
    push = physics.push(d) - force - physics.drag(v, force) + contact
    applied = command
    if physics.one_sided and command <= 0.0:
        applied = -DIODE_V if i > 0.0 else 0.0
    induced = float(field.flux(d, i, dx=1)[0, 0]) * v
    change = (applied - physics.resistance_ohm * i - induced) / float(field.flux(d, i, dy=1)[0, 0])
    return np.array([v, push / physics.mass_kg, change])


def dry(level: float) -> Callable[[float, float], float]:
    """Dry friction of one level."""
    return lambda v, _force: level * float(np.tanh(v / CREEP_M_S))
