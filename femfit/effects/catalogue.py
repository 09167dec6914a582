"""The catalogue of effects: one tuple; third parties add theirs by the entry point ``femfit.effects``."""

from importlib.metadata import EntryPoint, entry_points

from femfit.core.errors import ModelFileError
from femfit.effects.core_saturation import CORE_SATURATION
from femfit.effects.distance_offset import DISTANCE_OFFSET
from femfit.effects.effect import Effect
from femfit.effects.hall_offset import HALL_OFFSET

BUILT_IN: tuple[Effect, ...] = (
    CORE_SATURATION,
    DISTANCE_OFFSET,
    HALL_OFFSET,
)

GROUP = "femfit.effects"
"""Entry points of other packages' effects, each named as its effect."""


def all_effects() -> dict[str, Effect]:
    """Every effect by its name: those of femfit, then those of installed packages.

    Returns
    -------
    dict of str to Effect
        In the catalogue's order; a name of femfit's own cannot be taken by another package.

    Raises
    ------
    ModelFileError
        If an installed package's effect cannot be loaded.
    """
    effects = {effect.name: effect for effect in BUILT_IN}
    for entry in entry_points(group=GROUP):
        effects.setdefault(entry.name, _loaded(entry))
    return effects


def effect_by_name(name: str) -> Effect:
    """Look up an effect; only the package that gives it is loaded.

    Parameters
    ----------
    name : str
        As in the model file, and as the entry point is called; case counts.

    Returns
    -------
    Effect
        The effect.

    Raises
    ------
    ModelFileError
        If no effect has this name, or its package cannot be loaded.
    """
    for effect in BUILT_IN:
        if effect.name == name:
            return effect
    for entry in entry_points(group=GROUP, name=name):
        return _loaded(entry)
    known = [effect.name for effect in BUILT_IN] + [entry.name for entry in entry_points(group=GROUP)]
    raise ModelFileError(
        f"Effect must be one of {', '.join(known)}; instead received {name!r}. If another package gives it, install "
        "that package."
    )


def _loaded(entry: EntryPoint) -> Effect:
    try:
        effect = entry.load()
    except (ImportError, AttributeError) as error:
        raise ModelFileError(
            f"Effect {entry.name!r} ({entry.value}) cannot be loaded: {error}. Repair or remove its package."
        ) from error
    if not isinstance(effect, Effect) or effect.name != entry.name:
        raise ModelFileError(
            f"Entry point {entry.name!r} ({entry.value}) must give an Effect of that name; it does not. Repair or "
            "remove its package."
        )
    return effect
