"""Effects as tests add them to a model."""

import numpy as np

from femfit.effects.catalogue import BUILT_IN, effect_by_name
from femfit.effects.conditions import Conditions
from femfit.effects.effect import AddedEffect
from femfit.model.with_effects import nominal_of, with_effects


def added(name, **parameters):
    """An effect with its parameters in place of what they are without it."""
    effect = effect_by_name(name)
    return AddedEffect(effect, effect.null() | parameters)


def usual(effect, share=1.0):
    """Every amplitude a share of the way to what is usual at most."""
    sizes = {p.name: p.null + share * (max(p.plausible, key=abs) - p.null) for p in effect.amplitudes}
    return AddedEffect(effect, effect.null() | sizes)


def under_effects(model, *chosen):
    """A model with effects, each as a pair of name and parameters."""
    return with_effects(model, [added(name, **parameters) for name, parameters in chosen])


def usually(model, *names, share=1.0 / 3.0):
    """A model with effects of a share of their usual size."""
    return with_effects(model, [usual(effect_by_name(name), share) for name in names])


def conditions_at(model, points, **others):
    """What a bench or a record may know of so many points, with some states that effects remember."""
    random = np.random.default_rng(2)
    names = [name for effect in BUILT_IN if effect.memory is not None for name in effect.memory.names]
    known = {
        "branch": np.sign(random.normal(size=points)),
        "coil_temperature_C": random.uniform(20.0, 60.0, points),
        "magnet_temperature_C": random.uniform(20.0, 60.0, points),
        "time_s": random.uniform(0.1, 1.0, points),
        "elapsed": random.uniform(0.1, 1.0, points),
        "frequency_Hz": random.uniform(10.0, 300.0, points),
        "velocity_m_s": random.normal(0.0, 0.1, points),
        "current_rate_A_s": random.normal(0.0, 1.0, points),
        "memory": {name: 0.05 * random.normal(size=points) for name in names},
    }
    return Conditions(nominal_of(model), **known | others)
