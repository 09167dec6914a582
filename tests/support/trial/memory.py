"""Iron that remembers its currents: relays of Preisach, the law of Jiles and Atherton, and what stays for good.

References
----------
I. D. Mayergoyz, Mathematical Models of Hysteresis (Springer, 1991), chapter 1; D. C. Jiles and D. L. Atherton,
J. Magnetism and Magnetic Materials 61 (1986) 48.
"""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.stats import norm

from femfit.core.numerics import FloatArray
from femfit.device.parts import Actuator
from femfit.trial.field_table import Conditions, Device, HiddenError
from femfit.trial.hidden import is_linear_iron, is_soft
from support.trial.magnetics import magnetised_iron
from support.trial.truth import FIELD, Bend, Drawings, Truth, always, bent, place

REMANENCE_STEP_T = 0.02
"""Remanence of a linear core that is solved, either way; the fields are quadratic in it."""

_FAMILY = "memory"


def hysteresis(law: Literal["normal relays", "lorentzian relays", "jiles-atherton"]) -> Truth:
    """A loop between rising and falling currents, from a demagnetised core or after cycles before each run."""

    def build(device, rng):
        coercive, second, third = (float(x) for x in rng.uniform([0.08, 0.2, 0.3], [0.25, 0.5, 0.6]))
        cycles = int(rng.choice([0, 3]))

        def remembered(history):
            x = history / device.largest_current
            if law == "jiles-atherton":
                return jiles_atherton(x, coercive, second, 0.2 * third)
            ensemble = relay_ensemble if law == "normal relays" else lorentzian_ensemble
            return ensemble(coercive, second, third).irreversible(x)

        def fields(device, size, settings):
            memory = np.empty(len(settings.current))
            for run in np.unique(settings.run):
                during = settings.current[settings.run == run]
                before = np.tile([during.max(), during.min()], cycles)
                memory[settings.run == run] = remembered(np.concatenate([before, during]))[len(before) :]
            return magnetised(device, size * memory, settings)

        return HiddenError(_limit, FIELD, fields=fields)

    return Truth(build, lacks=_no_iron, families=_drawings)


def kept_flux(bend: Bend) -> Truth:
    """Iron that keeps a flux when the current is gone, by a tenth more or less over the distance."""

    def fields(device, size, settings):
        return magnetised(device, size * bent(place(device, settings), bend), settings)

    return always(HiddenError(_limit, FIELD, fields=fields), lacks=_no_iron, families=_drawings)


def magnetised(device: Device, memory: FloatArray, settings: Conditions) -> FloatArray:
    """What the memory of the core, -1 to 1 times its size, adds to the fields.

    A linear core has it as a remanence in T along the winding's flux, which is solved. Iron with a curve has it as
    further ampere turns, a part of the largest: its remanence over the same path.
    """
    if _FAMILY in device.families:
        return device.change(_FAMILY, memory, settings)
    shifted = device.drawn.at(settings.distance, settings.current + device.largest_current * memory)
    return shifted - device.drawn.at(settings.distance, settings.current)


def remembering_core(actuator: Actuator, remanence: float) -> Actuator:
    """The fixed soft parts with the remanence in T that the winding's flux leaves in them.

    Along the axis within the winding and against it outside of it, where the flux returns; parts above and below the
    winding lead it outwards and are left as they are. Positive where it adds to the flux of a positive current.
    """
    winding_r, winding_z = np.array(actuator.coil.vertices_m).T

    def way(region):
        r, z = np.array(region.vertices_m).T
        if z.max() <= winding_z.min() or z.min() >= winding_z.max():
            return 0.0
        return -1.0 if r.min() >= winding_r.max() else 1.0

    return magnetised_iron(actuator, remanence, way)


@dataclass(frozen=True, eq=False)
class Relays:
    """The classical Preisach model: relays, each with its own two thresholds and a weight, shape (N,), of sum 1."""

    up: FloatArray  # Inputs at which each switches to +1
    down: FloatArray  # And to -1
    weight: FloatArray

    def output(self, history: FloatArray) -> FloatArray:
        """Magnetisation, -1..1, along a history that starts demagnetised; between its values it is monotonic."""
        state = np.where(self.up + self.down < 0.0, 1.0, -1.0)
        result = np.empty(len(history))
        for k, value in enumerate(history):
            state = np.where(value >= self.up, 1.0, np.where(value <= self.down, -1.0, state))
            result[k] = self.weight @ state
        return result

    def irreversible(self, history: FloatArray) -> FloatArray:
        """What hysteresis adds along a history to the anhysteretic magnetisation.

        The latter remains after a slowly decaying alternation about a value: each relay's centre decides.
        """
        centre = 0.5 * (self.up + self.down)
        anhysteretic = np.sign(np.asarray(history, dtype=np.float64)[:, None] - centre) @ self.weight
        return self.output(history) - anhysteretic


def relay_ensemble(coercive: float, interaction: float, spread: float, parts: int = 24) -> Relays:
    """Relays with log-normal half widths, of median ``coercive``, and normal centres."""
    quantile = norm.ppf((np.arange(parts) + 0.5) / parts)
    centre, log_width = np.meshgrid(interaction * quantile, spread * quantile)
    return _relays(centre, coercive * np.exp(log_width))


def lorentzian_ensemble(coercive: float, interaction: float, spread: float, parts: int = 24) -> Relays:
    """Relays whose half widths, mostly ``coercive``, and centres have the heavy tails of Lorentz's law."""
    quantile = np.tan(np.pi * ((np.arange(parts) + 0.5) / parts - 0.5))
    centre, width = np.meshgrid(0.5 * interaction * quantile, 0.3 * spread * quantile)
    return _relays(centre, coercive * np.maximum(1.0 + width, 0.05))


def _relays(centre: FloatArray, half: FloatArray) -> Relays:
    return Relays((centre + half).ravel(), (centre - half).ravel(), np.full(centre.size, 1.0 / centre.size))


def jiles_atherton(history: FloatArray, pinning: float, coupling: float, reversible: float) -> FloatArray:
    """What the magnetisation differs by from the anhysteretic one; shape parameter a = 0.5 of the input's unit.

    dM_irr/dH = (M_an - M_irr) / (k sign(dH) - alpha (M_an - M_irr)), not against the field, with
    M_an = coth(x) - 1/x, x = (H + alpha M_irr) / a; the difference is (1 - c) (M_irr - M_an).
    """
    shape, feedback = 0.5, 0.3 * coupling
    field = irreversible = 0.0
    result = np.empty(len(history))
    for n, goal in enumerate(history.tolist()):
        steps = max(1, math.ceil(abs(goal - field) / (0.25 * pinning)))
        change = (goal - field) / steps
        for _ in range(steps):
            field += change
            ahead = math.copysign(1.0, change) * (_langevin((field + feedback * irreversible) / shape) - irreversible)
            if ahead > 0.0:
                irreversible += change * ahead / max(pinning - feedback * ahead, 0.2 * pinning)
        result[n] = (1.0 - reversible) * (irreversible - _anhysteretic(field, shape, feedback))
    return result


def _anhysteretic(field: float, shape: float, feedback: float) -> float:
    magnetisation = 0.0
    for _ in range(60):  # a contraction: feedback / (3 shape) < 0.1
        magnetisation = _langevin((field + feedback * magnetisation) / shape)
    return magnetisation


def _langevin(x: float) -> float:
    return 1.0 / math.tanh(x) - 1.0 / x if abs(x) > 1e-4 else x / 3.0


def _limit(device: Device) -> float:
    return 1.0 if _FAMILY in device.families else 0.025


def _no_iron(actuator: Actuator) -> str:
    return "" if any(map(is_soft, actuator.fixed)) else "no iron that stands still"


def _drawings(actuator: Actuator) -> Drawings:
    soft = filter(is_soft, (*actuator.fixed, *actuator.moving.regions))
    if not all(map(is_linear_iron, soft)):
        return {}
    return {_FAMILY: {step: remembering_core(actuator, step) for step in (-REMANENCE_STEP_T, REMANENCE_STEP_T)}}
