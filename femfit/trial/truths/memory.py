"""Iron that remembers its currents: relays of Preisach, the law of Jiles and Atherton, and what stays for good.

References
----------
I. D. Mayergoyz, Mathematical Models of Hysteresis (Springer, 1991), chapter 1; D. C. Jiles and D. L. Atherton,
J. Magnetism and Magnetic Materials 61 (1986) 48.
"""

import math
from collections.abc import Callable, Mapping
from typing import Literal

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.device.parts import Actuator
from femfit.trial.device import Conditions, Device, HiddenError
from femfit.trial.drawing_variants import is_linear_iron, is_soft, remembering_core
from femfit.trial.field_table import Fields
from femfit.trial.truths.preisach import lorentzian_ensemble, relay_ensemble
from femfit.trial.truths.truth import FIELD, Truth, bent, place

REMANENCE_STEP_T = 0.02
"""Remanence of a linear core that is solved, either way; the fields are quadratic in it."""

_FAMILY = "memory"

Law = Literal["normal relays", "lorentzian relays", "jiles-atherton"]


def hysteresis(law: Law) -> Truth:
    """A loop between rising and falling currents, from a demagnetised core or after cycles before each run."""

    def build(device: Device, rng: np.random.Generator) -> HiddenError:
        coercive, second, third = (float(x) for x in rng.uniform([0.08, 0.2, 0.3], [0.25, 0.5, 0.6]))
        cycles = int(rng.choice([0, 3]))

        def remembered(history: FloatArray) -> FloatArray:
            x = history / device.largest_current
            if law == "jiles-atherton":
                return jiles_atherton(x, coercive, second, 0.2 * third)
            ensemble = relay_ensemble if law == "normal relays" else lorentzian_ensemble
            return ensemble(coercive, second, third).irreversible(x)

        def fields(device: Device, size: float, at: Conditions) -> Fields:
            memory = np.empty(len(at.current))
            for run in np.unique(at.run):
                during = at.current[at.run == run]
                before = np.tile([during.max(), during.min()], cycles)
                memory[at.run == run] = remembered(np.concatenate([before, during]))[len(before) :]
            return magnetised(device, size * memory, at)

        constants = {"coercive": coercive, "second": second, "third": third, "cycles_before": float(cycles)}
        return HiddenError(_limit, FIELD, fields=fields, constants=constants)

    return Truth(build, lacks=_no_iron, families=_drawings)


def kept_flux(bend: Callable[[FloatArray], FloatArray]) -> Truth:
    """Iron that keeps a flux when the current is gone, by a tenth more or less over the distance."""

    def fields(device: Device, size: float, at: Conditions) -> Fields:
        return magnetised(device, size * bent(place(device, at), bend), at)

    error = HiddenError(_limit, FIELD, fields=fields, names=("core_remanence",))
    return Truth(lambda _, rng: error, lacks=_no_iron, families=_drawings)


def magnetised(device: Device, memory: FloatArray, at: Conditions) -> Fields:
    """What the memory of the core, -1 to 1 times its size, adds to the fields.

    A linear core has it as a remanence in T along the winding's flux, which is solved. Iron with a curve has it as
    further ampere turns, a part of the largest: its remanence over the same path.
    """
    if _FAMILY in device.families:
        return device.change(_FAMILY, memory, at)
    shifted = device.drawn.at(at.distance, at.current + device.largest_current * memory)
    return shifted - device.drawn.at(at.distance, at.current)


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


def _linear(actuator: Actuator) -> bool:
    return all(is_linear_iron(part) for part in (*actuator.fixed, *actuator.moving.regions) if is_soft(part))


def _limit(device: Device) -> float:
    return 1.0 if _FAMILY in device.families else 0.025


def _no_iron(actuator: Actuator) -> str:
    return "" if any(map(is_soft, actuator.fixed)) else "no iron that stands still"


def _drawings(actuator: Actuator) -> Mapping[str, Mapping[float, Actuator]]:
    if not _linear(actuator):
        return {}
    return {_FAMILY: {step: remembering_core(actuator, step) for step in (-REMANENCE_STEP_T, REMANENCE_STEP_T)}}
