"""Effects as tests add them to a model."""

from femfit.effects.catalogue import effect_by_name
from femfit.effects.effect import AddedEffect
from femfit.model.with_effects import with_effects


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
