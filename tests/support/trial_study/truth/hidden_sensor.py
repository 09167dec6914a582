"""Hidden effects of the Hall element and its electronics."""

import numpy as np

from support.trial_study.truth.bench import Channels, Hidden, Points
from support.trial_study.truth.families import Truth
from support.trial_study.truth.thermal import REFERENCE_C


def hall_offset(truth: Truth, generator: np.random.Generator) -> Hidden:
    """A quiescent voltage that is not the data sheet's."""
    sign = float(generator.choice([-1.0, 1.0]))
    return Hidden(
        "hall_offset",
        typical=0.02,
        limit=0.3,
        unit="V",
        reading=lambda size, values, at: {"hall_V": values["hall_V"] + sign * size},
        constants={"sign": sign},
    )


def hall_drift(truth: Truth, generator: np.random.Generator) -> Hidden:
    """Warming up over the whole campaign, with a random walk of a seventh of it."""
    sign, share, seed = (
        float(generator.choice([-1.0, 1.0])),
        float(generator.uniform(0.15, 0.6)),
        generator.integers(2**31),
    )

    def reading(size: float, values: Channels, at: Points) -> Channels:
        count = int(at.order.max()) + 1
        walk = np.cumsum(np.random.default_rng(seed).standard_normal(count)) / np.sqrt(count)
        x = at.order / count
        warm = (1.0 - np.exp(-x / share)) / (1.0 - np.exp(-1.0 / share))
        return {"hall_V": values["hall_V"] + sign * size * (warm + walk[at.order] / 7.0)}

    constants = {"sign": sign, "time_constant_share": share}
    return Hidden("hall_drift", typical=0.02, limit=0.3, unit="V", reading=reading, constants=constants)


def hall_temperature(truth: Truth, generator: np.random.Generator) -> Hidden:
    """Offset and sensitivity that follow the element's temperature."""
    element = truth.actuator.hall
    quiescent = element.quiescent_V if element else 0.0
    sign, gain = float(generator.choice([-1.0, 1.0])), float(generator.uniform(-1.0, 1.0))

    def reading(size: float, values: Channels, at: Points) -> Channels:
        warmer = at.element_C - REFERENCE_C
        signal = values["hall_V"] - quiescent
        return {"hall_V": values["hall_V"] + size * warmer * (sign + gain * signal)}

    return Hidden(
        "hall_temperature",
        typical=1e-3,
        limit=2e-2,
        unit="V/K",
        reading=reading,
        constants={"sign": sign, "gain_1_per_V": gain},
    )


def hall_saturation(truth: Truth, generator: np.random.Generator) -> Hidden:
    """An output stage that bends before it clips: V_q + A tanh(signal / A), size 1 / A."""
    element = truth.actuator.hall
    quiescent = element.quiescent_V if element else 0.0
    del generator

    def reading(size: float, values: Channels, at: Points) -> Channels:
        room = 1.0 / max(size, 1e-9)
        return {"hall_V": quiescent + room * np.tanh((values["hall_V"] - quiescent) / room)}

    return Hidden("hall_saturation", typical=0.3, limit=1.5, unit="1/V", reading=reading)


def hall_coil_pickup(truth: Truth, generator: np.random.Generator) -> Hidden:
    """Leads of the winding beside the element's: a signal of the current that the drawing does not have."""
    sign = float(generator.choice([-1.0, 1.0]))
    scale = max(map(abs, truth.actuator.sweep.currents_A))
    return Hidden(
        "hall_coil_pickup",
        typical=0.02 / scale,
        limit=0.3 / scale,
        unit="V/A",
        reading=lambda size, values, at: {"hall_V": values["hall_V"] + sign * size * at.current},
        constants={"sign": sign},
    )
